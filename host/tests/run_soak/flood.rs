//! Many clients at once, in a process of their own.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

const ADDRESS: &str = "NEARFIELD_SOAK_ADDRESS";
const CLIENTS: &str = "NEARFIELD_SOAK_CLIENTS";
/// What the clients' process prints when it is asked to end.
const SUM: &str = "sum";

/// The process.
pub struct Clients(Child);

impl Clients {
    /// So many, as fast as they can, each with its own connection for every request.
    pub fn start(address: &str, clients: usize) -> Self {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "clients", "--ignored", "--nocapture"])
            .env(ADDRESS, address)
            .env(CLIENTS, clients.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self(child)
    }

    /// Requests answered, and turned away.
    pub fn end(&mut self) -> (u64, u64) {
        // The end of its input ends it.
        drop(self.0.stdin.take());
        let mut text = String::new();
        self.0.stdout.take().unwrap().read_to_string(&mut text).unwrap();
        self.0.wait().unwrap();
        let line = text.lines().find_map(|line| line.split_once(SUM)).expect("the clients give no sum").1;
        let mut numbers = line.split_whitespace().map(|word| word.parse().unwrap());
        (numbers.next().unwrap(), numbers.next().unwrap())
    }
}

/// In that process: until its input ends.
pub fn be_the_clients() {
    let (Ok(address), Ok(clients)) = (std::env::var(ADDRESS), std::env::var(CLIENTS)) else { return };
    let answered = Arc::new(AtomicU64::new(0));
    let turned_away = Arc::new(AtomicU64::new(0));
    for _ in 0..clients.parse::<usize>().unwrap() {
        let (address, answered, turned_away) =
            (address.clone(), Arc::clone(&answered), Arc::clone(&turned_away));
        std::thread::spawn(move || {
            loop {
                let served =
                    get(&address, "/api/live").is_ok_and(|answer| answer.starts_with("HTTP/1.1 200"));
                if served { &answered } else { &turned_away }.fetch_add(1, Ordering::Relaxed);
            }
        });
    }
    let mut nothing = Vec::new();
    std::io::stdin().read_to_end(&mut nothing).unwrap();
    println!("{SUM} {} {}", answered.load(Ordering::Relaxed), turned_away.load(Ordering::Relaxed));
}

pub fn get(address: &str, path: &str) -> std::io::Result<String> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(Duration::from_secs(30)))?;
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n").as_bytes())?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}
