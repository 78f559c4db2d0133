//! May the relays be closed? One pure function over the states of the restart interlock.
//!
//! ```text
//!              self-test passed,        no cause left                   valid reset
//!  SelfTest -----------------------> Stopped <=====> Interlocked ------------------> Running
//!      |        some cause holds        ^  some cause                                  |
//!      |                                +----------------------------------------------+
//!      +--> Interlocked                                   any cause, at once
//!        self-test passed, no cause holds
//!
//!  every state --fault--> Lockout (no way out but a power cycle)
//! ```
//!
//! Every step starts from "every cause to stop holds" and takes away what fresh evidence disproves; the relays are
//! closed only in `Running` and only if nothing is left. A stop needs one cause; permission needs every proof. There
//! is no way from power-up, from a watchdog's reset or from a stop to `Running` but a press of the reset button.

use crate::evidence::{Evidence, SCAN_CAUSES};
use crate::relay::Feedback;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::limits::LINK_TIMEOUT;
use nearfield_shared::status::StateCode;
use nearfield_shared::units::Micros;

/// A fault of the controller or its outputs that only service removes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A contact does not follow its command: welded, stuck, or its wire is broken.
    Feedback,
    /// The relays' command in memory was damaged.
    RelayMemory,
}

impl Fault {
    /// The cause that it is shown as.
    #[must_use]
    pub const fn cause(self) -> StopCause {
        match self {
            Self::Feedback => StopCause::Feedback,
            Self::RelayMemory => StopCause::SelfTest,
        }
    }
}

/// The restart interlock's states. `latched` = the causes since the last reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// After power-up or any reset of the chip: the outputs are not proven open yet.
    SelfTest {
        /// What is known from before (a watchdog's reset).
        latched: StopCauses,
    },
    /// Nothing speaks against running; waiting for the reset button.
    Interlocked {
        /// Why it stopped.
        latched: StopCauses,
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
        fault: Fault,
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
            Self::Running => StateCode::Running,
            Self::Stopped { .. } => StateCode::Stopped,
            Self::Lockout { .. } => StateCode::Lockout,
        }
    }

    /// The causes since the last reset.
    #[must_use]
    pub const fn latched(&self) -> StopCauses {
        match self {
            Self::SelfTest { latched } | Self::Interlocked { latched } | Self::Stopped { latched } => {
                *latched
            }
            Self::Running => StopCauses::NONE,
            Self::Lockout { fault, latched } => latched.with(fault.cause()),
        }
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
    /// Is the relays' command in memory intact?
    pub command_intact: bool,
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
    pub close_relays: bool,
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
            | StopCause::HostRequest => disproven.contains(cause),
            StopCause::LinkTimeout => fresh.is_some() && !inputs.link.contains(cause),
            StopCause::LinkCorruption
            | StopCause::LinkFormat
            | StopCause::LinkSource
            | StopCause::LinkCalibration
            | StopCause::LinkRepetition
            | StopCause::LinkSequence
            | StopCause::LinkDelay => !inputs.link.contains(cause),
            StopCause::Feedback => contacts_follow,
            StopCause::ProgramFlow => inputs.flow_intact,
            StopCause::SelfTest => inputs.command_intact,
            StopCause::Configuration => inputs.configured,
            StopCause::ResetButton => !inputs.button_stuck,
            // Held against a run by the states, not by an input: see `step`.
            StopCause::WatchdogReset | StopCause::Interlock => true,
        };
        if disproved {
            standing = standing.without(cause);
        }
    }
    standing.union(inputs.events)
}

/// What people are shown. Without a fresh line-scan its causes are unknown rather than present, and the link's own
/// cause says so; a contact that is on its way is no finding yet.
fn shown(standing: StopCauses, feedback: Feedback) -> StopCauses {
    let known = if standing.contains(StopCause::LinkTimeout) {
        SCAN_CAUSES.iter().fold(standing, StopCauses::without)
    } else {
        standing
    };
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
    let live = shown(standing, inputs.feedback);
    let stopped = |latched: StopCauses| State::Stopped { latched: latched.union(live) };
    let next = match (fault_of(inputs), state) {
        (_, State::Lockout { .. }) => state,
        (Some(fault), _) => State::Lockout { fault, latched: state.latched().union(live) },
        (None, State::SelfTest { latched }) => match inputs.feedback {
            Feedback::Settling | Feedback::Failed => state,
            Feedback::Agrees if clear => State::Interlocked { latched },
            Feedback::Agrees => stopped(latched),
        },
        (None, State::Interlocked { latched }) => match (clear, inputs.reset) {
            (true, true) => State::Running,
            (true, false) => state,
            (false, _) => stopped(latched),
        },
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

fn fault_of(inputs: &Inputs) -> Option<Fault> {
    match (inputs.command_intact, inputs.feedback) {
        (false, _) => Some(Fault::RelayMemory),
        (true, Feedback::Failed) => Some(Fault::Feedback),
        (true, Feedback::Agrees | Feedback::Settling) => None,
    }
}

fn decide(state: &State, clear: bool, live: StopCauses) -> Decision {
    let open = |live| Decision { close_relays: false, live };
    match state {
        State::Running => Decision { close_relays: clear, live },
        State::SelfTest { .. } => open(live.with(StopCause::SelfTest)),
        State::Interlocked { .. } => open(live.with(StopCause::Interlock)),
        State::Stopped { .. } => open(live.with_if(StopCause::Interlock, live.is_empty())),
        State::Lockout { fault, .. } => open(live.with(fault.cause())),
    }
}
