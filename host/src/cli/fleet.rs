//! `nearfield fleet`: who may drive, who stands and why, who is lost.

use std::io::{IsTerminal as _, Write as _};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::Args;
use nearfield_fleet::carrier::{UdpCarrier, UdpInbox};
use nearfield_fleet::outlet::run_of_now;
use nearfield_fleet::simulated::{self, Fleet as Simulated};
use nearfield_fleet::{Carrier, Filter, Inbox, Roster, Verdict, View};
use serde::Serialize;

/// A table of robots, the worst first: each has the worst verdict of its modules; who is silent for a second is lost.
///
/// Modules report to it where their configuration says so (section `fleet`). It shows and never sends: the relays stop the robots,
/// whoever looks. On a terminal the table is drawn anew twice a second; otherwise each drawing follows the last one.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield fleet --listen 0.0.0.0:8035                    all robots that report to this computer
  nearfield fleet --simulate 1000 --seconds 20             a made-up fleet, and what the view of it costs
  nearfield fleet --state lost,stop --find amr-00          some of them
  nearfield fleet --json | jq -c '.rows[] | select(.verdict == \"lost\") | .robot'")]
pub struct Fleet {
    /// Where reports come in (UDP).
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8035")]
    listen: SocketAddr,
    /// Over zenoh instead: listen there, for instance tcp/0.0.0.0:7447; may be given several times. "scout" looks for neighbours.
    #[arg(long, value_name = "ENDPOINT")]
    zenoh: Vec<String>,
    /// So many made-up modules report, over the same carrier, from this process.
    #[arg(long, value_name = "MODULES", value_parser = clap::value_parser!(u32).range(1..=8192))]
    simulate: Option<u32>,
    /// Only robots with these verdicts: go, warn, stop, unknown, lost.
    #[arg(long, value_name = "VERDICT,...", value_delimiter = ',', value_parser = verdict)]
    state: Vec<Verdict>,
    /// Only robots with this in their name, in a module's name that matters, or in a cause.
    #[arg(long, value_name = "TEXT", default_value = "")]
    find: String,
    /// Robots on a page.
    #[arg(long, value_name = "N", default_value_t = 40)]
    rows: usize,
    /// Which page, from 1.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    page: u32,
    /// End after so long; without it, on a signal.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// One JSON object a drawing, and one at the end.
    #[arg(long)]
    json: bool,
}

/// The table is drawn so often.
const DRAW_INTERVAL: Duration = Duration::from_millis(500);
/// Simulated reports are sent in so many parts of a report interval.
const SLICES: usize = 20;
/// Clears the screen and goes to its beginning.
const CLEAR: &str = "\x1b[2J\x1b[H";

fn verdict(name: &str) -> Result<Verdict, String> {
    let found = Verdict::ALL.into_iter().find(|verdict| verdict.name() == name);
    found.ok_or_else(|| "one of go, warn, stop, unknown, lost".to_owned())
}

/// What the view has cost.
#[derive(Debug, Serialize)]
struct Cost {
    /// Reports believed.
    reports: u64,
    /// Not a report; not newer than what was known; no room.
    refused: [u64; 3],
    seconds: f64,
    /// Processor time of this process, per cent of one core: with --simulate, of the modules too.
    cpu_percent: f64,
    /// Of that, the listener's thread alone.
    listener_cpu_percent: f64,
    /// Resident memory, MiB.
    memory_mib: f64,
}

/// The listener, and what simulated modules send with.
struct Ends {
    inbox: Box<dyn Inbox>,
    modules: Option<Box<dyn Carrier>>,
}

impl Fleet {
    /// Watches until the end.
    ///
    /// # Errors
    /// The address cannot be used, or zenoh is not built in.
    pub fn run(&self) -> anyhow::Result<u8> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot watch for signals")?;
        }
        let Ends { mut inbox, modules } = self.open()?;
        let simulation = match (self.simulate, modules) {
            (Some(count), Some(carrier)) => Some(simulate(count as usize, carrier, Arc::clone(&stop))?),
            _ => None,
        };
        let begun = Instant::now();
        let before = (process_time(), thread_time());
        let mut roster = Roster::default();
        let end = self.seconds.map(Duration::from_secs_f64);
        let filter = Filter { verdicts: self.state.clone(), text: self.find.clone() };
        while !stop.load(Ordering::Relaxed) && end.is_none_or(|end| begun.elapsed() < end) {
            let draw_at = Instant::now() + DRAW_INTERVAL;
            while let Some(wait) =
                draw_at.checked_duration_since(Instant::now()).filter(|wait| !wait.is_zero())
            {
                // What is no report is counted by the roster.
                inbox.receive(wait, &mut |bytes| {
                    let _ = roster.take(bytes, Instant::now());
                })?;
            }
            self.draw(&View::of(&roster, &filter, Instant::now(), self.page as usize - 1, self.rows))?;
        }
        let seconds = begun.elapsed().as_secs_f64();
        let share = |spent: f64| 100.0 * spent / seconds;
        let refused = roster.refused();
        let cost = Cost {
            reports: roster.taken(),
            refused: [refused.malformed, refused.late, refused.overflow],
            seconds,
            cpu_percent: share(process_time() - before.0),
            listener_cpu_percent: share(thread_time() - before.1),
            memory_mib: memory_mib(),
        };
        stop.store(true, Ordering::Relaxed);
        if let Some(simulation) = simulation {
            // A panic was told on standard error.
            let _ = simulation.join();
        }
        self.tell(&cost)
    }

    fn draw(&self, view: &View) -> anyhow::Result<()> {
        if self.json {
            say!("{}", serde_json::to_string(view)?);
        } else {
            let clear = if std::io::stdout().is_terminal() { CLEAR } else { "" };
            say!("{clear}{}", view.text());
        }
        std::io::stdout().flush().context("standard output")
    }

    fn tell(&self, cost: &Cost) -> anyhow::Result<u8> {
        if self.json {
            say!("{}", serde_json::to_string(cost)?);
        } else {
            say!(
                "{} reports in {:.1} s, refused {:?} (malformed, late, no room); processor {:.1} % of a core, of it {:.1} % \
                 the listener; {:.1} MiB",
                cost.reports,
                cost.seconds,
                cost.refused,
                cost.cpu_percent,
                cost.listener_cpu_percent,
                cost.memory_mib
            );
        }
        Ok(0)
    }

    fn open(&self) -> anyhow::Result<Ends> {
        if !self.zenoh.is_empty() {
            return self.open_zenoh();
        }
        let inbox = UdpInbox::new(self.listen)?;
        let modules: Option<Box<dyn Carrier>> = match self.simulate {
            Some(_) => Some(Box::new(UdpCarrier::new(inbox.address())?)),
            None => None,
        };
        Ok(Ends { inbox: Box::new(inbox), modules })
    }

    #[cfg(feature = "zenoh")]
    fn open_zenoh(&self) -> anyhow::Result<Ends> {
        use nearfield_fleet::zenoh_carrier::{Settings, ZenohCarrier, ZenohInbox};
        let listen: Vec<String> = self.zenoh.iter().filter(|one| *one != "scout").cloned().collect();
        let scout = self.zenoh.len() > listen.len();
        let inbox = ZenohInbox::new(&Settings { listen: listen.clone(), connect: Vec::new(), scout })?;
        let modules: Option<Box<dyn Carrier>> = match self.simulate {
            Some(_) => {
                Some(Box::new(ZenohCarrier::new(&Settings { listen: Vec::new(), connect: listen, scout })?))
            }
            None => None,
        };
        Ok(Ends { inbox: Box::new(inbox), modules })
    }

    #[cfg(not(feature = "zenoh"))]
    fn open_zenoh(&self) -> anyhow::Result<Ends> {
        anyhow::bail!(
            "this program was built without zenoh; build it with `--features zenoh`, or use --listen"
        )
    }
}

/// Made-up modules, from a thread of their own.
fn simulate(
    count: usize,
    mut carrier: Box<dyn Carrier>,
    stop: Arc<AtomicBool>,
) -> anyhow::Result<std::thread::JoinHandle<()>> {
    let mut fleet = Simulated::new(count, 1, run_of_now());
    let work = move || {
        let begun = Instant::now();
        let mut due = begun;
        for slice in (0..SLICES).cycle() {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            for report in fleet.reports(begun.elapsed(), slice, SLICES) {
                // As for a real module: what cannot be sent is followed by the next.
                let _ = carrier.send(&report);
            }
            due += simulated::pace(SLICES);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
    };
    std::thread::Builder::new().name("simulated".to_owned()).spawn(work).context("no thread")
}

/// Processor time of the calling thread, seconds; 0 where Linux does not tell.
fn thread_time() -> f64 {
    on_processor(std::path::Path::new("/proc/thread-self/schedstat"))
}

/// Processor time of all threads that are there now, seconds.
fn process_time() -> f64 {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    threads.map(|thread| on_processor(&thread.path().join("schedstat"))).sum()
}

/// The first figure: nanoseconds on a processor.
fn on_processor(file: &std::path::Path) -> f64 {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    text.split_whitespace().next().and_then(|first| first.parse::<f64>().ok()).unwrap_or(0.0) / 1e9
}

/// Resident memory, MiB; 0 where Linux does not tell.
fn memory_mib() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}
