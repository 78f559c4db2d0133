//! The demo's minute, written down: what happens when, and what must follow.

use nearfield_shared::causes::StopCause;

use crate::twin::gallery::{carton, hand, plain};
use crate::twin::scene::Shape;
use crate::twin::{Scene, SceneObject};

/// From the first interrupted light to the relays' command, at most, milliseconds: up to one frame period until the
/// next exposure (20), exposure, read-out and the host's work (25), two more frames for the vote (40), and 15 for an
/// object that enters gradually.
pub const LIGHT_TO_COMMAND_MS: f64 = 100.0;
/// From the last good message to the relays' command, at most, milliseconds: the link's time-out and one tick, and
/// the frame period before the first message that is missed.
pub const SILENCE_TO_COMMAND_MS: f64 = 90.0;
/// From a host's request to stop to the relays' command, at most, milliseconds: the exchange itself opens them.
pub const MESSAGE_TO_COMMAND_MS: f64 = 25.0;
/// From the first bad message to the relays' command, at most, milliseconds: the first is discarded like a lost one, the
/// second opens them.
pub const BAD_MESSAGES_TO_COMMAND_MS: f64 = 45.0;
/// From the first frozen picture to the relays' command, at most, milliseconds: two changes of the laser's code (160),
/// the age of the picture and of the message (110), a frame.
pub const FROZEN_TO_COMMAND_MS: f64 = 290.0;
/// From the first replayed picture to the relays' command, at most, milliseconds: each change of the laser's code finds
/// it with a chance of one half; with the demo's own code it takes less.
pub const REPLAY_TO_COMMAND_MS: f64 = 800.0;
/// From a hang of the controller's program to the open command, at most: the watchdog's time and a tick.
pub const HANG_TO_COMMAND_MS: f64 = 110.0;
/// From the reset button's press to the closed command, at most: the press itself (150), the dark test (100), and the
/// laser's code seen again (250), each with the picture's age and a frame.
pub const PRESS_TO_CLOSED_MS: f64 = 600.0;

/// The controller's heights may differ from the real ones by this, millimetres.
pub const HEIGHT_TOLERANCE_MM: f64 = 2.0;

/// One act of the minute; times are milliseconds from its beginning.
#[derive(Debug, Clone)]
pub struct Act {
    /// The name that programs read.
    pub name: &'static str,
    /// What people read.
    pub title: &'static str,
    /// What must happen, in one sentence.
    pub promise: &'static str,
    /// How long it takes.
    pub length_ms: f64,
    /// What happens.
    pub cues: Vec<Cue>,
    /// What must follow.
    pub checks: Vec<Check>,
    /// When the camera picture for the report is taken; `None` where the picture tells nothing.
    pub snapshot_ms: Option<f64>,
}

/// Something happens from `at_ms` until `until_ms`.
#[derive(Debug, Clone)]
pub struct Cue {
    /// Its beginning.
    pub at_ms: f64,
    /// Its end; for a moment it is its beginning.
    pub until_ms: f64,
    /// What.
    pub action: Action,
}

/// What can happen.
#[derive(Debug, Clone)]
pub enum Action {
    /// An object comes, stays and leaves.
    Visit(Visit),
    /// The laser gives no light, whatever the controller commands.
    LaserDead,
    /// Something covers the lens.
    LensCovered,
    /// The camera delivers the same picture again and again; messages are fresh.
    CameraFrozen,
    /// The host replays pictures from half a second ago in fresh messages.
    ReplayPictures,
    /// The host's messages do not arrive.
    DropMessages,
    /// Bits of the host's messages flip on the way.
    DamageMessages,
    /// The host sends the same message again and again.
    RepeatMessages,
    /// The host claims that all is clear, whatever it sees.
    ClaimClear,
    /// The host asks for a stop, whatever it sees.
    RequestStop,
    /// The controller's program hangs (a moment).
    HangController,
    /// Somebody presses the reset button for 150 ms (a moment).
    PressReset,
}

/// An object that slides from one place to another, waits, and slides back.
#[derive(Debug, Clone)]
pub struct Visit {
    /// The object; its own place is not used.
    pub object: SceneObject,
    /// Where it comes from and goes back to: along and across the stripe, millimetres.
    pub from_mm: [f64; 2],
    /// Where it stays.
    pub to_mm: [f64; 2],
    /// How fast, millimetres a second.
    pub speed_mm_per_s: f64,
}

/// What must follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Check {
    /// The relays are commanded open all the time from .. to.
    StaysOpen(f64, f64),
    /// The relays are commanded closed all the time from .. to.
    StaysClosed(f64, f64),
    /// The relays are commanded open within so many milliseconds after the trigger, and this cause is given.
    Opens(Trigger, f64, StopCause),
    /// The relays are commanded closed within so many milliseconds after the press at this time.
    Closes(f64, f64),
    /// At this time the controller's highest point is the real one, within so many millimetres.
    Measures(f64, f64),
}

/// From when a reaction is counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Trigger {
    /// The first light that does not reach the floor where it should.
    FirstInterruptedLight,
    /// This moment.
    At(f64),
}

impl Visit {
    /// Where the object is `elapsed_ms` after its cue began; the cue lasts `lasts_ms`.
    #[must_use]
    pub fn object_at(&self, elapsed_ms: f64, lasts_ms: f64) -> SceneObject {
        let [x, y] = [self.to_mm[0] - self.from_mm[0], self.to_mm[1] - self.from_mm[1]];
        let travel_ms = x.hypot(y) / self.speed_mm_per_s * 1000.0;
        let share = (elapsed_ms / travel_ms).min((lasts_ms - elapsed_ms) / travel_ms).clamp(0.0, 1.0);
        SceneObject {
            along_mm: self.from_mm[0] + share * x,
            across_mm: self.from_mm[1] + share * y,
            ..self.object.clone()
        }
    }
}

const fn during(at_ms: f64, until_ms: f64, action: Action) -> Cue {
    Cue { at_ms, until_ms, action }
}

const fn moment(at_ms: f64, action: Action) -> Cue {
    during(at_ms, at_ms, action)
}

/// An act in which an object comes at 500 ms, is gone at 2500 ms, and the reset button is pressed in vain at 1500 ms
/// and with success at 3000 ms.
fn intrusion(
    name: &'static str,
    title: &'static str,
    promise: &'static str,
    visit: Visit,
    cause: StopCause,
    liar: bool,
) -> Act {
    let mut cues = vec![
        during(500.0, 2500.0, Action::Visit(visit)),
        moment(1500.0, Action::PressReset),
        moment(3000.0, Action::PressReset),
    ];
    if liar {
        cues.push(during(400.0, 2600.0, Action::ClaimClear));
    }
    let checks = vec![
        Check::Opens(Trigger::FirstInterruptedLight, LIGHT_TO_COMMAND_MS, cause),
        Check::Measures(1400.0, HEIGHT_TOLERANCE_MM),
        Check::StaysOpen(1200.0, 3100.0),
        Check::Closes(3000.0, PRESS_TO_CLOSED_MS),
        Check::StaysClosed(3650.0, 4500.0),
    ];
    Act { name, title, promise, length_ms: 4500.0, cues, checks, snapshot_ms: Some(1400.0) }
}

/// An act in which something goes wrong from 500 ms to 900 ms, and the reset button is pressed at 1300 ms.
fn disturbance(
    name: &'static str,
    title: &'static str,
    promise: &'static str,
    action: Action,
    check: Check,
) -> Act {
    let cues = vec![during(500.0, 900.0, action), moment(1300.0, Action::PressReset)];
    let checks = vec![
        Check::StaysClosed(0.0, 490.0),
        check,
        Check::StaysOpen(900.0, 1440.0),
        Check::Closes(1300.0, PRESS_TO_CLOSED_MS),
        Check::StaysClosed(1950.0, 3000.0),
    ];
    Act { name, title, promise, length_ms: 3000.0, cues, checks, snapshot_ms: None }
}

/// The floor and light that everything happens on.
#[must_use]
pub fn stage() -> Scene {
    Scene::default()
}

/// All acts, one after the other: a minute.
#[must_use]
pub fn minute() -> Vec<Act> {
    let mut acts = opening();
    acts.extend(intrusions());
    acts.extend(link_faults());
    acts.extend(ending());
    acts
}

fn opening() -> Vec<Act> {
    vec![
        Act {
            name: "power_on",
            title: "Power on, floor clear",
            promise: "The relays stay open: there is no automatic start, however clear the floor is.",
            length_ms: 3000.0,
            cues: Vec::new(),
            checks: vec![Check::StaysOpen(0.0, 3000.0)],
            snapshot_ms: Some(2500.0),
        },
        Act {
            name: "reset",
            title: "Reset pressed and released",
            promise: "The laser goes dark; only after the sensor has seen a cut stripe, and a whole one again, do the relays close.",
            length_ms: 3000.0,
            cues: vec![moment(1000.0, Action::PressReset)],
            checks: vec![
                Check::StaysOpen(0.0, 1140.0),
                Check::Closes(1000.0, PRESS_TO_CLOSED_MS),
                Check::StaysClosed(1650.0, 3000.0),
            ],
            snapshot_ms: None,
        },
        Act {
            name: "near_miss",
            title: "A carton passes just beyond the stripe",
            promise: "The robot keeps running: what does not cut the stripe does not stop it.",
            length_ms: 4000.0,
            cues: vec![during(
                300.0,
                3800.0,
                Action::Visit(Visit {
                    object: carton("carton", [140.0, 90.0, 55.0], 0.0, "cardboard"),
                    from_mm: [-620.0, 90.0],
                    to_mm: [260.0, 68.0],
                    speed_mm_per_s: 560.0,
                }),
            )],
            checks: vec![Check::StaysClosed(0.0, 4000.0)],
            snapshot_ms: Some(1700.0),
        },
    ]
}

fn intrusions() -> Vec<Act> {
    let path_mm = vec![[0.0, 0.0], [10.0, 60.0], [-12.0, 150.0], [14.0, 260.0], [-30.0, 420.0]];
    let cable = Visit {
        object: plain("cable", Shape::Cable { diameter_mm: 9.0, path_mm }, 0.0, "cable_orange"),
        from_mm: [-130.0, 140.0],
        to_mm: [-110.0, -90.0],
        speed_mm_per_s: 500.0,
    };
    let block = Visit {
        object: carton("box", [120.0, 90.0, 60.0], 0.0, "cardboard"),
        from_mm: [120.0, 190.0],
        to_mm: [60.0, -75.0],
        speed_mm_per_s: 500.0,
    };
    let arm = Visit {
        object: SceneObject { yaw_degrees: 10.0, ..hand("hand", 52.0, 0.0) },
        from_mm: [10.0, 330.0],
        to_mm: [-20.0, -150.0],
        speed_mm_per_s: 700.0,
    };
    vec![
        intrusion(
            "cable",
            "A 9 mm cable slides in",
            "The stripe is cut: the relays open, and a reset does nothing while the cable is there.",
            cable,
            StopCause::StripeCut,
            false,
        ),
        intrusion(
            "box",
            "A 60 mm box slides in",
            "The relays open, and the controller measures by itself how high the light climbs on it.",
            block,
            StopCause::StripeCut,
            false,
        ),
        intrusion(
            "hand",
            "A hand reaches in",
            "The relays open, and stay open until the hand is gone and somebody has pressed the button.",
            arm,
            StopCause::StripeCut,
            false,
        ),
    ]
}

fn link_faults() -> Vec<Act> {
    let lie = Visit {
        object: plain("can", Shape::Post { diameter_mm: 60.0, height_mm: 110.0 }, 0.0, "plastic_blue"),
        from_mm: [190.0, 150.0],
        to_mm: [170.0, -45.0],
        speed_mm_per_s: 500.0,
    };
    vec![
        intrusion(
            "false_clear",
            "The host claims \"clear\" while a can cuts the stripe",
            "The relays open all the same: the host may ask for a stop, but cannot forbid one.",
            lie,
            StopCause::StripeCut,
            true,
        ),
        disturbance(
            "host_stop",
            "The host asks for a stop",
            "One voice is enough to stop: the relays open although the stripe is whole.",
            Action::RequestStop,
            Check::Opens(Trigger::At(500.0), MESSAGE_TO_COMMAND_MS, StopCause::HostRequest),
        ),
        disturbance(
            "dropped",
            "A burst of 20 lost messages",
            "Silence is no permission: the relays open when the link's time is up.",
            Action::DropMessages,
            Check::Opens(Trigger::At(500.0), SILENCE_TO_COMMAND_MS, StopCause::LinkTimeout),
        ),
        disturbance(
            "damaged",
            "Bits flip on the way",
            "A damaged message is never used; the second one opens the relays.",
            Action::DamageMessages,
            Check::Opens(Trigger::At(500.0), BAD_MESSAGES_TO_COMMAND_MS, StopCause::LinkCorruption),
        ),
        disturbance(
            "repeated",
            "A stuck host sends the same message again",
            "Yesterday's clear floor is no clear floor: a repeated number opens the relays.",
            Action::RepeatMessages,
            Check::Opens(Trigger::At(500.0), BAD_MESSAGES_TO_COMMAND_MS, StopCause::LinkRepetition),
        ),
    ]
}

fn ending() -> Vec<Act> {
    vec![
        Act {
            snapshot_ms: Some(800.0),
            ..disturbance(
                "laser_off",
                "The laser fails",
                "No stripe is not a clear floor: the relays open.",
                Action::LaserDead,
                Check::Opens(Trigger::At(500.0), LIGHT_TO_COMMAND_MS, StopCause::StripeMissing),
            )
        },
        Act {
            snapshot_ms: Some(800.0),
            ..disturbance(
                "covered",
                "Something covers the lens",
                "A dark picture is not a clear floor: the relays open.",
                Action::LensCovered,
                Check::Opens(Trigger::At(500.0), LIGHT_TO_COMMAND_MS, StopCause::StripeCut),
            )
        },
        disturbance(
            "frozen",
            "The camera freezes",
            "A perfect picture of a clear floor that does not flicker as the laser does opens the relays.",
            Action::CameraFrozen,
            Check::Opens(Trigger::At(500.0), FROZEN_TO_COMMAND_MS, StopCause::Liveness),
        ),
        replay(),
        Act {
            name: "hang",
            title: "The safety controller's own program hangs",
            promise: "The watchdog resets it; the relays open and stay open until somebody resets.",
            length_ms: 5000.0,
            cues: vec![moment(500.0, Action::HangController), moment(3000.0, Action::PressReset)],
            checks: vec![
                Check::StaysClosed(0.0, 490.0),
                Check::Opens(Trigger::At(500.0), HANG_TO_COMMAND_MS, StopCause::WatchdogReset),
                Check::StaysOpen(700.0, 3140.0),
                Check::Closes(3000.0, PRESS_TO_CLOSED_MS),
                Check::StaysClosed(3650.0, 5000.0),
            ],
            snapshot_ms: None,
        },
        Act {
            name: "clear",
            title: "Floor clear to the end",
            promise: "The relays stay closed: not one false stop.",
            length_ms: 3000.0,
            cues: Vec::new(),
            checks: vec![Check::StaysClosed(0.0, 3000.0)],
            snapshot_ms: None,
        },
    ]
}

/// An act in which the host replays live pictures of half a second ago, and answers the audit from them.
fn replay() -> Act {
    let cues = vec![during(500.0, 1300.0, Action::ReplayPictures), moment(1900.0, Action::PressReset)];
    let checks = vec![
        Check::StaysClosed(0.0, 490.0),
        Check::Opens(Trigger::At(500.0), REPLAY_TO_COMMAND_MS, StopCause::Liveness),
        Check::StaysOpen(1300.0, 2040.0),
        Check::Closes(1900.0, PRESS_TO_CLOSED_MS),
        Check::StaysClosed(2550.0, 3000.0),
    ];
    Act {
        name: "replayed",
        title: "The host replays pictures of half a second ago",
        promise: "Pictures that flicker, but not as the laser does now, open the relays.",
        length_ms: 3000.0,
        cues,
        checks,
        snapshot_ms: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minute_lasts_a_minute_and_everything_lies_within_its_act() {
        let acts = minute();
        let total: f64 = acts.iter().map(|act| act.length_ms).sum();
        assert_eq!(total, 60_000.0, "the minute");
        for act in &acts {
            for cue in &act.cues {
                assert!(
                    0.0 <= cue.at_ms && cue.at_ms <= cue.until_ms && cue.until_ms <= act.length_ms,
                    "{}",
                    act.name
                );
            }
            for check in &act.checks {
                let (from, to) = match *check {
                    Check::StaysOpen(from, to) | Check::StaysClosed(from, to) => (from, to),
                    Check::Measures(at, _) => (at, at),
                    Check::Closes(at, within) | Check::Opens(Trigger::At(at), within, _) => (at, at + within),
                    Check::Opens(Trigger::FirstInterruptedLight, ..) => (0.0, 0.0),
                };
                assert!(from <= to && to <= act.length_ms, "{}: {check:?}", act.name);
            }
            assert!(act.snapshot_ms.is_none_or(|at| at < act.length_ms));
        }
        let names: std::collections::BTreeSet<_> = acts.iter().map(|act| act.name).collect();
        assert_eq!(names.len(), acts.len(), "names are unique");
    }

    #[test]
    fn visitors_come_stay_and_leave() {
        let visit = Visit {
            object: hand("hand", 50.0, 0.0),
            from_mm: [0.0, 300.0],
            to_mm: [0.0, -100.0],
            speed_mm_per_s: 400.0,
        };
        let across = |elapsed: f64| visit.object_at(elapsed, 4000.0).across_mm;
        assert_eq!([across(0.0), across(500.0), across(1000.0)], [300.0, 100.0, -100.0]);
        assert_eq!([across(2000.0), across(3500.0), across(4000.0)], [-100.0, 100.0, 300.0]);
    }
}
