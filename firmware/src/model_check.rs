//! Exhaustive search of the supervisor, the reset button and the relays together, over their real code.
//!
//! The search walks every state that any sequence of inputs can lead to. Time passes in steps of 50 ms and is kept
//! relative: ages beyond the longest limit are alike. In each state every input is tried in which at most one thing
//! differs from "all is well" (a stop needs no more), with every word of the dark test and every position of contacts and
//! button. What must hold
//! holds in every step:
//!
//! * the relays are closed only in `Running`, and only while every proof is there and fresh;
//! * `Running` is entered only from `Relighting`, by evidence from after the dark, and that only from a proven dark,
//!   and that only by a whole press of the button;
//! * any single thing that is not well opens in the same step: a stop is always one step away;
//! * there is no way out of `Lockout`;
//! * from every other state good inputs lead to `Running` again: no dead end.

use crate::arming::DarkVerdict;
use crate::evidence::{Assent, Evidence, Judge};
use crate::interlock::ResetButton;
use crate::output_test::OutputVerdict;
use crate::relay::{Feedback, MirrorContacts, Relays};
use crate::selftest::{SelfTestKind, Verdict};
use crate::supervisor::{Inputs, State, step};
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::condition::{Channels, StateCode};
use nearfield_shared::cutoff::Cutoff;
use nearfield_shared::limits::{LINK_TIMEOUT, LONGEST_RESET_PRESS};
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::monitor::StripeReport;
use nearfield_shared::units::Micros;
use std::collections::{BTreeSet, HashMap, VecDeque};

/// The time of every step; states are shifted so that it stays the same.
const NOW: Micros = Micros::from_millis(100_000);
const STEP: Micros = Micros::from_millis(50);
/// Ages beyond every limit.
const OLDEST: Micros = Micros::from_millis(100_000 - 3_100);
const _: () = assert!(LONGEST_RESET_PRESS.get() < 3_100_000);

/// Everything that lasts from step to step.
#[derive(Debug, Clone, Copy)]
struct Model {
    state: State,
    button: ResetButton,
    relays: Relays,
}

impl Model {
    const START: Self = Self {
        state: State::SelfTest { latched: StopCauses::NONE },
        button: ResetButton::new(),
        relays: Relays::new(),
    };

    /// Time passes: everything becomes older, up to [`OLDEST`]. What was latched does not decide anything.
    fn aged(mut self) -> Self {
        let older = |time: Micros| Micros::new(time.get() - STEP.get()).max(OLDEST);
        let latched = StopCauses::NONE;
        self.state = match self.state {
            State::SelfTest { .. } => State::SelfTest { latched },
            State::Interlocked { .. } => State::Interlocked { latched },
            State::Darkness { since, .. } => State::Darkness { latched, since: older(since) },
            State::Relighting { since, .. } => State::Relighting { latched, since: older(since) },
            State::Running => State::Running,
            State::Stopped { .. } => State::Stopped { latched },
            State::Lockout { fault, .. } => State::Lockout { fault, latched },
        };
        self.button = self.button.aged(older);
        self.relays = self.relays.aged(older);
        if matches!(self.state, State::Lockout { .. }) {
            // Contacts and button no longer matter there; `check` holds every step to that.
            (self.button, self.relays) = (ResetButton::new(), Relays::new());
        }
        self
    }

    fn key(&self) -> [u64; 7] {
        let ([a, b], [c, d], [e, f, g]) = (self.state.words(), self.button.words(), self.relays.words());
        [a, b, c, d, e, f, g]
    }
}

/// What the world does in a step.
#[derive(Debug, Clone, Copy)]
struct World {
    mirror: MirrorContacts,
    pressed: bool,
    inputs: Inputs,
}

fn evidence(taken: Micros, floor_columns: u16, verdict: HostVerdict) -> Evidence {
    let cutoff = Cutoff { floor_columns, ..Cutoff::default() };
    let report = StripeReport { watched_columns: 9, cutoff, ..StripeReport::default() };
    let assent = Assent { live: true, believed: true, aligned: true, capable: true };
    let mut judge = Judge::new();
    [0; 3].map(|_| judge.judge(taken, &report, verdict, assent))[2]
}

fn well() -> Inputs {
    Inputs {
        evidence: Some(evidence(NOW, 9, HostVerdict::Clear)),
        link: StopCauses::NONE,
        events: StopCauses::NONE,
        feedback: Feedback::Agrees,
        outputs: OutputVerdict::Good,
        command_intact: true,
        data_intact: true,
        self_test: Verdict::Passed,
        dark: DarkVerdict::Proven,
        flow_intact: true,
        configured: true,
        button_stuck: false,
        reset: false,
    }
}

type Change = fn(&mut Inputs);

/// Every single way in which inputs can differ from [`well`].
const CHANGES: [Change; 15] = [
    |inputs| inputs.evidence = None,
    |inputs| {
        inputs.evidence =
            Some(evidence(Micros::new(NOW.get() - LINK_TIMEOUT.get() - 1), 9, HostVerdict::Clear))
    },
    |inputs| inputs.evidence = Some(evidence(Micros::new(NOW.get() + 1), 9, HostVerdict::Clear)),
    |inputs| inputs.evidence = Some(evidence(NOW, 0, HostVerdict::Clear)),
    |inputs| inputs.evidence = Some(evidence(NOW, 9, HostVerdict::Stop)),
    |inputs| inputs.link = StopCauses::NONE.with(StopCause::LinkCorruption),
    |inputs| inputs.events = StopCauses::NONE.with(StopCause::StripeCut),
    |inputs| inputs.events = StopCauses::NONE.with(StopCause::Audit),
    |inputs| inputs.outputs = OutputVerdict::Pending,
    |inputs| inputs.outputs = OutputVerdict::Failed,
    |inputs| inputs.data_intact = false,
    |inputs| inputs.self_test = Verdict::Pending,
    |inputs| inputs.self_test = Verdict::Failed(SelfTestKind::Memory),
    |inputs| inputs.flow_intact = false,
    |inputs| inputs.configured = false,
];

/// All inputs in which at most one thing differs, each with every word of the dark test.
fn all_inputs() -> Vec<Inputs> {
    let mut all = vec![well()];
    for change in CHANGES {
        let mut inputs = well();
        change(&mut inputs);
        all.push(inputs);
    }
    [DarkVerdict::Waiting, DarkVerdict::Proven, DarkVerdict::Denied]
        .into_iter()
        .flat_map(|dark| all.iter().map(move |inputs| Inputs { dark, ..*inputs }))
        .collect()
}

fn worlds() -> Vec<World> {
    let mut all = Vec::new();
    for inputs in all_inputs() {
        for bits in 0..8 {
            let mirror = MirrorContacts { a: bits & 1 != 0, b: bits & 2 != 0 };
            all.push(World { mirror, pressed: bits & 4 != 0, inputs });
        }
    }
    all
}

/// One step, as the controller's tick makes it; returns the inputs that the supervisor saw, too.
fn advance(model: &Model, world: &World) -> (Model, Inputs) {
    let mut next = *model;
    let armed = model.state.code() == StateCode::Interlocked;
    let button = next.button.step(NOW, world.pressed, armed);
    let inputs = Inputs {
        feedback: next.relays.check(NOW, world.mirror),
        command_intact: next.relays.is_memory_intact(),
        button_stuck: button.stuck,
        reset: button.reset,
        ..world.inputs
    };
    let (state, decision) = step(model.state, NOW, &inputs);
    next.state = state;
    next.relays.follow(decision.permission);
    let closed = next.relays.command() == Channels::CLOSED;
    assert_eq!(closed, decision.permission.is_granted());
    check(model, &next, &inputs, closed);
    (next, inputs)
}

/// Does all of it speak for running, as far as inputs go?
fn is_all_well(running: bool, inputs: &Inputs) -> bool {
    let fresh = inputs.evidence == well().evidence;
    let feedback = inputs.feedback == Feedback::Agrees || (running && inputs.feedback == Feedback::Settling);
    let rest = Inputs { feedback: Feedback::Agrees, dark: well().dark, reset: false, ..*inputs };
    fresh && feedback && rest == well()
}

/// The rules of every step.
fn check(before: &Model, after: &Model, inputs: &Inputs, closed: bool) {
    let was_running = before.state == State::Running;
    let told = || format!("{before:?} -> {after:?} by {inputs:?}");
    if closed {
        assert_eq!(after.state, State::Running, "{}", told());
        assert!(is_all_well(was_running, inputs), "{}", told());
    }
    if was_running && !is_all_well(true, inputs) {
        assert!(!closed && after.state != State::Running, "a stop at once: {}", told());
    }
    let (from, to) = (before.state, after.state);
    if let State::Lockout { fault, .. } = from {
        assert!(matches!(to, State::Lockout { fault: after, .. } if after == fault), "{}", told());
    }
    match to {
        State::Running => assert!(matches!(from, State::Running | State::Relighting { .. }), "{}", told()),
        State::Relighting { .. } => {
            let proven = matches!(from, State::Darkness { .. }) && inputs.dark == DarkVerdict::Proven;
            assert!(proven || matches!(from, State::Relighting { .. }), "{}", told());
        }
        State::Darkness { .. } => {
            let pressed = matches!(from, State::Interlocked { .. }) && inputs.reset;
            assert!(pressed || matches!(from, State::Darkness { .. }), "{}", told());
        }
        State::SelfTest { .. } => assert!(matches!(from, State::SelfTest { .. }), "{}", told()),
        State::Interlocked { .. } | State::Stopped { .. } | State::Lockout { .. } => {}
    }
    if matches!(from, State::Lockout { .. }) {
        assert!(matches!(to, State::Lockout { .. }) && !closed, "{}", told());
    }
}

/// Good inputs and a person who presses the button for 150 ms whenever it is asked for: does that lead to `Running`?
fn recovers(model: &Model) -> bool {
    let mut model = *model;
    let mut pressed_for = 0;
    for _ in 0..200 {
        if model.state == State::Running && model.relays.command() == Channels::CLOSED {
            return true;
        }
        let command = model.relays.command();
        let pressed = model.state.code() == StateCode::Interlocked && pressed_for < 3;
        pressed_for = if pressed { pressed_for + 1 } else { 0 };
        let mirror = MirrorContacts { a: !command.a, b: !command.b };
        model = advance(&model, &World { mirror, pressed, inputs: well() }).0.aged();
    }
    false
}

#[test]
#[cfg_attr(miri, ignore = "more than a million steps")]
fn every_reachable_state_keeps_the_rules() {
    let worlds = worlds();
    let mut seen: HashMap<[u64; 7], ()> = HashMap::from([(Model::START.key(), ())]);
    let mut frontier = VecDeque::from([Model::START]);
    let mut codes = BTreeSet::new();
    let mut steps = 0_u64;
    while let Some(model) = frontier.pop_front() {
        codes.insert(model.state.words()[0] & 0xFF);
        for world in &worlds {
            let next = advance(&model, world).0.aged();
            steps += 1;
            if seen.insert(next.key(), ()).is_none() {
                frontier.push_back(next);
                if !matches!(next.state, State::Lockout { .. }) {
                    assert!(recovers(&next), "a dead end: {next:?}");
                }
            }
        }
    }
    println!("{} states, {steps} steps, {} inputs in each", seen.len(), worlds.len());
    assert_eq!(codes.len(), 7, "every kind of state is reached");
    assert!(seen.len() > 500, "{}", seen.len());
}
