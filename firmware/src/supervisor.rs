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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Judge;
    use nearfield_shared::linescan::HostVerdict;
    use nearfield_shared::monitor::StripeReport;

    const NOW: Micros = Micros::from_millis(1_000);
    const OLD: StopCauses = StopCauses::NONE.with(StopCause::LinkDelay);

    /// Evidence that disproves everything, taken at this time.
    fn evidence_at(taken: Micros) -> Evidence {
        let whole = StripeReport { watched_columns: 9, ..StripeReport::default() };
        let whole = StripeReport {
            cutoff: nearfield_shared::cutoff::Cutoff { floor_columns: 9, ..whole.cutoff },
            ..whole
        };
        let mut judge = Judge::new();
        judge.judge(taken, &whole, HostVerdict::Clear);
        let evidence = judge.judge(taken, &whole, HostVerdict::Clear);
        assert_eq!(evidence.disproven(), SCAN_CAUSES);
        evidence
    }

    /// Evidence that leaves these scan causes standing.
    fn evidence_but(cause: StopCause) -> Evidence {
        let mut judge = Judge::new();
        let report = StripeReport { watched_columns: 9, ..StripeReport::default() };
        let evidence = judge.judge(NOW, &report, HostVerdict::Stop);
        assert!(evidence.standing().contains(cause));
        evidence
    }

    /// Everything speaks for running.
    fn good() -> Inputs {
        Inputs {
            evidence: Some(evidence_at(NOW)),
            link: StopCauses::NONE,
            events: StopCauses::NONE,
            feedback: Feedback::Agrees,
            command_intact: true,
            flow_intact: true,
            configured: true,
            button_stuck: false,
            reset: false,
        }
    }

    fn after(state: State, inputs: &Inputs) -> State {
        step(state, NOW, inputs).0
    }

    fn reset() -> Inputs {
        Inputs { reset: true, ..good() }
    }

    /// Every single way in which the inputs can fall short, and its cause.
    fn shortfalls() -> Vec<(StopCause, Inputs)> {
        let mut all: Vec<_> = [
            (StopCause::LinkTimeout, Inputs { evidence: None, ..good() }),
            (StopCause::Feedback, Inputs { events: StopCauses::NONE.with(StopCause::Feedback), ..good() }),
            (StopCause::ProgramFlow, Inputs { flow_intact: false, ..good() }),
            (StopCause::Configuration, Inputs { configured: false, ..good() }),
            (StopCause::ResetButton, Inputs { button_stuck: true, ..good() }),
        ]
        .into();
        for cause in [
            StopCause::LinkTimeout,
            StopCause::LinkCorruption,
            StopCause::LinkFormat,
            StopCause::LinkSource,
            StopCause::LinkCalibration,
            StopCause::LinkRepetition,
            StopCause::LinkSequence,
            StopCause::LinkDelay,
        ] {
            all.push((cause, Inputs { link: StopCauses::NONE.with(cause), ..good() }));
        }
        for cause in [StopCause::StripeMissing, StopCause::Drop, StopCause::HostRequest] {
            all.push((cause, Inputs { evidence: Some(evidence_but(cause)), ..good() }));
        }
        for cause in StopCause::ALL {
            all.push((cause, Inputs { events: StopCauses::NONE.with(cause), ..good() }));
        }
        all
    }

    #[test]
    fn self_test_to_interlocked_when_nothing_speaks_against_it() {
        let start = State::SelfTest { latched: OLD };
        assert_eq!(after(start, &good()), State::Interlocked { latched: OLD });
        assert_eq!(after(start, &reset()), State::Interlocked { latched: OLD }, "no way past the interlock");
    }

    #[test]
    fn self_test_waits_for_the_contacts() {
        let start = State::SelfTest { latched: OLD };
        assert_eq!(after(start, &Inputs { feedback: Feedback::Settling, ..good() }), start);
    }

    #[test]
    fn self_test_to_stopped_while_a_cause_holds() {
        let start = State::SelfTest { latched: OLD };
        for (cause, inputs) in shortfalls() {
            assert_eq!(after(start, &inputs).code(), StateCode::Stopped, "{cause:?}");
        }
    }

    #[test]
    fn interlocked_to_running_by_a_reset_and_by_nothing_else() {
        let waiting = State::Interlocked { latched: OLD };
        assert_eq!(after(waiting, &good()), waiting);
        assert_eq!(after(waiting, &reset()), State::Running);
        for (cause, inputs) in shortfalls() {
            let next = after(waiting, &Inputs { reset: true, ..inputs });
            assert_eq!(next.code(), StateCode::Stopped, "{cause:?}: a reset does not outvote it");
        }
        let settling = Inputs { feedback: Feedback::Settling, ..reset() };
        assert_eq!(after(waiting, &settling).code(), StateCode::Stopped, "contacts not proven open");
    }

    #[test]
    fn running_to_stopped_by_every_single_cause() {
        assert_eq!(after(State::Running, &good()), State::Running);
        for (cause, inputs) in shortfalls() {
            let (next, decision) = step(State::Running, NOW, &inputs);
            assert_eq!(next.code(), StateCode::Stopped, "{cause:?}");
            assert!(next.latched().contains(cause) && decision.live.contains(cause), "{cause:?}");
            assert!(!decision.close_relays, "{cause:?}");
        }
    }

    #[test]
    fn running_may_close_contacts_that_have_not_followed_yet() {
        let settling = Inputs { feedback: Feedback::Settling, ..good() };
        assert!(step(State::Running, NOW, &settling).1.close_relays);
    }

    #[test]
    fn stopped_to_interlocked_when_the_last_cause_has_gone_and_never_to_running() {
        let stopped = State::Stopped { latched: OLD };
        assert_eq!(after(stopped, &good()), State::Interlocked { latched: OLD });
        assert_eq!(after(stopped, &reset()), State::Interlocked { latched: OLD });
        for (cause, inputs) in shortfalls() {
            let next = after(stopped, &Inputs { reset: true, ..inputs });
            assert_eq!(next.code(), StateCode::Stopped, "{cause:?}");
            assert!(next.latched().contains(StopCause::LinkDelay), "the first cause is kept");
        }
    }

    #[test]
    fn contacts_that_are_on_their_way_delay_the_interlock_without_being_blamed() {
        let settling = Inputs { feedback: Feedback::Settling, ..good() };
        let (next, decision) = step(State::Stopped { latched: OLD }, NOW, &settling);
        assert_eq!(next, State::Stopped { latched: OLD });
        assert_eq!(decision.live, StopCauses::NONE.with(StopCause::Interlock));
    }

    #[test]
    fn every_state_to_lockout_by_a_fault_and_no_way_out() {
        let faults = [
            (Fault::Feedback, Inputs { feedback: Feedback::Failed, ..good() }),
            (Fault::RelayMemory, Inputs { command_intact: false, ..good() }),
        ];
        let states = [
            State::SelfTest { latched: OLD },
            State::Interlocked { latched: OLD },
            State::Running,
            State::Stopped { latched: OLD },
        ];
        for (fault, inputs) in faults {
            for state in states {
                let (locked, decision) = step(state, NOW, &Inputs { reset: true, ..inputs });
                assert!(matches!(locked, State::Lockout { fault: found, .. } if found == fault));
                assert!(!decision.close_relays && decision.live.contains(fault.cause()));
                assert!(locked.latched().contains(fault.cause()));
                assert_eq!(after(locked, &good()), locked);
                assert_eq!(after(locked, &reset()), locked);
                assert!(!step(locked, NOW, &reset()).1.close_relays);
            }
        }
    }

    #[test]
    fn evidence_counts_until_the_link_times_out() {
        let taken = Micros::from_millis(500);
        for (change, running) in [(-1, true), (0, true), (1, false)] {
            let now = Micros::new(taken.plus(LINK_TIMEOUT).get().saturating_add_signed(change));
            let inputs = Inputs { evidence: Some(evidence_at(taken)), ..good() };
            assert_eq!(step(State::Running, now, &inputs).1.close_relays, running, "{change}");
        }
        let future = Inputs { evidence: Some(evidence_at(NOW.plus(Micros::new(1)))), ..good() };
        assert!(
            !step(State::Running, NOW, &future).1.close_relays,
            "evidence from the future proves nothing"
        );
    }

    #[test]
    fn relays_are_closed_exactly_when_no_cause_is_shown() {
        for state in [State::Running, State::Interlocked { latched: OLD }, State::Stopped { latched: OLD }] {
            for (_, inputs) in
                shortfalls().into_iter().chain([(StopCause::Drop, good()), (StopCause::Drop, reset())])
            {
                let decision = step(state, NOW, &inputs).1;
                assert_eq!(decision.close_relays, decision.live.is_empty(), "{state:?} {inputs:?}");
            }
        }
    }

    #[test]
    fn without_a_fresh_line_scan_its_causes_are_not_guessed() {
        let decision = step(State::Running, NOW, &Inputs { evidence: None, ..good() }).1;
        assert_eq!(decision.live, StopCauses::NONE.with(StopCause::LinkTimeout));
    }
}
