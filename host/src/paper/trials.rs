//! The paper's detection trials, made again in the twin: kinds of objects in four directions at five places along the stripe,
//! by this project's vision and by the paper's own pipeline, on the same pictures.
//!
//! The rig is the paper's first tier: camera 500 mm and laser 200 mm over the floor at one end of the stripe, which is far away and
//! coarse at the other end.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Serialize;

use super::heights::PaperHeights;
use super::{PaperMethod, table::Count};
use crate::twin::gallery::{SIDE, hand, plain};
use crate::twin::scene::{Floor, FloorKind, Scene, SceneObject, Shape};
use crate::twin::{ExpectedCutoff, Twin, View};
use crate::vision::Analyser;

/// Directions of an object, degrees; the paper's.
pub const DIRECTIONS: [u16; 4] = [0, 90, 180, 270];
/// Places, as shares of the stripe from the near end to the far one.
pub const PLACES: [f64; 5] = [0.08, 0.3, 0.5, 0.7, 0.92];
/// Floors that take turns.
const FLOORS: [FloorKind; 3] = [FloorKind::Concrete, FloorKind::EpoxyGrey, FloorKind::Tiles];
/// Clean floors, each of all kinds with another pattern.
const CLEAN_SCENES: u64 = 24;

/// One picture's outcome.
#[derive(Debug, Clone, Serialize)]
pub struct Trial {
    /// What lies there; "nothing" for a clean floor.
    pub object: &'static str,
    /// Turned by, degrees.
    pub direction_degrees: u16,
    /// Index into [`PLACES`].
    pub place: usize,
    /// Must the sensor trip?
    pub expected_trip: bool,
    /// Does this project's vision?
    pub ours: bool,
    /// Does the paper's pipeline?
    pub paper: bool,
}

/// Everything that is laid on the stripe, around its own middle.
fn objects() -> Vec<(&'static str, SceneObject)> {
    let block = |width_mm: f64, depth_mm: f64, height_mm: f64, material: &str| {
        plain("object", Shape::Box { width_mm, depth_mm, height_mm }, -1.2 * height_mm, material)
    };
    let lying = |diameter_mm: f64, length_mm: f64, material: &str| {
        plain("object", Shape::Rod { diameter_mm, length_mm }, -1.2 * diameter_mm, material)
    };
    let cable = |diameter_mm: f64| {
        let path_mm = vec![[-8.0, -120.0], [4.0, -40.0], [-4.0, 40.0], [8.0, 120.0]];
        plain("object", Shape::Cable { diameter_mm, path_mm }, 0.0, "rubber_black")
    };
    vec![
        ("box, 45 mm high", block(120.0, 90.0, 45.0, "cardboard")),
        ("extrusion, 40 mm", block(160.0, 40.0, 40.0, "aluminium")),
        ("hand", hand("object", 50.0, -150.0)),
        ("leg", plain("object", Shape::Post { diameter_mm: 110.0, height_mm: 400.0 }, -40.0, "denim")),
        ("wrench, 6 mm thick", block(150.0, 22.0, 6.0, "steel")),
        ("screwdriver, 22 mm", lying(22.0, 110.0, "plastic_yellow")),
        ("marker, 12 mm", lying(12.0, 130.0, "grey_card")),
        ("connector, 12 mm", block(28.0, 18.0, 12.0, "plastic_yellow")),
        ("bolt, 10 mm", lying(10.0, 50.0, "steel")),
        ("nut, 8 mm high", plain("object", Shape::Post { diameter_mm: 15.0, height_mm: 8.0 }, -6.0, "steel")),
        ("cable, 6 mm", cable(6.0)),
        ("wire, 3 mm", cable(3.0)),
    ]
}

/// How many pictures the trials have.
#[must_use]
pub fn count() -> u64 {
    (objects().len() * DIRECTIONS.len() * PLACES.len()) as u64 + CLEAN_SCENES
}

/// Plays all trials with pictures so many pixels wide; `done` is called after each.
///
/// # Errors
/// A rig or scene that cannot be used: a mistake in this table.
pub fn play(width: u16, mut done: impl FnMut()) -> anyhow::Result<Vec<Trial>> {
    let rig = SIDE.with_width(width).rig()?;
    let view = Arc::new(View::new(&rig));
    let mut ours = Analyser::new(&rig)?;
    let mut paper = PaperMethod::new(&rig, PaperHeights::of(&rig, 0.0))?;
    let stripe = *rig.stripe();
    let mut trials = Vec::new();
    let mut look = |scene: &Scene, seed: u64, trial: Trial| -> anyhow::Result<()> {
        let twin = Twin::new(Arc::clone(&view), scene, seed)?;
        let expected_trip = match twin.truth(1.0).cutoff {
            ExpectedCutoff::Trip | ExpectedCutoff::StripeMissing => Some(true),
            ExpectedCutoff::NoTrip => Some(false),
            // Neither verdict would be wrong.
            ExpectedCutoff::Borderline => None,
        };
        if let Some(expected_trip) = expected_trip {
            let frame = twin.render(0, 1.0).to_rgb_frame()?;
            ours.judge(&frame.view())?;
            let verdict = Trial {
                expected_trip,
                ours: ours.report().is_cut(),
                paper: paper.judge(&frame)?.is_cut,
                ..trial
            };
            trials.push(verdict);
        }
        done();
        Ok(())
    };
    let mut seed = 7000;
    for (object, body) in objects() {
        for direction_degrees in DIRECTIONS {
            for (place, share) in PLACES.iter().enumerate() {
                seed += 1;
                let kind = FLOORS[seed as usize % FLOORS.len()];
                let along_mm = stripe.start * (1.0 - share) + stripe.end * share;
                let turned = body.yaw_degrees + f64::from(direction_degrees);
                let body = SceneObject { along_mm, yaw_degrees: turned, ..body.clone() };
                let floor = Floor { kind, ..Floor::default() };
                let scene = Scene { floor, objects: vec![body], ..Scene::default() };
                let trial = Trial {
                    object,
                    direction_degrees,
                    place,
                    expected_trip: true,
                    ours: false,
                    paper: false,
                };
                look(&scene, seed, trial)?;
            }
        }
    }
    for number in 0..CLEAN_SCENES {
        let kind = FloorKind::ALL[number as usize % FloorKind::ALL.len()];
        let scene = Scene { floor: Floor { kind, ..Floor::default() }, ..Scene::default() };
        let trial = Trial {
            object: "nothing",
            direction_degrees: 0,
            place: 0,
            expected_trip: false,
            ours: false,
            paper: false,
        };
        look(&scene, 9000 + number, trial)?;
    }
    Ok(trials)
}

/// Verdicts of both methods for some of the trials.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Pair {
    /// This project's.
    pub ours: Count,
    /// The paper's pipeline.
    pub paper: Count,
}

/// Counts trials by what `group` says about them, in the order of the groups' names.
#[must_use]
pub fn counted<K: Ord>(trials: &[Trial], group: impl Fn(&Trial) -> K) -> BTreeMap<K, Pair> {
    let mut counts: BTreeMap<K, Pair> = BTreeMap::new();
    for trial in trials {
        let pair = counts.entry(group(trial)).or_default();
        pair.ours.add(trial.expected_trip, trial.ours);
        pair.paper.add(trial.expected_trip, trial.paper);
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trials_are_counted_by_group_with_what_was_expected() {
        let trial = |object, expected_trip, ours, paper| Trial {
            object,
            direction_degrees: 0,
            place: 0,
            expected_trip,
            ours,
            paper,
        };
        let trials = [
            trial("box", true, true, false),
            trial("box", true, true, true),
            trial("nothing", false, false, true),
        ];
        let counts = counted(&trials, |trial| trial.object);
        assert_eq!((counts["box"].ours.trips, counts["box"].paper.misses), (2, 1));
        assert_eq!((counts["nothing"].ours.clear, counts["nothing"].paper.false_trips), (1, 1));
    }

    #[test]
    fn every_object_is_made_of_a_known_material() {
        for (name, body) in objects() {
            assert!(body.material.resolve().is_some(), "{name}");
        }
    }
}
