//! systemd: readiness, a line of state, and its watchdog. Without systemd nothing happens.

use std::time::{Duration, Instant};

/// Tells the service manager.
#[derive(Debug)]
pub struct ServiceManager {
    /// Half of what the manager's watchdog grants.
    interval: Option<Duration>,
    last: Instant,
}

impl ServiceManager {
    /// Finds out whether the manager watches.
    #[must_use]
    pub fn new() -> Self {
        Self { interval: system::watchdog().map(|longest| longest / 2), last: Instant::now() }
    }

    /// Does its watchdog watch?
    #[must_use]
    pub const fn is_watched(&self) -> bool {
        self.interval.is_some()
    }

    /// The work has begun: the first picture went through.
    pub fn ready(&mut self) {
        system::tell(system::Message::Ready);
        self.last = Instant::now();
    }

    /// Called in every turn of the work's own loop, whatever pictures do: a loop that hangs is restarted. At most twice as
    /// often as needed, it goes out, with a line of state.
    pub fn alive(&mut self, state: impl FnOnce() -> String) {
        if self.interval.is_some_and(|interval| self.last.elapsed() >= interval) {
            self.last = Instant::now();
            system::tell(system::Message::Alive(state()));
        }
    }

    /// The end, wanted.
    pub fn stopping(&self) {
        system::tell(system::Message::Stopping);
    }
}

impl Default for ServiceManager {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(target_os = "linux")]
mod system {
    use sd_notify::NotifyState;
    use std::time::Duration;

    pub enum Message {
        Ready,
        Alive(String),
        Stopping,
    }

    pub fn watchdog() -> Option<Duration> {
        sd_notify::watchdog_enabled()
    }

    pub fn tell(message: Message) {
        // A manager that cannot be told restarts the service, which is what it is for.
        let _ = match message {
            Message::Ready => sd_notify::notify(&[NotifyState::Ready]),
            Message::Alive(state) => sd_notify::notify(&[NotifyState::Watchdog, NotifyState::Status(&state)]),
            Message::Stopping => sd_notify::notify(&[NotifyState::Stopping]),
        };
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    pub enum Message {
        Ready,
        Alive(String),
        Stopping,
    }

    pub fn watchdog() -> Option<std::time::Duration> {
        None
    }

    pub fn tell(_: Message) {}
}
