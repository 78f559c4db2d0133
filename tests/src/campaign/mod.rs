//! The fault-injection campaign: every fault of [`Fault::ALL`] alone and in pairs, at random times, against a whole
//! simulated robot; the relays must be commanded open within the fault's stated time and stay open while it lasts.
//!
//! `cargo xtask campaign` runs a million frames and more; `tests/tests/fault_matrix.rs` a part of it in every test run.

mod claims;
mod fault;
mod stage_hand;

pub use fault::Fault;
pub use stage_hand::{Scenes, Stagehand};

use crate::oracle::Random;
use crate::stage::Stage;
use nearfield_host::link::{LinkError, McuLink};
use nearfield_shared::units::Micros;
use std::collections::BTreeMap;

/// The contacts follow their command within this, and a frame.
const RELAY_DROP_OUT: Micros = Micros::from_millis(40);

/// What was seen of one fault alone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Seen {
    /// Injections.
    pub injections: u32,
    /// The longest time from its beginning to both relays commanded open.
    pub worst: Micros,
}

/// What a campaign has found.
#[derive(Debug, Clone, Default)]
pub struct Findings {
    /// Frames played.
    pub frames: u64,
    /// Frames without any fault while the relays were closed.
    pub clean_frames: u64,
    /// Stops in them: false alarms.
    pub false_stops: u32,
    /// By fault.
    pub alone: BTreeMap<String, Seen>,
    /// Pairs played.
    pub pairs: u32,
    /// Promises that were broken, in words.
    pub broken: Vec<String>,
}

impl Findings {
    /// Adds another part of the campaign.
    pub fn add(&mut self, other: Self) {
        self.frames += other.frames;
        self.clean_frames += other.clean_frames;
        self.false_stops += other.false_stops;
        self.pairs += other.pairs;
        self.broken.extend(other.broken);
        for (name, seen) in other.alone {
            let all = self.alone.entry(name).or_default();
            all.injections += seen.injections;
            all.worst = all.worst.max(seen.worst);
        }
    }

    /// The table of worst times, as Markdown.
    #[must_use]
    pub fn table(&self) -> String {
        let mut lines = vec![
            "| fault | injections | worst time to open | stated |".to_owned(),
            "|---|---|---|---|".to_owned(),
        ];
        for fault in Fault::ALL {
            let seen = self.alone.get(&fault.name()).copied().unwrap_or_default();
            lines.push(format!(
                "| {} | {} | {:.0} ms | {} ms |",
                fault.name(),
                seen.injections,
                seen.worst.get() as f64 / 1000.0,
                fault.bound_ms()
            ));
        }
        lines.join("\n")
    }
}

/// One act: arms, waits, injects the faults one after the other, and looks.
fn play(hand: &mut Stagehand<'_>, faults: &[Fault], findings: &mut Findings) -> Result<(), LinkError> {
    if !hand.arm()? {
        findings.broken.push(format!("not armed before {faults:?}: {:?}", hand.status()));
        hand.power_cycle()?;
        return Ok(());
    }
    let lead = hand.below(40);
    for _ in 0..lead {
        hand.frame()?;
        findings.clean_frames += 1;
        if !hand.is_commanded_closed() {
            findings.false_stops += 1;
            return Ok(());
        }
    }
    let mut begun = Micros::ZERO;
    for (index, fault) in faults.iter().enumerate() {
        if index > 0 {
            let gap = hand.below(30);
            (0..gap).try_for_each(|_| hand.frame())?;
        }
        begun = hand.begin(*fault)?;
    }
    let bound =
        faults.iter().map(|fault| Micros::from_millis(fault.bound_ms())).max().unwrap_or(Micros::ZERO);
    let deadline = begun.plus(bound);
    while hand.opened_at().is_none() && hand.now() <= deadline.plus(Micros::from_millis(40)) {
        hand.frame()?;
    }
    match hand.opened_at() {
        Some(opened) if opened <= deadline => {
            if let [fault] = faults {
                let seen = findings.alone.entry(fault.name()).or_default();
                seen.injections += 1;
                seen.worst = seen.worst.max(opened.since(begun));
            }
        }
        opened => {
            let after = opened.map(|opened| opened.since(begun).get());
            findings
                .broken
                .push(format!("{faults:?}: not open within {} us, but after {after:?} us", bound.get()));
        }
    }
    stays_safe(hand, faults, findings)?;
    hand.end_all();
    Ok(())
}

/// While a fault lasts and somebody presses the reset button, the robot's circuit is not closed for longer than the fault's
/// stated time: one that shows only after a while (a moved mount, after another fault has reset the controller) stops
/// again.
fn stays_safe(hand: &mut Stagehand<'_>, faults: &[Fault], findings: &mut Findings) -> Result<(), LinkError> {
    let lasting = faults.iter().filter(|fault| !fault.is_momentary()).map(|fault| fault.bound_ms()).max();
    let mut closed_since = None;
    let mut frame = 0;
    while frame < 70 || closed_since.is_some() {
        if frame == 20 {
            hand.press();
        }
        hand.frame()?;
        frame += 1;
        let Some(bound) = lasting else { continue };
        // Two dangerous faults at once, one in each channel, are beyond what two channels can do: the command must be open.
        let both_held = (0..2).all(|channel| faults.iter().any(|fault| fault.holds_closed(channel)));
        let closed = if both_held { hand.is_commanded_closed() } else { hand.is_circuit_closed() };
        if !closed {
            closed_since = None;
            continue;
        }
        let since = *closed_since.get_or_insert(hand.now());
        if hand.now().since(since) > Micros::from_millis(bound).plus(RELAY_DROP_OUT) {
            findings.broken.push(format!("{faults:?}: the circuit is closed again while it lasts"));
            return Ok(());
        }
    }
    Ok(())
}

/// Plays acts of this seed until `frames` are played: all faults alone in a random order, then random pairs, and again.
///
/// # Errors
/// The controller cannot be reached.
pub fn run(
    stage: &Stage,
    scenes: &Scenes,
    seed: u64,
    frames: u64,
    link: impl Fn() -> Result<Box<dyn McuLink>, LinkError>,
    mut progress: impl FnMut(u64),
) -> Result<Findings, LinkError> {
    let mut findings = Findings::default();
    let mut random = Random::new(seed);
    let mut hand = Stagehand::new(stage, scenes, seed, &link)?;
    let pick = |random: &mut Random| Fault::ALL[(random.bits() % Fault::ALL.len() as u64) as usize];
    let mut alone = Vec::new();
    while hand.frames() < frames {
        if alone.is_empty() {
            alone = Fault::ALL.to_vec();
        }
        if random.bits().is_multiple_of(3) {
            let index = (random.bits() % alone.len() as u64) as usize;
            play(&mut hand, &[alone.swap_remove(index)], &mut findings)?;
        } else {
            let (one, other) = (pick(&mut random), pick(&mut random));
            play(&mut hand, &[one, other], &mut findings)?;
            findings.pairs += 1;
        }
        progress(hand.frames());
    }
    findings.frames = hand.frames();
    Ok(findings)
}

/// Plays every fault alone, once.
///
/// # Errors
/// The controller cannot be reached.
pub fn each_once(
    stage: &Stage,
    scenes: &Scenes,
    seed: u64,
    link: impl Fn() -> Result<Box<dyn McuLink>, LinkError>,
) -> Result<Findings, LinkError> {
    let mut findings = Findings::default();
    let mut hand = Stagehand::new(stage, scenes, seed, &link)?;
    for fault in Fault::ALL {
        play(&mut hand, &[fault], &mut findings)?;
    }
    findings.frames = hand.frames();
    Ok(findings)
}
