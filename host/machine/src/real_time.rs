//! What the stripe's path asks of the operating system, and what it was given.

use nearfield_configuration::RealTime;

/// Something that was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Asked {
    /// What.
    pub what: String,
    /// Why it was refused and what to do; `None` = granted.
    pub refused: Option<String>,
}

impl Asked {
    fn new(what: impl Into<String>, outcome: Result<(), String>) -> Self {
        Self { what: what.into(), refused: outcome.err() }
    }
}

impl std::fmt::Display for Asked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.refused {
            None => write!(f, "{}: granted", self.what),
            Some(why) => write!(f, "{}: not allowed: {why}", self.what),
        }
    }
}

/// Asks for the calling thread; threads that it starts later inherit priority and cores. Start those that must not before.
#[must_use]
pub fn ask(wanted: &RealTime) -> Vec<Asked> {
    let mut asked = Vec::new();
    if wanted.lock_memory {
        asked.push(Asked::new("memory locked", system::lock_memory()));
    }
    if !wanted.cores.is_empty() {
        let cores: Vec<String> = wanted.cores.iter().map(u32::to_string).collect();
        let what = format!("bound to core {}", cores.join(", "));
        asked.push(Asked::new(what, system::bind(&wanted.cores)));
    }
    if wanted.priority > 0 {
        let what = format!("SCHED_FIFO, priority {}", wanted.priority);
        asked.push(Asked::new(what, system::first_in_first_out(wanted.priority)));
    }
    asked
}

/// Lowers the calling thread beneath everybody else: recorder, page, pictures for people.
pub fn step_back() {
    // Where it is refused, nothing is lost but politeness.
    let _ = rustix::process::nice(10);
}

#[cfg(target_os = "linux")]
mod system {
    use rustix::mm::MlockAllFlags;
    use rustix::process::{Resource, getrlimit};
    use rustix::thread::{CpuSet, sched_setaffinity};
    use thread_priority::unix::set_thread_priority_and_policy;
    use thread_priority::{
        RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
        thread_native_id,
    };

    /// Pages are locked when they are first touched, now and in future.
    pub fn lock_memory() -> Result<(), String> {
        // With a limit, a later allocation beyond it would end the program: better not to begin.
        if getrlimit(Resource::Memlock).current.is_some() {
            return Err("the limit for locked memory is too low; LimitMEMLOCK=infinity in the service, \
                        or `ulimit -l unlimited`"
                .to_owned());
        }
        let flags = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
        rustix::mm::mlockall(flags).map_err(|error| format!("{error}; LimitMEMLOCK=infinity in the service"))
    }

    pub fn bind(cores: &[u32]) -> Result<(), String> {
        let mut set = CpuSet::new();
        for core in cores {
            let core = *core as usize;
            if core >= CpuSet::MAX_CPU {
                return Err(format!("there is no core {core}; change real_time.cores"));
            }
            set.set(core);
        }
        sched_setaffinity(None, &set).map_err(|error| format!("{error}; change real_time.cores"))
    }

    pub fn first_in_first_out(priority: u32) -> Result<(), String> {
        let help = "LimitRTPRIO=99 in the service, or `ulimit -r 99`";
        let value = u8::try_from(priority).ok().and_then(|value| ThreadPriorityValue::try_from(value).ok());
        let value = value.ok_or_else(|| format!("{priority} is no priority; change real_time.priority"))?;
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy)
            .map_err(|error| format!("{error}; {help}"))
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    const NOT_HERE: &str = "only Linux is asked";

    pub fn lock_memory() -> Result<(), String> {
        Err(NOT_HERE.to_owned())
    }

    pub fn bind(_: &[u32]) -> Result<(), String> {
        Err(NOT_HERE.to_owned())
    }

    pub fn first_in_first_out(_: u32) -> Result<(), String> {
        Err(NOT_HERE.to_owned())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn nothing_is_asked_that_was_not_configured() {
        assert!(ask(&RealTime { priority: 0, cores: Vec::new(), lock_memory: false }).is_empty());
    }

    /// Granted or refused depends on who runs the test; that it is said, and how to change it, does not.
    #[test]
    fn every_answer_is_told_and_a_refusal_says_what_to_do() {
        let wanted = RealTime { priority: 60, cores: vec![0], lock_memory: false };
        let asked = std::thread::spawn(move || ask(&wanted)).join().unwrap();
        assert_eq!(asked.len(), 2);
        assert_eq!(asked[0].what, "bound to core 0");
        for one in &asked {
            assert!(one.refused.as_ref().is_none_or(|why| why.contains(';')), "{one}");
        }
    }

    #[test]
    fn a_core_that_is_not_there_is_refused() {
        let wanted = RealTime { priority: 0, cores: vec![100_000], lock_memory: false };
        let asked = std::thread::spawn(move || ask(&wanted)).join().unwrap();
        assert!(asked[0].to_string().contains("real_time.cores"), "{}", asked[0]);
    }
}
