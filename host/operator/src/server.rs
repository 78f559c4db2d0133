//! The page's two threads: one makes what is shown, one hands it out.

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nearfield_recording::queue::Next;
use nearfield_recording::{Drain, Tap};
use nearfield_shared::units::Micros;
use tokio::sync::Notify;

use crate::about::About;
use crate::board::Board;
use crate::commission::Order;
use crate::connections::serve;
use crate::model::Model;
use crate::routes::{Shared, routes};

/// What the page needs to know.
pub struct Settings {
    /// Where it listens.
    pub listen: SocketAddr,
    /// File with the token; `None` = read-only for everybody.
    pub token_file: Option<PathBuf>,
    /// Folder of recordings.
    pub recordings: Option<PathBuf>,
    /// Where remarks go.
    pub remarks: Option<Tap>,
    /// What does not change.
    pub about: About,
    /// The host's clock.
    pub clock: Box<dyn Fn() -> Micros + Send + Sync>,
}

/// Why there is no page. Everything else goes on.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The address is taken, or is not this computer's.
    #[error("the page cannot listen on {address}: {source}; change page.listen")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// The token's file.
    #[error("{}: cannot read the page's token: {source}; change page.token_file", path.display())]
    Token {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A token that is guessed too easily.
    #[error("{}: the page's token must have at least {SHORTEST_TOKEN} characters; `openssl rand -hex 16` makes one", path.display())]
    WeakToken {
        /// The file.
        path: PathBuf,
    },
    /// No thread or no runtime.
    #[error("the page's server cannot be started: {0}")]
    Start(#[from] std::io::Error),
}

/// Characters of a token.
pub const SHORTEST_TOKEN: usize = 16;

/// The page at work; dropping it ends it.
pub struct Page {
    address: SocketAddr,
    end: Arc<Notify>,
    ending: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

/// Orders that wait for the model's thread at most.
const MOST_ORDERS: usize = 4;
/// The queue is looked at so often.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// What is shown is made anew so often.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(100);

impl Page {
    /// Listens and starts both threads.
    ///
    /// # Errors
    /// See [`PageError`].
    pub fn start(settings: Settings, model: Model, drain: Drain) -> Result<Self, PageError> {
        let address = settings.listen;
        let token = settings.token_file.map(read_token).transpose()?;
        let listener = TcpListener::bind(address).map_err(|source| PageError::Listen { address, source })?;
        let address = listener.local_addr()?;
        let board = Board::default();
        let (orders, ordered) = sync_channel(MOST_ORDERS);
        let about = About {
            takes_remarks: token.is_some() && settings.remarks.is_some(),
            takes_orders: token.is_some(),
            ..settings.about
        };
        let shared = Shared {
            board: board.clone(),
            about: serde_json::to_vec(&about).map_err(std::io::Error::from)?,
            recordings: settings.recordings,
            token,
            remarks: settings.remarks,
            orders,
            clock: settings.clock,
        };
        let (end, ending) = (Arc::new(Notify::new()), Arc::new(AtomicBool::new(false)));
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().max_blocking_threads(2).build()?;
        let (of_server, of_model) = (Arc::clone(&end), Arc::clone(&ending));
        let server = std::thread::Builder::new().name("page".to_owned()).spawn(move || {
            step_back();
            if let Err(error) = runtime.block_on(serve(listener, routes(Arc::new(shared)), of_server)) {
                eprintln!("warning: the page: {error}");
            }
            runtime.shutdown_background();
        })?;
        let model = std::thread::Builder::new().name("page model".to_owned()).spawn(move || {
            step_back();
            keep_up(model, &drain, &ordered, &board, &of_model);
        })?;
        Ok(Self { address, end, ending, threads: vec![server, model] })
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        self.end.notify_one();
        for thread in self.threads.drain(..) {
            // A panic was told on standard error.
            let _ = thread.join();
        }
    }
}

/// Behind everybody else; where that is not allowed nothing is lost but politeness.
fn step_back() {
    let _ = rustix::process::nice(10);
}

fn read_token(path: PathBuf) -> Result<String, PageError> {
    match std::fs::read_to_string(&path) {
        Ok(text) if text.trim().len() < SHORTEST_TOKEN => Err(PageError::WeakToken { path }),
        Ok(text) => Ok(text.trim().to_owned()),
        Err(source) => Err(PageError::Token { path, source }),
    }
}

fn keep_up(mut model: Model, drain: &Drain, ordered: &Receiver<Order>, board: &Board, ending: &AtomicBool) {
    let mut published: Option<Instant> = None;
    while !ending.load(Ordering::Relaxed) {
        loop {
            match drain.next() {
                Next::Event(stamped) => model.take(stamped),
                Next::Empty => break,
                // The last view stays up until the page is ended.
                Next::Ended => break,
            }
        }
        for order in ordered.try_iter() {
            model.order(order);
        }
        if published.is_none_or(|at| at.elapsed() >= PUBLISH_INTERVAL) {
            published = Some(Instant::now());
            model.missed(drain.dropped());
            model.publish(board);
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

#[cfg(test)]
pub(crate) mod tests;
