//! The same thing from picture to picture: tracks along the floor while the robot moves.

use crate::footprint::{BoxPixels, FloorPoint, Footprint};
use nearfield_shared::action::{Category, action_for};
use nearfield_shared::height::SizeClass;
use nearfield_shared::rig::Rig;
use nearfield_shared::units::Micros;

/// One detection of tier 3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// What it is taken for.
    pub category: Category,
    /// Calibrated probability that this is right, 0 to 1.
    pub confidence: f64,
    /// Where in the picture.
    pub seen: BoxPixels,
}

/// Tier 3's answer to one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer<'a> {
    /// It has looked, and this is what it saw: perhaps nothing.
    Seen(&'a [Sighting]),
    /// It has not answered in time, has failed, or has answered nonsense. Never to be taken for "nothing there".
    Unknown,
}

/// How the robot has moved since the picture before, in its own frame of then: millimetres and radians
/// (counter-clockwise seen from above).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Along the robot's edge.
    pub x: f64,
    /// Outward.
    pub y: f64,
    /// Turn.
    pub turn: f64,
}

impl Motion {
    /// Where a point that lies still on the floor is now.
    #[must_use]
    pub fn carry(&self, point: FloorPoint) -> FloorPoint {
        let (sine, cosine) = self.turn.sin_cos();
        let (x, y) = (point.x - self.x, point.y - self.y);
        FloorPoint { x: cosine * x + sine * y, y: cosine * y - sine * x }
    }
}

/// Sightings that a track remembers.
pub const MEMORY: usize = 5;

/// One thing on the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Names it for people, from 1 on.
    pub number: u64,
    /// Where it is now.
    pub footprint: Footprint,
    /// Exposure time of the newest picture that showed it.
    pub last_seen: Micros,
    /// Pictures that showed it.
    pub sightings: u32,
    /// What it was taken for, newest first.
    memory: Vec<(Category, f64)>,
}

impl Track {
    /// What it is, by all its remembered sightings: a person if any says so, else what all say, else unknown.
    #[must_use]
    pub fn category(&self) -> Category {
        if self.memory.iter().any(|(category, _)| *category == Category::Human) {
            return Category::Human;
        }
        match self.memory.split_first() {
            Some(((newest, _), others)) if others.iter().all(|(category, _)| category == newest) => *newest,
            _ => Category::Unknown,
        }
    }

    /// The least of the remembered confidences.
    #[must_use]
    pub fn confidence(&self) -> f64 {
        self.memory.iter().map(|(_, confidence)| *confidence).fold(1.0, f64::min)
    }

    /// Has it been seen often enough to be believed to be what it seems? (That there is *something* is believed at once.)
    #[must_use]
    pub const fn is_confirmed(&self) -> bool {
        self.sightings >= 3
    }

    fn see(&mut self, at: Micros, sighting: &Sighting, footprint: Footprint) {
        self.footprint = footprint;
        self.last_seen = at;
        self.sightings = self.sightings.saturating_add(1);
        self.memory.insert(0, (sighting.category, sighting.confidence));
        self.memory.truncate(MEMORY);
    }
}

/// Sightings of one thing lie no farther apart than this from picture to picture, millimetres, beyond the robot's own motion:
/// a person's foot at 1.6 m/s in 60 ms.
const GATE: f64 = 100.0;
/// A thing that a working detector has not seen for so long is gone.
const FORGET_AFTER: Micros = Micros::from_millis(600);

/// Follows everything on the floor.
#[derive(Debug, Clone)]
pub struct Tracker {
    rig: Rig,
    tracks: Vec<Track>,
    next_number: u64,
    last_answer: Option<Micros>,
}

impl Tracker {
    /// Nothing seen yet.
    #[must_use]
    pub const fn new(rig: Rig) -> Self {
        Self { rig, tracks: Vec::new(), next_number: 1, last_answer: None }
    }

    /// All tracks.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// The rig.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Exposure time of the newest picture that tier 3 has answered; `None` = never.
    #[must_use]
    pub const fn last_answer(&self) -> Option<Micros> {
        self.last_answer
    }

    /// Moves all tracks with the robot.
    pub fn move_on(&mut self, motion: &Motion) {
        for track in &mut self.tracks {
            track.footprint.near_left = motion.carry(track.footprint.near_left);
            track.footprint.near_right = motion.carry(track.footprint.near_right);
        }
    }

    /// Takes tier 3's answer to the picture exposed at `at`. An unknown answer changes nothing: what was there is still
    /// there, and gets older. Sightings without a place on the floor are taken as at the picture's lower edge by nobody:
    /// they are returned as their number.
    pub fn observe(&mut self, at: Micros, answer: &Answer<'_>) -> usize {
        let Answer::Seen(sightings) = answer else { return 0 };
        self.last_answer = Some(at);
        // The most restrictive first: a person's track is not given away to a tool beside it.
        let mut order: Vec<&Sighting> = sightings.iter().collect();
        order.sort_by_key(|sighting| core::cmp::Reverse(action_for(sighting.category, SizeClass::Unknown)));
        let mut taken = vec![false; self.tracks.len()];
        let mut placeless = 0;
        for sighting in order {
            let Some(footprint) = Footprint::of(&self.rig, &sighting.seen) else {
                placeless += 1;
                continue;
            };
            match self.nearest(&footprint, &taken) {
                Some(index) => {
                    taken[index] = true;
                    self.tracks[index].see(at, sighting, footprint);
                }
                None => {
                    let number = self.next_number;
                    self.next_number += 1;
                    let memory = vec![(sighting.category, sighting.confidence)];
                    self.tracks.push(Track { number, footprint, last_seen: at, sightings: 1, memory });
                    taken.push(true);
                }
            }
        }
        self.tracks.retain(|track| at.since(track.last_seen) <= FORGET_AFTER);
        placeless
    }

    /// The nearest track that is not taken yet, within the gate.
    fn nearest(&self, footprint: &Footprint, taken: &[bool]) -> Option<usize> {
        let place = footprint.near();
        let distance = |track: &Track| {
            let other = track.footprint.near();
            (place.x - other.x).hypot(place.y - other.y)
        };
        self.tracks
            .iter()
            .enumerate()
            .filter(|(index, _)| !taken[*index])
            .map(|(index, track)| (index, distance(track)))
            .filter(|(_, distance)| *distance <= GATE)
            .min_by(|one, other| one.1.total_cmp(&other.1))
            .map(|(index, _)| index)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
    use nearfield_shared::laser::Laser;
    use nearfield_shared::rig::{ImageSize, Stripe};

    /// A camera 400 mm over the robot's edge, looking 50 degrees down at a stripe half a metre away.
    pub(crate) fn rig() -> Rig {
        let (sine, cosine) = 50.0_f64.to_radians().sin_cos();
        let rotation =
            [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, -sine, -cosine), Vector::new(0.0, cosine, -sine)];
        let unmoved = Pose { rotation, translation: Vector::default() };
        let translation = unmoved.to_camera(Vector::new(0.0, 0.0, 400.0)).scaled(-1.0);
        let intrinsics = Intrinsics {
            fx: 900.0,
            fy: 900.0,
            cx: 575.5,
            cy: 323.5,
            distortion: [-0.03, 0.01, 0.0, 0.0, 0.0],
        };
        let (rise, run) = 21.801_409_f64.to_radians().sin_cos();
        let laser = Laser {
            origin: Vector::new(0.0, 0.0, 200.0),
            normal: Vector::new(0.0, rise, run),
            offset: 200.0 * run,
        };
        let stripe = Stripe {
            point: Vector::new(0.0, 500.0, 0.0),
            direction: Vector::new(1.0, 0.0, 0.0),
            start: -300.0,
            end: 300.0,
        };
        let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
        Rig::new(ImageSize { width: 1152, height: 648 }, camera, laser, stripe).unwrap()
    }

    /// A sighting of something flat at this place of the floor.
    pub(crate) fn flat(rig: &Rig, category: Category, confidence: f64, x: f64, y: f64) -> Sighting {
        let pixel = |x: f64, y: f64| rig.camera().project(Vector::new(x, y, 0.0)).unwrap();
        let corners =
            [(-20.0, 0.0), (20.0, 0.0), (-20.0, 20.0), (20.0, 20.0)].map(|(dx, dy)| pixel(x + dx, y + dy));
        let least = |value: fn(&nearfield_shared::camera::Pixel) -> f64| {
            corners.iter().map(value).fold(f64::MAX, f64::min)
        };
        let seen = BoxPixels {
            left: least(|corner| corner.u),
            top: least(|corner| corner.v),
            right: -least(|corner| -corner.u),
            bottom: -least(|corner| -corner.v),
        };
        Sighting { category, confidence, seen }
    }

    fn at(picture: u64) -> Micros {
        Micros::from_millis(40 * picture)
    }

    #[test]
    fn a_thing_that_lies_still_is_one_track_while_the_robot_drives_towards_it() {
        let rig = rig();
        let mut tracker = Tracker::new(rig);
        let motion = Motion { x: 0.0, y: 12.0, turn: 0.0 };
        for picture in 0..10 {
            tracker.move_on(&motion);
            let y = 650.0 - 12.0 * picture as f64;
            tracker.observe(at(picture), &Answer::Seen(&[flat(&rig, Category::Tool, 0.95, 30.0, y)]));
        }
        let [track] = tracker.tracks() else { panic!("{:?}", tracker.tracks()) };
        assert_eq!((track.sightings, track.category(), track.number), (10, Category::Tool, 1));
        assert!(track.is_confirmed() && (track.confidence() - 0.95).abs() < 1e-9);
        // Not seen for two pictures, it is where the motion says.
        tracker.move_on(&motion);
        tracker.move_on(&motion);
        let near = tracker.tracks()[0].footprint.near();
        assert!((near.y - (650.0 - 12.0 * 11.0)).abs() < 1.5, "{near:?}");
    }

    #[test]
    fn a_turn_carries_points_to_the_other_side() {
        let ahead = FloorPoint { x: 0.0, y: 500.0 };
        let turned = Motion { turn: 0.1, ..Motion::default() }.carry(ahead);
        // The robot turns counter-clockwise, so what was ahead is to its right now.
        assert!(turned.x > 49.0 && turned.y < 500.0 && (turned.x.hypot(turned.y) - 500.0).abs() < 1e-9);
        let moved = Motion { x: 5.0, y: -3.0, turn: 0.0 }.carry(ahead);
        assert_eq!(moved, FloorPoint { x: -5.0, y: 503.0 });
    }

    #[test]
    fn one_sighting_of_a_person_makes_it_a_person() {
        let rig = rig();
        let mut tracker = Tracker::new(rig);
        for (picture, category) in
            [Category::Tool, Category::Tool, Category::Human, Category::Tool].into_iter().enumerate()
        {
            tracker.observe(at(picture as u64), &Answer::Seen(&[flat(&rig, category, 0.9, 0.0, 500.0)]));
        }
        assert_eq!(tracker.tracks()[0].category(), Category::Human);
    }

    #[test]
    fn disagreement_is_unknown_and_the_least_confidence_counts() {
        let rig = rig();
        let mut tracker = Tracker::new(rig);
        for (picture, (category, confidence)) in
            [(Category::Tool, 0.9), (Category::Material, 0.5), (Category::Tool, 0.99)].into_iter().enumerate()
        {
            tracker
                .observe(at(picture as u64), &Answer::Seen(&[flat(&rig, category, confidence, 0.0, 500.0)]));
        }
        assert_eq!(tracker.tracks()[0].category(), Category::Unknown);
        assert!((tracker.tracks()[0].confidence() - 0.5).abs() < 1e-9);
        // It is forgotten after enough pictures that agree.
        for picture in 3..3 + MEMORY as u64 {
            tracker.observe(at(picture), &Answer::Seen(&[flat(&rig, Category::Tool, 0.9, 0.0, 500.0)]));
        }
        assert_eq!(tracker.tracks()[0].category(), Category::Tool);
    }

    #[test]
    fn an_unknown_answer_is_not_an_empty_one() {
        let rig = rig();
        let mut tracker = Tracker::new(rig);
        tracker.observe(at(0), &Answer::Seen(&[flat(&rig, Category::Part, 0.9, 0.0, 500.0)]));
        for picture in 1..100 {
            tracker.observe(at(picture), &Answer::Unknown);
        }
        assert_eq!(tracker.tracks().len(), 1, "nobody has looked since");
        assert_eq!(tracker.last_answer(), Some(at(0)));
        tracker.observe(at(100), &Answer::Seen(&[]));
        assert!(tracker.tracks().is_empty(), "somebody has looked, and it is gone");
    }

    #[test]
    fn two_things_side_by_side_stay_two() {
        let rig = rig();
        let mut tracker = Tracker::new(rig);
        for picture in 0..6 {
            let tool = flat(&rig, Category::Tool, 0.9, -60.0, 500.0);
            let hand = flat(&rig, Category::Human, 0.6, 20.0, 500.0);
            let seen = if picture % 2 == 0 { [tool, hand] } else { [hand, tool] };
            tracker.observe(at(picture), &Answer::Seen(&seen));
        }
        let mut categories: Vec<_> =
            tracker.tracks().iter().map(|track| format!("{:?}", track.category())).collect();
        categories.sort();
        assert_eq!(categories, ["Human", "Tool"]);
    }

    #[test]
    fn a_sighting_without_a_place_is_counted() {
        let rig = rig();
        let mut tracker = Tracker::new(rig);
        let seen = BoxPixels { left: 0.0, right: 50.0, top: -4000.0, bottom: -3000.0 };
        let sighting = Sighting { category: Category::Human, confidence: 0.9, seen };
        assert_eq!(tracker.observe(at(0), &Answer::Seen(&[sighting])), 1);
        assert!(tracker.tracks().is_empty());
    }
}
