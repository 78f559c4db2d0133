//! Were the script's expectations met? Judged by what passed through the link, never by what was intended.

use nearfield_shared::causes::StopCause;
use nearfield_shared::units::Micros;

use super::record::{CheckRecord, FrameRecord};
use super::script::{Check, Trigger};
use super::watch::{Trace, Traces};

/// Causes are told by the status of the frame in which the relays opened, or of one of the next few.
const CAUSE_WINDOW_MS: f64 = 200.0;

/// Time before a moment that no longer belongs to it.
const JUST_BEFORE_MS: f64 = 0.01;

/// What an act looked like.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// When it began, milliseconds since power-on.
    pub start_ms: f64,
    /// Outputs and contacts over the whole run.
    pub traces: &'a Traces,
    /// The act's frames.
    pub frames: &'a [FrameRecord],
    /// When light was first interrupted, milliseconds since power-on.
    pub interrupted_ms: Option<f64>,
}

impl Evidence<'_> {
    /// Judges one expectation.
    #[must_use]
    pub fn judge(&self, check: Check) -> CheckRecord {
        match check {
            Check::StaysOpen(from, to) => self.stays(false, from, to),
            Check::StaysClosed(from, to) => self.stays(true, from, to),
            Check::Closes(press, within) => self.closes(press, within),
            Check::Measures(at, tolerance) => self.measures(at, tolerance),
            Check::Opens(trigger, within, cause) => self.opens(trigger, within, cause),
        }
    }

    fn commanded(&self) -> &Trace {
        &self.traces.commanded_closed
    }

    fn stays(&self, closed: bool, from: f64, to: f64) -> CheckRecord {
        let state = if closed { "closed" } else { "open" };
        let expected = format!("relays stay {state} from {} to {}", seconds(from), seconds(to));
        let broken = self.commanded().first(!closed, micros(self.start_ms + from));
        match broken.map(|when| millis(when) - self.start_ms).filter(|when| *when < to) {
            None => simple(expected, format!("stayed {state}"), true),
            Some(when) => simple(expected, format!("not {state} at {}", seconds(when)), false),
        }
    }

    fn closes(&self, press: f64, within: f64) -> CheckRecord {
        let expected =
            format!("relays close within {within:.0} ms of the button's press at {}", seconds(press));
        let pressed = self.start_ms + press;
        if self.commanded().at(micros(pressed)) {
            return simple(expected, "were closed already".to_owned(), false);
        }
        match self.commanded().first(true, micros(pressed)).map(|when| millis(when) - pressed) {
            Some(after) => simple(expected, format!("closed after {after:.0} ms"), after <= within),
            None => simple(expected, "never closed".to_owned(), false),
        }
    }

    fn measures(&self, at: f64, tolerance: f64) -> CheckRecord {
        let expected =
            format!("the controller's highest point at {} is right within {tolerance:.0} mm", seconds(at));
        let frame = self.frames.iter().find(|frame| frame.t_ms >= self.start_ms + at);
        match frame.map(|frame| (frame.highest_mm.map(f64::from), frame.true_highest_mm)) {
            Some((Some(measured), Some(real))) => {
                let happened = format!("measured {measured:.1} mm, really {real:.1} mm");
                simple(expected, happened, (measured - real).abs() <= tolerance)
            }
            Some((None, _)) => simple(expected, "measured nothing raised".to_owned(), false),
            Some((_, None)) => simple(expected, "there is nothing raised".to_owned(), false),
            None => simple(expected, "there is no such frame".to_owned(), false),
        }
    }

    fn opens(&self, trigger: Trigger, within: f64, cause: StopCause) -> CheckRecord {
        let what = match trigger {
            Trigger::FirstInterruptedLight => "the first interrupted light".to_owned(),
            Trigger::At(at) => seconds(at),
        };
        let expected = format!("relays open within {within:.0} ms of {what}, because {}", cause.words());
        let moment = match trigger {
            Trigger::FirstInterruptedLight => self.interrupted_ms,
            Trigger::At(at) => Some(self.start_ms + at),
        };
        let Some(moment) = moment else {
            return simple(expected, "no light was ever interrupted".to_owned(), false);
        };
        // A message can open the relays in the very moment in which it arrives.
        if !self.commanded().at(micros(moment - JUST_BEFORE_MS)) {
            return simple(expected, "were open before".to_owned(), false);
        }
        let opened = self.commanded().first(false, micros(moment)).map(millis);
        let Some(opened) =
            opened.filter(|when| self.frames.last().is_some_and(|frame| *when <= frame.t_ms + 20.0))
        else {
            return simple(expected, "never opened".to_owned(), false);
        };
        let told = self.told(opened, cause);
        let reaction = opened - moment;
        let contacts =
            self.traces.contacts_closed.first(false, micros(opened)).map(|when| millis(when) - moment);
        let happened = match (told, contacts) {
            (false, _) => format!("opened after {reaction:.0} ms, but never gave this cause"),
            (true, Some(contacts)) => {
                format!("commanded open after {reaction:.0} ms, contacts open after {contacts:.0} ms")
            }
            (true, None) => format!("commanded open after {reaction:.0} ms, but the contacts never opened"),
        };
        let met = reaction <= within && told && contacts.is_some();
        let from_light = trigger == Trigger::FirstInterruptedLight;
        CheckRecord {
            expected,
            happened,
            met,
            reaction_ms: Some(reaction),
            contacts_open_ms: contacts,
            from_light,
        }
    }

    fn told(&self, opened: f64, cause: StopCause) -> bool {
        let near = |frame: &&FrameRecord| (opened - 20.0..opened + CAUSE_WINDOW_MS).contains(&frame.t_ms);
        self.frames.iter().filter(near).any(|frame| {
            frame.live_causes.contains(&cause.name()) || frame.latched_causes.contains(&cause.name())
        })
    }
}

fn simple(expected: String, happened: String, met: bool) -> CheckRecord {
    CheckRecord { expected, happened, met, reaction_ms: None, contacts_open_ms: None, from_light: false }
}

fn seconds(ms: f64) -> String {
    format!("{:.2} s", ms / 1000.0)
}

/// Milliseconds as the controller's clock.
#[must_use]
pub fn micros(ms: f64) -> Micros {
    Micros::new((ms.max(0.0) * 1000.0).round() as u64)
}

/// The controller's clock in milliseconds.
#[must_use]
pub fn millis(time: Micros) -> f64 {
    time.get() as f64 / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::record::MessageFate;

    fn frame(t_ms: f64, causes: &[&'static str]) -> FrameRecord {
        FrameRecord {
            frame: 0,
            t_ms,
            act: 0,
            state: "running",
            commanded_closed: true,
            contacts_closed: true,
            longest_gap_mm: None,
            true_gap_mm: 0.0,
            highest_mm: None,
            true_highest_mm: None,
            live_causes: causes.to_vec(),
            latched_causes: Vec::new(),
            decision_age_ms: 25.0,
            message: MessageFate::Sent,
            host_cut: false,
            laser_level: 255,
        }
    }

    /// Closed from 1.0 s to 1.5 s; contacts follow 20 ms later; the cause is told at 1.5 s.
    fn judge(check: Check, interrupted_ms: Option<f64>, cause: &'static str) -> CheckRecord {
        let mut traces = Traces::default();
        for (trace, late) in [(&mut traces.commanded_closed, 0.0), (&mut traces.contacts_closed, 20.0)] {
            trace.note(micros(1000.0 + late), true);
            trace.note(micros(1500.0 + late), false);
        }
        let told = |t_ms: f64| if t_ms >= 1500.0 { vec![cause] } else { Vec::new() };
        let frames: Vec<FrameRecord> =
            (0..100).map(|i| f64::from(i) * 20.0).map(|t_ms| frame(t_ms, &told(t_ms))).collect();
        Evidence { start_ms: 500.0, traces: &traces, frames: &frames, interrupted_ms }.judge(check)
    }

    #[test]
    fn staying_is_judged_over_the_whole_stretch() {
        assert!(judge(Check::StaysOpen(0.0, 490.0), None, "").met);
        assert!(!judge(Check::StaysOpen(0.0, 510.0), None, "").met);
        assert!(judge(Check::StaysClosed(500.0, 990.0), None, "").met);
        assert!(!judge(Check::StaysClosed(490.0, 990.0), None, "").met);
        assert!(!judge(Check::StaysClosed(500.0, 1010.0), None, "").met);
    }

    #[test]
    fn closing_needs_an_open_relay_before_and_a_closed_one_in_time() {
        assert!(judge(Check::Closes(400.0, 150.0), None, "").met);
        assert!(!judge(Check::Closes(300.0, 150.0), None, "").met, "too late");
        assert!(!judge(Check::Closes(600.0, 150.0), None, "").met, "was closed already");
        assert!(!judge(Check::Closes(1200.0, 150.0), None, "").met, "never again");
    }

    #[test]
    fn a_height_is_right_or_wrong_or_missing() {
        let traces = Traces::default();
        let measured = |highest_mm, true_highest_mm| {
            let frames = [FrameRecord { highest_mm, true_highest_mm, ..frame(0.0, &[]) }];
            let evidence = Evidence { start_ms: 0.0, traces: &traces, frames: &frames, interrupted_ms: None };
            evidence.judge(Check::Measures(0.0, 2.0)).met
        };
        assert!(measured(Some(41.9), Some(40.0)) && measured(Some(38.1), Some(40.0)));
        assert!(!measured(Some(42.1), Some(40.0)) && !measured(Some(37.9), Some(40.0)));
        assert!(!measured(None, Some(40.0)) && !measured(Some(40.0), None));
    }

    #[test]
    fn opening_needs_time_cause_and_a_closed_relay_before() {
        let at = |at, within| Check::Opens(Trigger::At(at), within, StopCause::StripeCut);
        let good = judge(at(930.0, 100.0), None, "stripe_cut");
        assert!(good.met, "{good:?}");
        assert_eq!((good.reaction_ms, good.contacts_open_ms), (Some(70.0), Some(90.0)));
        assert!(judge(at(1000.0, 0.0), None, "stripe_cut").met, "in the very moment");
        assert!(!judge(at(930.0, 60.0), None, "stripe_cut").met, "too late");
        assert!(!judge(at(930.0, 100.0), None, "drop").met, "another cause");
        assert!(!judge(at(1100.0, 100.0), None, "stripe_cut").met, "was open before");
        let light = Check::Opens(Trigger::FirstInterruptedLight, 100.0, StopCause::StripeCut);
        assert!(judge(light, Some(1440.0), "stripe_cut").met);
        assert!(!judge(light, Some(1300.0), "stripe_cut").met);
        assert!(!judge(light, None, "stripe_cut").met);
    }
}
