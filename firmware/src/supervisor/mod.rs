//! May the relays be closed? One pure function over the states of the restart interlock.
//!
//! ```text
//!              self-test passed,        no cause left                 valid reset
//!  SelfTest -----------------------> Stopped <=====> Interlocked ----------------> Darkness --+
//!      |        some cause holds       ^ ^  some cause                                |       | the dark laser
//!      |                               | +---- another cause, stripe seen, too long --+       | was seen dark
//!      |                               |                                                      v
//!      |                               +------------ another cause, too long ------------ Relighting
//!      |                               |                                                      | no cause left
//!      |                               |                    any cause, at once                v
//!      +--> Interlocked                +--------------------------------------------------- Running
//!        self-test passed, no cause holds
//!
//!  every state --fault--> Lockout (no way out but a power cycle)
//! ```
//!
//! Every step starts from "every cause to stop holds" and takes away what fresh evidence disproves; the relays are
//! closed only in `Running` and only if nothing is left. A stop needs one cause; permission needs every proof. There
//! is no way from power-up, from a watchdog's reset or from a stop to `Running` but a press of the reset button and
//! the test that follows it: the laser goes dark, and the sensor must see a cut stripe before it may see a whole one.

#[cfg(test)]
mod tests;

use crate::arming::DarkVerdict;
use crate::evidence::{DARK_CAUSES, Evidence, SCAN_CAUSES};
use crate::output_test::OutputVerdict;
use crate::relay::{Feedback, Permission};
use crate::selftest::Verdict;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::condition::{FaultCode, LaserMode, StateCode};
use nearfield_shared::limits::{ARMING_TIMEOUT, LINK_TIMEOUT};
use nearfield_shared::units::Micros;

/// The cause that a fault is shown as.
#[must_use]
pub const fn cause_of(fault: FaultCode) -> StopCause {
    match fault {
        FaultCode::Feedback => StopCause::Feedback,
        FaultCode::OutputStage => StopCause::OutputStage,
        FaultCode::RelayMemory | FaultCode::CriticalData => StopCause::CriticalData,
        FaultCode::SelfTest => StopCause::SelfTest,
    }
}

/// The restart interlock's states. `latched` = the causes since the last reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// After power-up or any reset of the chip: outputs and hardware are not proven yet.
    SelfTest {
        /// What is known from before (a watchdog's reset).
        latched: StopCauses,
    },
    /// Nothing speaks against running; waiting for the reset button.
    Interlocked {
        /// Why it stopped.
        latched: StopCauses,
    },
    /// The reset button was pressed; the laser is off, and the sensor must see it.
    Darkness {
        /// Why it stopped.
        latched: StopCauses,
        /// When the laser went dark.
        since: Micros,
    },
    /// The dark was seen; the laser is on again, and the sensor must see a whole stripe.
    Relighting {
        /// Why it stopped.
        latched: StopCauses,
        /// When the laser came back.
        since: Micros,
    },
    /// The relays are closed.
    Running,
    /// A cause holds.
    Stopped {
        /// Why it stopped.
        latched: StopCauses,
    },
    /// The relays are open for good.
    Lockout {
        /// Why.
        fault: FaultCode,
        /// The causes up to then.
        latched: StopCauses,
    },
}

impl State {
    /// Its name on the wire.
    #[must_use]
    pub const fn code(&self) -> StateCode {
        match self {
            Self::SelfTest { .. } => StateCode::SelfTest,
            Self::Interlocked { .. } => StateCode::Interlocked,
            Self::Darkness { .. } | Self::Relighting { .. } => StateCode::Arming,
            Self::Running => StateCode::Running,
            Self::Stopped { .. } => StateCode::Stopped,
            Self::Lockout { .. } => StateCode::Lockout,
        }
    }

    /// The causes since the last reset.
    #[must_use]
    pub const fn latched(&self) -> StopCauses {
        match self {
            Self::SelfTest { latched }
            | Self::Interlocked { latched }
            | Self::Darkness { latched, .. }
            | Self::Relighting { latched, .. }
            | Self::Stopped { latched } => *latched,
            Self::Running => StopCauses::NONE,
            Self::Lockout { fault, latched } => latched.with(cause_of(*fault)),
        }
    }

    /// The fault that locks it out.
    #[must_use]
    pub const fn fault(&self) -> Option<FaultCode> {
        match self {
            Self::Lockout { fault, .. } => Some(*fault),
            Self::SelfTest { .. }
            | Self::Interlocked { .. }
            | Self::Darkness { .. }
            | Self::Relighting { .. }
            | Self::Running
            | Self::Stopped { .. } => None,
        }
    }

    /// How the laser is driven in it.
    #[must_use]
    pub const fn laser(&self) -> LaserMode {
        match self {
            Self::Darkness { .. } => LaserMode::Dark,
            Self::Lockout { .. } => LaserMode::Off,
            Self::SelfTest { .. }
            | Self::Interlocked { .. }
            | Self::Relighting { .. }
            | Self::Running
            | Self::Stopped { .. } => LaserMode::Coded,
        }
    }

    /// All of it, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 2] {
        let (tag, since) = match self {
            Self::SelfTest { .. } => (0x0F, Micros::ZERO),
            Self::Interlocked { .. } => (0x33, Micros::ZERO),
            Self::Darkness { since, .. } => (0x3C, *since),
            Self::Relighting { since, .. } => (0x5A, *since),
            Self::Running => (0x55, Micros::ZERO),
            Self::Stopped { .. } => (0x69, Micros::ZERO),
            Self::Lockout { fault, .. } => (0xF0 | (u64::from(fault.code()) << 8), Micros::ZERO),
        };
        [tag | (u64::from(self.latched().bits()) << 32), since.get()]
    }
}

/// Everything that a step looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inputs {
    /// What the last accepted line-scan proves; its age is judged here.
    pub evidence: Option<Evidence>,
    /// Causes that the link holds against itself; none = healthy.
    pub link: StopCauses,
    /// Causes that came up since the last step, even if they have gone again.
    pub events: StopCauses,
    /// Contacts against commands.
    pub feedback: Feedback,
    /// Do the relay drivers follow their commands and test pulses?
    pub outputs: OutputVerdict,
    /// Is the relays' command in memory intact?
    pub command_intact: bool,
    /// Is everything else in memory intact that permission rests on?
    pub data_intact: bool,
    /// What the self-tests say.
    pub self_test: Verdict,
    /// What the dark pictures say, since the laser went dark.
    pub dark: DarkVerdict,
    /// Is the safety task on time and in order?
    pub flow_intact: bool,
    /// Is a valid rig in use?
    pub configured: bool,
    /// Is the reset button held for too long?
    pub button_stuck: bool,
    /// Has a valid press of the reset button just ended?
    pub reset: bool,
}

/// What a step decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Decision {
    /// Both relays closed? Everything else opens both.
    pub permission: Permission,
    /// The causes that hold now; empty exactly while the relays may be closed.
    pub live: StopCauses,
}

/// The causes that a step must see disproven, each by evidence of its own.
fn required() -> StopCauses {
    StopCause::ALL.into_iter().fold(StopCauses::NONE, StopCauses::with)
}

/// The causes that the inputs do not disprove. Starts from all of them.
fn standing(now: Micros, running: bool, inputs: &Inputs) -> StopCauses {
    let fresh = inputs.evidence.filter(|evidence| now.since(evidence.taken()) <= LINK_TIMEOUT);
    let disproven = fresh.map_or(StopCauses::NONE, |evidence| evidence.disproven());
    // Just after closing, the contacts are on their way; before closing they must be proven open.
    let contacts_follow = match inputs.feedback {
        Feedback::Agrees => true,
        Feedback::Settling => running,
        Feedback::Failed => false,
    };
    let mut standing = required();
    for cause in StopCause::ALL {
        let disproved = match cause {
            StopCause::StripeCut
            | StopCause::StripeMissing
            | StopCause::LargeObject
            | StopCause::Drop
            | StopCause::HostRequest
            | StopCause::Liveness
            | StopCause::Audit
            | StopCause::Misaligned
            | StopCause::Capability => disproven.contains(cause),
            StopCause::LinkTimeout => fresh.is_some() && !inputs.link.contains(cause),
            StopCause::LinkCorruption
            | StopCause::LinkFormat
            | StopCause::LinkSource
            | StopCause::LinkCalibration
            | StopCause::LinkRepetition
            | StopCause::LinkSequence
            | StopCause::LinkDelay => !inputs.link.contains(cause),
            StopCause::Feedback => contacts_follow,
            StopCause::OutputStage => inputs.outputs == OutputVerdict::Good,
            StopCause::ProgramFlow => inputs.flow_intact,
            StopCause::SelfTest => inputs.self_test == Verdict::Passed,
            StopCause::CriticalData => inputs.command_intact && inputs.data_intact,
            StopCause::Configuration => inputs.configured,
            StopCause::ResetButton => !inputs.button_stuck,
            // Held against a run by the states, not by an input: see `step`.
            StopCause::WatchdogReset | StopCause::Interlock | StopCause::DarkTest => true,
        };
        if disproved {
            standing = standing.without(cause);
        }
    }
    standing.union(inputs.events)
}

fn without_all(causes: StopCauses, others: StopCauses) -> StopCauses {
    others.iter().fold(causes, StopCauses::without)
}

/// What people are shown. Without a fresh line-scan its causes are unknown rather than present, and the link's own
/// cause says so; a contact that is on its way is no finding yet; a laser that is off on purpose is none at all.
fn shown(state: &State, standing: StopCauses, feedback: Feedback) -> StopCauses {
    let expected = match state {
        State::Darkness { .. } | State::Relighting { .. } => DARK_CAUSES,
        State::SelfTest { .. }
        | State::Interlocked { .. }
        | State::Running
        | State::Stopped { .. }
        | State::Lockout { .. } => StopCauses::NONE,
    };
    let unknown = if standing.contains(StopCause::LinkTimeout) { SCAN_CAUSES } else { expected };
    let known = without_all(standing, unknown);
    match feedback {
        Feedback::Settling => known.without(StopCause::Feedback),
        Feedback::Agrees | Feedback::Failed => known,
    }
}

/// One step of the supervisor: pure, total, and open unless every proof is there.
#[must_use]
pub fn step(state: State, now: Micros, inputs: &Inputs) -> (State, Decision) {
    let standing = standing(now, state == State::Running, inputs);
    let clear = standing.is_empty();
    let live = shown(&state, standing, inputs.feedback);
    let stopped = |latched: StopCauses| State::Stopped { latched: latched.union(live) };
    let next = match (fault_of(inputs), state) {
        (_, State::Lockout { .. }) => state,
        (Some(fault), _) => State::Lockout { fault, latched: state.latched().union(live) },
        (None, State::SelfTest { latched }) => match (is_proven(inputs), clear) {
            (false, _) => state,
            (true, true) => State::Interlocked { latched },
            (true, false) => stopped(latched),
        },
        (None, State::Interlocked { latched }) => match (clear, inputs.reset) {
            (true, true) => State::Darkness { latched, since: now },
            (true, false) => state,
            (false, _) => stopped(latched),
        },
        (None, State::Darkness { latched, since }) => {
            let failed = State::Stopped { latched: latched.union(live).with(StopCause::DarkTest) };
            match (without_all(standing, DARK_CAUSES).is_empty(), inputs.dark) {
                (false, _) => stopped(latched),
                (true, DarkVerdict::Proven) => State::Relighting { latched, since: now },
                (true, DarkVerdict::Denied) => failed,
                (true, DarkVerdict::Waiting) if now.since(since) > ARMING_TIMEOUT => failed,
                (true, DarkVerdict::Waiting) => state,
            }
        }
        (None, State::Relighting { latched, since }) => {
            let relit = inputs.evidence.is_some_and(|evidence| evidence.taken() >= since);
            if clear && relit {
                State::Running
            } else if !without_all(standing, DARK_CAUSES).is_empty() {
                stopped(latched)
            } else if now.since(since) > ARMING_TIMEOUT {
                State::Stopped { latched: latched.union(standing) }
            } else {
                state
            }
        }
        (None, State::Running) => {
            if clear {
                State::Running
            } else {
                stopped(StopCauses::NONE)
            }
        }
        (None, State::Stopped { latched }) => {
            if clear {
                State::Interlocked { latched }
            } else {
                stopped(latched)
            }
        }
    };
    (next, decide(&next, clear, live))
}

/// Are the outputs and the hardware proven, as far as the start demands?
fn is_proven(inputs: &Inputs) -> bool {
    inputs.feedback == Feedback::Agrees
        && inputs.outputs == OutputVerdict::Good
        && inputs.self_test == Verdict::Passed
}

fn fault_of(inputs: &Inputs) -> Option<FaultCode> {
    if !inputs.command_intact {
        return Some(FaultCode::RelayMemory);
    }
    if !inputs.data_intact {
        return Some(FaultCode::CriticalData);
    }
    match (inputs.feedback, inputs.outputs, inputs.self_test) {
        (Feedback::Failed, _, _) => Some(FaultCode::Feedback),
        (_, OutputVerdict::Failed, _) => Some(FaultCode::OutputStage),
        (_, _, Verdict::Failed(_)) => Some(FaultCode::SelfTest),
        (
            Feedback::Agrees | Feedback::Settling,
            OutputVerdict::Good | OutputVerdict::Pending,
            Verdict::Passed | Verdict::Pending,
        ) => None,
    }
}

fn decide(state: &State, clear: bool, live: StopCauses) -> Decision {
    let open = |live| Decision { permission: Permission::DENIED, live };
    match state {
        State::Running if clear => Decision { permission: Permission::GRANTED, live },
        State::Running => open(live),
        State::SelfTest { .. } => open(live.with(StopCause::SelfTest)),
        State::Interlocked { .. } | State::Darkness { .. } | State::Relighting { .. } => {
            open(live.with(StopCause::Interlock))
        }
        State::Stopped { .. } => open(live.with_if(StopCause::Interlock, live.is_empty())),
        State::Lockout { fault, .. } => open(live.with(cause_of(*fault))),
    }
}
