//! Each arrow of the transition diagram, each cause, each limit on both sides.

use super::*;
use crate::evidence::{Assent, Judge};
use crate::selftest::SelfTestKind;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::monitor::StripeReport;

const NOW: Micros = Micros::from_millis(1_000);
const OLD: StopCauses = StopCauses::NONE.with(StopCause::LinkDelay);

const fn assent(yes: bool) -> Assent {
    Assent { live: yes, believed: yes, aligned: yes, capable: yes }
}

/// Evidence that disproves everything, taken at this time.
fn evidence_at(taken: Micros) -> Evidence {
    let whole = StripeReport { watched_columns: 9, ..StripeReport::default() };
    let whole = StripeReport {
        cutoff: nearfield_shared::cutoff::Cutoff { floor_columns: 9, ..whole.cutoff },
        ..whole
    };
    let mut judge = Judge::new();
    judge.judge(taken, &whole, HostVerdict::Clear, assent(true));
    let evidence = judge.judge(taken, &whole, HostVerdict::Clear, assent(true));
    assert_eq!(evidence.disproven(), SCAN_CAUSES);
    evidence
}

/// Evidence that leaves these scan causes standing.
fn evidence_but(cause: StopCause) -> Evidence {
    let mut judge = Judge::new();
    let report = StripeReport { watched_columns: 9, ..StripeReport::default() };
    let evidence = judge.judge(NOW, &report, HostVerdict::Stop, assent(false));
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
        outputs: OutputVerdict::Good,
        command_intact: true,
        data_intact: true,
        self_test: Verdict::Passed,
        dark: DarkVerdict::Waiting,
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
        (StopCause::OutputStage, Inputs { outputs: OutputVerdict::Pending, ..good() }),
        (StopCause::SelfTest, Inputs { self_test: Verdict::Pending, ..good() }),
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
    for cause in [
        StopCause::StripeMissing,
        StopCause::Drop,
        StopCause::HostRequest,
        StopCause::Liveness,
        StopCause::Audit,
        StopCause::Misaligned,
        StopCause::Capability,
    ] {
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
        let unproven = inputs.outputs == OutputVerdict::Pending || inputs.self_test == Verdict::Pending;
        let expected = if unproven { StateCode::SelfTest } else { StateCode::Stopped };
        assert_eq!(after(start, &inputs).code(), expected, "{cause:?}");
    }
}

#[test]
fn interlocked_to_darkness_by_a_reset_and_by_nothing_else() {
    let waiting = State::Interlocked { latched: OLD };
    assert_eq!(after(waiting, &good()), waiting);
    assert_eq!(after(waiting, &reset()), State::Darkness { latched: OLD, since: NOW });
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
        assert!(!decision.permission.is_granted(), "{cause:?}");
    }
}

#[test]
fn running_may_close_contacts_that_have_not_followed_yet() {
    let settling = Inputs { feedback: Feedback::Settling, ..good() };
    assert!(step(State::Running, NOW, &settling).1.permission.is_granted());
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
        (FaultCode::Feedback, Inputs { feedback: Feedback::Failed, ..good() }),
        (FaultCode::RelayMemory, Inputs { command_intact: false, ..good() }),
        (FaultCode::CriticalData, Inputs { data_intact: false, ..good() }),
        (FaultCode::OutputStage, Inputs { outputs: OutputVerdict::Failed, ..good() }),
        (FaultCode::SelfTest, Inputs { self_test: Verdict::Failed(SelfTestKind::Memory), ..good() }),
    ];
    let states = [
        State::SelfTest { latched: OLD },
        State::Interlocked { latched: OLD },
        State::Darkness { latched: OLD, since: NOW },
        State::Relighting { latched: OLD, since: NOW },
        State::Running,
        State::Stopped { latched: OLD },
    ];
    for (fault, inputs) in faults {
        for state in states {
            let (locked, decision) = step(state, NOW, &Inputs { reset: true, ..inputs });
            assert!(matches!(locked, State::Lockout { fault: found, .. } if found == fault));
            assert!(!decision.permission.is_granted() && decision.live.contains(cause_of(fault)));
            assert!(locked.latched().contains(cause_of(fault)));
            assert_eq!((locked.fault(), state.fault(), locked.laser()), (Some(fault), None, LaserMode::Off));
            assert_eq!(after(locked, &good()), locked);
            assert_eq!(after(locked, &reset()), locked);
            assert!(!step(locked, NOW, &reset()).1.permission.is_granted());
        }
    }
}

/// A lockout stops it anyway; that these stand as causes too is the second line of defence.
#[test]
fn whatever_locks_out_is_a_cause_to_stop_by_itself() {
    let faults = [
        (StopCause::CriticalData, Inputs { command_intact: false, ..good() }),
        (StopCause::CriticalData, Inputs { data_intact: false, ..good() }),
        (StopCause::Feedback, Inputs { feedback: Feedback::Failed, ..good() }),
        (StopCause::OutputStage, Inputs { outputs: OutputVerdict::Failed, ..good() }),
        (StopCause::SelfTest, Inputs { self_test: Verdict::Failed(SelfTestKind::Memory), ..good() }),
    ];
    for (cause, inputs) in faults {
        assert_eq!(standing(NOW, true, &inputs), StopCauses::NONE.with(cause), "{inputs:?}");
    }
    assert_eq!(standing(NOW, true, &good()), StopCauses::NONE);
    let decision = decide(&State::Running, false, StopCauses::NONE.with(StopCause::Drop));
    assert!(!decision.permission.is_granted(), "Running alone permits nothing");
}

#[test]
fn evidence_counts_until_the_link_times_out() {
    let taken = Micros::from_millis(500);
    for (change, running) in [(-1, true), (0, true), (1, false)] {
        let now = Micros::new(taken.plus(LINK_TIMEOUT).get().saturating_add_signed(change));
        let inputs = Inputs { evidence: Some(evidence_at(taken)), ..good() };
        assert_eq!(step(State::Running, now, &inputs).1.permission.is_granted(), running, "{change}");
    }
    let future = Inputs { evidence: Some(evidence_at(NOW.plus(Micros::new(1)))), ..good() };
    assert!(
        !step(State::Running, NOW, &future).1.permission.is_granted(),
        "evidence from the future proves nothing"
    );
}

#[test]
fn relays_are_closed_exactly_when_no_cause_is_shown() {
    let states = [
        State::Running,
        State::Interlocked { latched: OLD },
        State::Stopped { latched: OLD },
        State::Darkness { latched: OLD, since: NOW },
        State::Relighting { latched: OLD, since: NOW },
    ];
    for state in states {
        for (_, inputs) in
            shortfalls().into_iter().chain([(StopCause::Drop, good()), (StopCause::Drop, reset())])
        {
            let decision = step(state, NOW, &inputs).1;
            assert_eq!(decision.permission.is_granted(), decision.live.is_empty(), "{state:?} {inputs:?}");
        }
    }
}

#[test]
fn without_a_fresh_line_scan_its_causes_are_not_guessed() {
    let decision = step(State::Running, NOW, &Inputs { evidence: None, ..good() }).1;
    assert_eq!(decision.live, StopCauses::NONE.with(StopCause::LinkTimeout));
}

fn darkness() -> State {
    State::Darkness { latched: OLD, since: NOW }
}

fn relighting() -> State {
    State::Relighting { latched: OLD, since: NOW }
}

/// The inputs while the laser is off: the stripe is cut, and nothing else is wrong.
fn in_the_dark(dark: DarkVerdict) -> Inputs {
    let mut judge = Judge::new();
    let report = StripeReport { watched_columns: 9, ..StripeReport::default() };
    let assent = Assent { live: false, ..assent(true) };
    let evidence = [0; 3].map(|_| judge.judge(NOW, &report, HostVerdict::Clear, assent))[2];
    assert!(evidence.standing().contains(StopCause::StripeMissing));
    Inputs { evidence: Some(evidence), events: evidence.standing(), dark, ..good() }
}

#[test]
fn darkness_waits_for_its_proof_with_the_relays_open() {
    assert_eq!(after(darkness(), &in_the_dark(DarkVerdict::Waiting)), darkness());
    let (next, decision) = step(darkness(), NOW, &in_the_dark(DarkVerdict::Proven));
    assert_eq!(next, relighting());
    assert_eq!(
        decision,
        Decision { permission: Permission::DENIED, live: StopCauses::NONE.with(StopCause::Interlock) }
    );
    assert_eq!((darkness().laser(), relighting().laser()), (LaserMode::Dark, LaserMode::Coded));
    assert_eq!((darkness().code(), relighting().code()), (StateCode::Arming, StateCode::Arming));
}

#[test]
fn a_stripe_in_the_dark_and_too_long_a_dark_stop() {
    let denied = after(darkness(), &in_the_dark(DarkVerdict::Denied));
    assert_eq!(denied, State::Stopped { latched: OLD.with(StopCause::DarkTest) });
    for (change, expected) in [(-1, StateCode::Arming), (0, StateCode::Arming), (1, StateCode::Stopped)] {
        let now = Micros::new(NOW.plus(ARMING_TIMEOUT).get().saturating_add_signed(change));
        let inputs = Inputs { evidence: Some(evidence_at(now)), ..in_the_dark(DarkVerdict::Waiting) };
        let (next, decision) = step(darkness(), now, &inputs);
        assert_eq!(next.code(), expected, "{change}");
        assert!(!decision.permission.is_granted());
        assert_eq!(next.latched().contains(StopCause::DarkTest), expected == StateCode::Stopped);
    }
}

#[test]
fn relighting_to_running_only_by_evidence_from_after_the_dark() {
    assert_eq!(after(relighting(), &good()), State::Running);
    assert!(step(relighting(), NOW, &good()).1.permission.is_granted());
    let older = Micros::new(NOW.get() - 1);
    let before = Inputs { evidence: Some(evidence_at(older)), ..good() };
    assert_eq!(after(relighting(), &before), relighting());
    assert_eq!(after(relighting(), &in_the_dark(DarkVerdict::Proven)), relighting(), "still dark: wait");
    for (change, expected) in [(-1, StateCode::Arming), (0, StateCode::Arming), (1, StateCode::Stopped)] {
        let now = Micros::new(NOW.plus(ARMING_TIMEOUT).get().saturating_add_signed(change));
        let mut judge = Judge::new();
        let report = StripeReport { watched_columns: 9, ..StripeReport::default() };
        let cut = [0; 3].map(|_| judge.judge(now, &report, HostVerdict::Clear, assent(true)))[2];
        let (next, decision) = step(relighting(), now, &Inputs { evidence: Some(cut), ..good() });
        assert_eq!(next.code(), expected, "{change}");
        assert!(!decision.permission.is_granted());
        assert_eq!(next.latched().contains(StopCause::StripeMissing), expected == StateCode::Stopped);
    }
}

#[test]
fn every_other_cause_ends_the_arming() {
    for (cause, inputs) in shortfalls() {
        if DARK_CAUSES.contains(cause) {
            continue;
        }
        for state in [darkness(), relighting()] {
            let (next, decision) = step(state, NOW, &Inputs { dark: DarkVerdict::Proven, ..inputs });
            assert_eq!(next.code(), StateCode::Stopped, "{state:?} {cause:?}");
            assert!(next.latched().contains(cause) && !decision.permission.is_granted(), "{cause:?}");
        }
    }
}

#[test]
fn states_differ_in_the_words_that_the_memory_check_sees() {
    let later = Micros::new(NOW.get() + 1);
    let mut states = vec![State::Running, darkness(), relighting()];
    states.extend([
        State::Darkness { latched: OLD, since: later },
        State::Relighting { latched: OLD, since: later },
    ]);
    for latched in [StopCauses::NONE, OLD] {
        states.extend([
            State::SelfTest { latched },
            State::Interlocked { latched },
            State::Stopped { latched },
        ]);
        states.extend(FaultCode::ALL.map(|fault| State::Lockout { fault, latched }));
    }
    let words: std::collections::BTreeSet<_> = states.iter().map(State::words).collect();
    assert_eq!(words.len(), states.len());
}
