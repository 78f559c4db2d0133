//! What is really there: computed by following the laser's rays, never from a picture.
//!
//! The JSON (`schema: "nearfield-truth-1"`), all lengths in millimetres, s as the project's frames define it:
//!
//! * `stripe_mm`: first and last watched s; `laser_on`.
//! * `moment`: when the row of the stripe's middle was exposed, and how far the robot had come by then.
//! * `cutoff`: `trip` (an interruption, counting shifts of at least 5 mm seen from above, is at least 7 mm long),
//!   `no_trip` (none at all), `borderline` (between), `stripe_missing` (laser off).
//! * `intervals`: stretches that are `displaced` (the camera sees the light on an object), `hidden` (lit, but out of
//!   the camera's sight) or `dark` (the surface swallows the light); with the object's index, or null for the floor.
//! * `gaps`: the union of the intervals. `longest_gap_mm`: `any`, and `tolX` = only shifts of at least X mm seen from
//!   above count (plus everything hidden or dark). "Seen from above" is where the point would lie if the picture were
//!   warped onto the floor.
//! * `objects`: per object its true height, and over its lit and visible points the height's maximum, 95th percentile,
//!   median and minimum, and the s it covers; null where the stripe does not touch it.
//! * `profile`: per millimetre of s the object (-1 floor), height of the lit point, whether the camera sees it, and
//!   its pixel; with dirt on the lens also the share of its light that comes straight through (`clear`).
//! * `blur` (only where something moves while a row is exposed): the exposure, and how far the floor and each object move
//!   in it along and across the stripe. Gaps and heights are those of the exposure's middle.
//! * `dirt` (only with dirt on the lens): every spot by kind, middle, radius and strength, in pixels of the picture.
//!
//! A floor with waves is still floor: it is no object and makes no interval; `profile.height_mm` tells its height. Whether a
//! sensor takes it for floor is a question of the tolerance that it is set to.

mod circumstances;

use nearfield_shared::camera::Vector;
use serde::Serialize;

pub use self::circumstances::{Blur, Moment, SpotTruth};

use super::body::{FloorAxes, World};
use super::shape::Ray;
use super::view::View;
pub use crate::scene_file::ExpectedCutoff;

/// Distance between followed rays on the floor, millimetres.
const STEP_MM: f64 = 0.25;
/// Followed rays to one entry of the profile.
const STEPS_PER_PROFILE_ENTRY: usize = 4;
/// A surface that returns less of the laser's light than this is dark.
const DARK_ALBEDO: f32 = 0.008;
/// See the module's documentation, `cutoff`.
const TRIP_SHIFT_MM: f64 = 5.0;
const TRIP_LENGTH_MM: f64 = 7.0;

/// Why a stretch of the stripe is not on the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum IntervalKind {
    /// The camera sees the light elsewhere.
    Displaced,
    /// The camera does not see the lit point.
    Hidden,
    /// The surface swallows the light.
    Dark,
}

/// A stretch of the stripe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Span {
    /// First s.
    pub start_mm: f64,
    /// Last s.
    pub end_mm: f64,
    /// Its length.
    pub length_mm: f64,
}

/// A stretch with its reason.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Where.
    #[serde(flatten)]
    pub span: Span,
    /// Why.
    pub kind: IntervalKind,
    /// Index of the object that the laser hits; `None` for the floor.
    pub object: Option<usize>,
}

/// Longest gaps by the smallest shift that counts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LongestGaps {
    /// Every displaced, hidden or dark point counts.
    pub any: f64,
    /// Shifts from 1.5 mm on.
    #[serde(rename = "tol1.5")]
    pub tolerance_1_5: f64,
    /// Shifts from 3 mm on.
    #[serde(rename = "tol3")]
    pub tolerance_3: f64,
    /// Shifts from 5 mm on.
    #[serde(rename = "tol5")]
    pub tolerance_5: f64,
    /// Shifts from 8 mm on.
    #[serde(rename = "tol8")]
    pub tolerance_8: f64,
}

/// One object's part in the stripe.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectTruth {
    /// Its name in the scene.
    pub name: String,
    /// Its highest point (a pit's bottom: negative).
    pub true_height_mm: f64,
    /// True if the laser touches it and the camera sees that.
    pub on_stripe: bool,
    /// Heights of the lit and visible points; `None` if there are none.
    pub heights: Option<LitHeights>,
}

/// Heights of an object's lit and visible points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LitHeights {
    /// Highest.
    pub max_mm: f64,
    /// 95th percentile.
    pub p95_mm: f64,
    /// Median.
    pub median_mm: f64,
    /// Lowest.
    pub min_mm: f64,
    /// First s.
    pub start_mm: f64,
    /// Last s.
    pub end_mm: f64,
}

/// One entry per millimetre of s; all lists have the same length.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Profile {
    /// Stripe coordinate.
    pub s_mm: Vec<f64>,
    /// Index of the object that the ray hits, -1 for the floor.
    pub object: Vec<i32>,
    /// Height of the lit point.
    pub height_mm: Vec<f64>,
    /// True if the camera sees it.
    pub visible: Vec<bool>,
    /// Its column; `None` if it is not in the picture.
    pub column: Vec<Option<f64>>,
    /// Its row.
    pub row: Vec<Option<f64>>,
    /// The share of its light that comes straight through the dirt on the lens, 0 where it is not in the picture; empty for a
    /// clean lens.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub clear: Vec<f64>,
}

/// The truth about one picture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Truth {
    /// `nearfield-truth-1`.
    pub schema: &'static str,
    /// Picture's columns.
    pub width: usize,
    /// Picture's rows.
    pub height: usize,
    /// First and last watched s.
    pub stripe_mm: [f64; 2],
    /// When, and where the robot was.
    pub moment: Moment,
    /// Blur by motion, if there is any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blur: Option<Blur>,
    /// Dirt on the lens.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub dirt: Vec<SpotTruth>,
    /// False if the laser is off.
    pub laser_on: bool,
    /// What a correct sensor must say.
    pub cutoff: ExpectedCutoff,
    /// Longest gaps.
    pub longest_gap_mm: LongestGaps,
    /// Gaps of any kind.
    pub gaps: Vec<Span>,
    /// Their parts.
    pub intervals: Vec<Interval>,
    /// The objects.
    pub objects: Vec<ObjectTruth>,
    /// Per millimetre.
    pub profile: Profile,
}

/// One followed ray.
#[derive(Debug, Clone, Copy)]
struct Sample {
    s: f64,
    height: f64,
    body: Option<usize>,
    visible: bool,
    dark: bool,
    /// Distance across the stripe at which the point appears when the picture is warped onto the floor.
    shift: f64,
    pixel: Option<(f64, f64)>,
}

impl Sample {
    fn kind(&self) -> Option<IntervalKind> {
        if self.dark {
            Some(IntervalKind::Dark)
        } else if !self.visible {
            Some(IntervalKind::Hidden)
        } else {
            self.body.map(|_| IntervalKind::Displaced)
        }
    }

    fn interrupts(&self, smallest_shift: f64) -> bool {
        match self.kind() {
            None => false,
            Some(IntervalKind::Displaced) => self.shift.abs() >= smallest_shift,
            Some(IntervalKind::Hidden | IntervalKind::Dark) => true,
        }
    }
}

impl Truth {
    /// Follows the laser's rays through the world.
    #[must_use]
    pub(crate) fn of(view: &View, axes: &FloorAxes, world: &World, laser_on: bool) -> Self {
        let stripe = view.rig().stripe();
        let count = ((stripe.end - stripe.start) / STEP_MM).floor() as usize + 1;
        let samples: Vec<Sample> =
            (0..count).map(|i| follow(view, axes, world, stripe.start + i as f64 * STEP_MM)).collect();
        let longest = |shift: f64| {
            spans(&samples, |sample| sample.interrupts(shift))
                .iter()
                .map(|span| span.length_mm)
                .fold(0.0, f64::max)
        };
        let longest_gap_mm = LongestGaps {
            any: longest(0.0),
            tolerance_1_5: longest(1.5),
            tolerance_3: longest(3.0),
            tolerance_5: longest(TRIP_SHIFT_MM),
            tolerance_8: longest(8.0),
        };
        let cutoff = if !laser_on {
            ExpectedCutoff::StripeMissing
        } else if longest_gap_mm.tolerance_5 >= TRIP_LENGTH_MM {
            ExpectedCutoff::Trip
        } else if longest_gap_mm.any == 0.0 {
            ExpectedCutoff::NoTrip
        } else {
            ExpectedCutoff::Borderline
        };
        Self {
            schema: "nearfield-truth-1",
            width: view.width(),
            height: view.height(),
            stripe_mm: [stripe.start, stripe.end],
            moment: Moment::default(),
            blur: None,
            dirt: Vec::new(),
            laser_on,
            cutoff,
            longest_gap_mm,
            gaps: spans(&samples, |sample| sample.interrupts(0.0)),
            intervals: intervals(&samples),
            objects: objects(&samples, world),
            profile: profile(&samples),
        }
    }
}

fn follow(view: &View, axes: &FloorAxes, world: &World, s: f64) -> Sample {
    let rig = view.rig();
    let origin = rig.laser().origin;
    let floor = rig.stripe().at(s);
    let ray = Ray { start: origin, direction: floor.minus(origin) };
    // The ray ends on the floor at the latest; `trace` always meets something below a laser.
    let Some(surface) = world.trace(&ray) else {
        return Sample { s, height: 0.0, body: None, visible: false, dark: true, shift: 0.0, pixel: None };
    };
    let centre = rig.camera().pose.centre();
    let towards_eye = centre.minus(surface.point);
    let size = rig.image();
    let pixel = rig.camera().project(surface.point).map(|pixel| (pixel.u, pixel.v)).filter(|(u, v)| {
        (-0.5..f64::from(size.width) - 0.5).contains(u) && (-0.5..f64::from(size.height) - 0.5).contains(v)
    });
    let lifted = surface.point.plus(surface.normal.scaled(1e-3));
    let visible = pixel.is_some() && surface.normal.dot(towards_eye) > 0.0 && !world.blocked(centre, lifted);
    let body = surface.body.and_then(|index| world.bodies.get(index));
    Sample {
        s,
        height: surface.point.z,
        body: surface.body,
        visible,
        dark: body.is_some_and(|body| body.material.laser_albedo < DARK_ALBEDO && body.material.gloss == 0.0),
        shift: seen_from_above(centre, surface.point)
            .map_or(f64::INFINITY, |seen| axes.across.dot(seen.minus(floor))),
        pixel,
    }
}

/// Where the line of sight through a point meets the floor.
fn seen_from_above(eye: Vector, point: Vector) -> Option<Vector> {
    let drop = eye.z - point.z;
    (drop > 0.0).then(|| eye.plus(point.minus(eye).scaled(eye.z / drop)))
}

/// Runs of samples for which `holds`; each sample stands for one step of s.
fn spans(samples: &[Sample], holds: impl Fn(&Sample) -> bool) -> Vec<Span> {
    let mut runs: Vec<Span> = Vec::new();
    let mut open = false;
    for sample in samples {
        if holds(sample) {
            let end_mm = sample.s + STEP_MM / 2.0;
            match runs.last_mut() {
                Some(run) if open => run.end_mm = end_mm,
                _ => runs.push(Span { start_mm: sample.s - STEP_MM / 2.0, end_mm, length_mm: 0.0 }),
            }
        }
        open = holds(sample);
    }
    runs.iter_mut().for_each(|run| run.length_mm = run.end_mm - run.start_mm);
    runs
}

fn intervals(samples: &[Sample]) -> Vec<Interval> {
    samples
        .chunk_by(|a, b| (a.kind(), a.body) == (b.kind(), b.body))
        .filter_map(|run| {
            let (first, last) = (run.first()?, run.last()?);
            let (start_mm, end_mm) = (first.s - STEP_MM / 2.0, last.s + STEP_MM / 2.0);
            let span = Span { start_mm, end_mm, length_mm: end_mm - start_mm };
            Some(Interval { span, kind: first.kind()?, object: first.body })
        })
        .collect()
}

fn objects(samples: &[Sample], world: &World) -> Vec<ObjectTruth> {
    let describe = |(index, body): (usize, &super::body::Body)| {
        let lit: Vec<&Sample> = samples
            .iter()
            .filter(|sample| sample.body == Some(index) && sample.visible && !sample.dark)
            .collect();
        let mut sorted: Vec<f64> = lit.iter().map(|sample| sample.height).collect();
        sorted.sort_by(f64::total_cmp);
        let heights = lit.first().zip(lit.last()).map(|(first, last)| LitHeights {
            max_mm: quantile(&sorted, 1.0),
            p95_mm: quantile(&sorted, 0.95),
            median_mm: quantile(&sorted, 0.5),
            min_mm: quantile(&sorted, 0.0),
            start_mm: first.s,
            end_mm: last.s,
        });
        ObjectTruth {
            name: body.name.clone(),
            true_height_mm: body.height_mm,
            on_stripe: heights.is_some(),
            heights,
        }
    };
    world.bodies.iter().enumerate().map(describe).collect()
}

/// Quantile of sorted values, linear between neighbours.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len().saturating_sub(1)) as f64;
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    match (sorted.get(low), sorted.get(high)) {
        (Some(a), Some(b)) => a + (b - a) * (place - place.floor()),
        _ => f64::NAN,
    }
}

fn profile(samples: &[Sample]) -> Profile {
    let mut profile = Profile::default();
    for sample in samples.iter().step_by(STEPS_PER_PROFILE_ENTRY) {
        profile.s_mm.push(sample.s);
        profile.object.push(sample.body.and_then(|index| i32::try_from(index).ok()).unwrap_or(-1));
        profile.height_mm.push(sample.height);
        profile.visible.push(sample.visible);
        profile.column.push(sample.pixel.map(|(u, _)| u));
        profile.row.push(sample.pixel.map(|(_, v)| v));
    }
    profile
}
