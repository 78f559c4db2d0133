//! Tiers 1 and 2 over the whole picture: gaps in millimetres, what stands in them and how high it is.
//!
//! Tier 1 is the code that the microcontroller runs ([`StripeMonitor`]), fed with every image column. Tier 2 sees
//! more than the line-scan can carry: also stripe points in columns in which the floor is lit elsewhere.

use nearfield_shared::columns::{Decimation, GeometryError};
use nearfield_shared::cutoff::Gap;
use nearfield_shared::height::SizeClass;
use nearfield_shared::limits::{SHORTEST_STRIPE_MM, VOTE_FRAMES, WEAKEST_SIGNAL};
use nearfield_shared::monitor::{StripeMonitor, StripeReport};
use nearfield_shared::rig::{Rig, Stripe};
use nearfield_shared::run_over::RunOverPermit;
use nearfield_shared::units::Millimetres;

use super::extractor::{Extractor, ForeignFrame};
use super::grid::MOST_COLUMNS;
use super::profile::Profile;
use super::rig_deviation::RigDeviation;
use crate::capture::FrameView;

/// Points of one object lie no farther apart than this along the stripe, millimetres: the least distance at which the
/// floor between two objects would be seen by tier 1.
const OBJECT_SEPARATION_MM: f32 = 8.0;
/// An object's height is the height that this share of its points do not exceed: its edge counts, one glint does not.
const HEIGHT_QUANTILE: f32 = 0.95;
/// Heights are smoothed over this many points of a line before, so that the quantile is not the noise's.
const SMOOTHED_POINTS: usize = 5;

/// An object that explains less than this share of its gap has no known height: what is seen is a rim, and the rest may be
/// higher. The gap is explained where its light is seen on the object, and where the object hides the floor.
const LEAST_EXPLAINED: f32 = 0.7;
/// The same for a drop: its edges hide next to nothing of it, and what looks like one may be the rim of something bright.
const LEAST_EXPLAINED_DROP: f32 = 0.8;
/// So many points this far above the floor and as many this far below it contradict each other: the rims of something
/// overexposed look like that, and so may a thing in a hole. Millimetres.
const POINTS_OF_A_SIDE: usize = 3;
const SIDE_MM: f32 = 2.0;
/// A point stands for so much of the stripe to both sides, millimetres ...
const POINT_REACH_MM: f32 = 2.0;
/// ... and for so many image columns in which it may hide the floor.
const POINT_COLUMNS: usize = 2;

/// The mean magnitude of a normal value is this part of its standard deviation, inverted.
const MEAN_TO_DEVIATION: f32 = 1.25;
/// The median of five normal values varies by this share of their standard deviation.
const MEDIAN_SHARE: f32 = 0.54;
/// What a row is off along a whole object, pixels: speckle, clipping and the surface's own texture move all alike.
const ROW_ERROR_PIXELS: f32 = 0.2;

/// Something that takes the stripe off the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripeObject {
    /// First laser ray that it stops.
    pub start: Millimetres,
    /// Last laser ray that it stops.
    pub end: Millimetres,
    /// Height over the floor, negative for a drop; `None` where the stripe is not seen on it.
    pub height: Option<Millimetres>,
    /// One standard deviation of the height, from how its points scatter and how finely the picture resolves heights there,
    /// and from the rig's own error as far as that is known ([`Analyser::with_rig_deviation`]). `None` without a height.
    pub uncertainty: Option<Millimetres>,
    /// Its class; without a height, and for a drop, it is unknown.
    pub size: SizeClass,
}

/// A point off the floor, its height smoothed along its line.
#[derive(Debug, Clone, Copy)]
struct Sample {
    place: f32,
    height: f32,
    /// How far the point itself lies from that.
    deviation: f32,
    /// Height that one row of pixels spans here.
    per_row: f32,
}

/// Full-frame analysis of one rig's frames, one after the other.
#[derive(Debug, Clone)]
pub struct Analyser {
    extractor: Extractor,
    monitor: Box<StripeMonitor<MOST_COLUMNS>>,
    report: StripeReport,
    gaps: Vec<Gap>,
    objects: Vec<StripeObject>,
    sorted: Vec<Sample>,
    smoothed: Vec<f32>,
    /// For each watched column: does a point off the floor tell why its floor is dark?
    explained: Vec<bool>,
    stripe: Stripe,
    rig_deviation: RigDeviation,
}

impl Analyser {
    /// Prepares for a rig.
    ///
    /// # Errors
    /// [`GeometryError`] if the rig's picture does not resolve the stripe.
    pub fn new(rig: &Rig) -> Result<Self, GeometryError> {
        Self::of(rig, Extractor::new(rig)?)
    }

    /// Prepares for a rig whose sheet of light is so thick at half of its brightness, millimetres: see
    /// [`Extractor::with_sheet`].
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_sheet(rig: &Rig, sheet_mm: f64) -> Result<Self, GeometryError> {
        Self::of(rig, Extractor::with_sheet(rig, sheet_mm)?)
    }

    fn of(rig: &Rig, extractor: Extractor) -> Result<Self, GeometryError> {
        let mut monitor = Box::new(StripeMonitor::new());
        monitor.configure(rig, Decimation::none(rig.image().width))?;
        let columns = usize::from(rig.image().width);
        Ok(Self {
            stripe: *rig.stripe(),
            rig_deviation: RigDeviation::default(),
            extractor,
            monitor,
            report: StripeReport::default(),
            gaps: Vec::with_capacity(columns),
            objects: Vec::with_capacity(columns),
            sorted: Vec::with_capacity(4 * columns),
            smoothed: Vec::with_capacity(4 * columns),
            explained: Vec::with_capacity(columns),
        })
    }

    /// The same, knowing how unsure the rig itself makes a height: it then counts in each object's
    /// [`StripeObject::uncertainty`].
    #[must_use]
    pub fn with_rig_deviation(self, rig_deviation: RigDeviation) -> Self {
        Self { rig_deviation, ..self }
    }

    /// The same, for frames that follow one another: see [`Extractor::with_background_subtraction`].
    #[must_use]
    pub fn with_background_subtraction(self) -> Self {
        Self { extractor: self.extractor.with_background_subtraction(), ..self }
    }

    /// Forgets the frames seen: the vote starts anew.
    pub fn reset(&mut self) {
        self.monitor.reset();
        self.extractor.forget();
    }

    /// Takes the next frame of a sequence.
    ///
    /// # Errors
    /// [`ForeignFrame`]; the frame then counts as one without any stripe.
    pub fn update(&mut self, frame: &FrameView<'_>) -> Result<(), ForeignFrame> {
        let result = self.extractor.extract(frame);
        self.evaluate();
        result
    }

    /// The next frame of a sequence is lost: it counts as one without any stripe.
    pub fn lose_frame(&mut self) {
        self.extractor.forget();
        self.evaluate();
    }

    /// Judges a picture by itself: forgets what was before, and shows the picture until the vote is full.
    ///
    /// # Errors
    /// As [`Self::update`].
    pub fn judge(&mut self, frame: &FrameView<'_>) -> Result<(), ForeignFrame> {
        self.reset();
        let result = self.extractor.extract(frame);
        for _ in 0..VOTE_FRAMES {
            self.evaluate();
        }
        result
    }

    fn evaluate(&mut self) {
        self.gaps.clear();
        let gaps = &mut self.gaps;
        self.report = self.monitor.update_with(
            self.extractor.readings().iter().copied(),
            &RunOverPermit::NONE,
            |gap| gaps.push(gap),
            |_| {},
        );
        self.gaps.sort_unstable_by(|one, other| one.start.get().total_cmp(&other.start.get()));
        self.collect_objects();
    }

    fn collect_objects(&mut self) {
        self.objects.clear();
        self.sorted.clear();
        smooth_heights(&self.extractor, &mut self.sorted);
        self.sorted.sort_unstable_by(|one, other| one.place.total_cmp(&other.place));
        let apart = |one: &Sample, other: &Sample| other.place - one.place <= OBJECT_SEPARATION_MM;
        for points in self.sorted.chunk_by(apart) {
            let [first, .., last] = points else { continue };
            self.smoothed.clear();
            self.smoothed.extend(points.iter().map(|point| point.height));
            let height = Millimetres::new(robust_extreme(&mut self.smoothed));
            let size = if height > Millimetres::ZERO { SizeClass::of(height) } else { SizeClass::Unknown };
            let of_rig = self.rig_deviation.at(f32::midpoint(first.place, last.place), height.get());
            self.objects.push(StripeObject {
                start: Millimetres::new(first.place),
                end: Millimetres::new(last.place),
                height: Some(height),
                uncertainty: Some(Millimetres::new(deviation(points).hypot(of_rig))),
                size,
            });
        }
        let seen = self.objects.len();
        for gap in &self.gaps {
            let explained = self
                .objects
                .iter()
                .take(seen)
                .any(|object| object.start <= gap.end && object.end >= gap.start);
            if !explained {
                let (start, end) = (gap.start, gap.end);
                self.objects.push(StripeObject {
                    start,
                    end,
                    height: None,
                    uncertainty: None,
                    size: SizeClass::Unknown,
                });
            }
        }
        self.objects.sort_unstable_by(|one, other| one.start.get().total_cmp(&other.start.get()));
        self.join_objects();
        self.doubt_objects();
    }

    /// What lies in one gap, with no floor between, is one object: as high as its highest part.
    fn join_objects(&mut self) {
        let gaps = &self.gaps;
        self.objects.dedup_by(|next, before| {
            let one_gap = gaps.iter().any(|gap| {
                let middle = |object: &StripeObject| (object.start.get() + object.end.get()) / 2.0;
                let inside = |place: f32| (gap.start.get()..=gap.end.get()).contains(&place);
                inside(middle(next)) && inside(middle(before))
            });
            let (Some(height), Some(next_height)) = (before.height, next.height) else { return false };
            if one_gap {
                if next_height.get().abs() > height.get().abs() {
                    (before.height, before.uncertainty, before.size) =
                        (next.height, next.uncertainty, next.size);
                }
                before.end = Millimetres::new(before.end.get().max(next.end.get()));
            }
            one_gap
        });
    }

    /// Too little of an object is seen to say how high it is.
    fn doubt_objects(&mut self) {
        if self.objects.iter().all(|object| object.height.is_none()) {
            return;
        }
        self.explain_columns();
        for object in self.objects.iter_mut().filter(|object| object.height.is_some()) {
            let middle = f32::midpoint(object.start.get(), object.end.get());
            let gap = self.gaps.iter().find(|gap| (gap.start.get()..=gap.end.get()).contains(&middle));
            let watched = self.extractor.geometry().maps();
            let share = gap.map_or(1.0, |gap| {
                let inside = |place: f32| (gap.start.get()..=gap.end.get()).contains(&place);
                let (mut all, mut explained) = (0.0_f32, 0.0);
                for (map, is_explained) in watched.iter().zip(&self.explained) {
                    if inside(map.floor_place) {
                        (all, explained) = (all + 1.0, explained + f32::from(u8::from(*is_explained)));
                    }
                }
                if all > 0.0 { explained / all } else { 1.0 }
            });
            let within = |sample: &&Sample| {
                (object.start.get()..=object.end.get()).contains(&sample.place)
                    && sample.height.abs() >= SIDE_MM
            };
            let (all, raised) =
                self.sorted.iter().filter(within).fold((0, 0), |(all, raised), sample| {
                    (all + 1, raised + usize::from(sample.height > 0.0))
                });
            let is_both = raised.min(all - raised) >= POINTS_OF_A_SIDE;
            let is_drop = object.height.is_some_and(|height| height < Millimetres::ZERO);
            if is_both || share < if is_drop { LEAST_EXPLAINED_DROP } else { LEAST_EXPLAINED } {
                (object.height, object.uncertainty, object.size) = (None, None, SizeClass::Unknown);
            }
        }
    }

    /// Which columns do the points off the floor explain?
    fn explain_columns(&mut self) {
        let geometry = self.extractor.geometry();
        let watched = geometry.watched();
        let maps = geometry.maps();
        self.explained.clear();
        self.explained.resize(maps.len(), false);
        // Places rise or fall with the columns.
        let rises =
            maps.first().zip(maps.last()).is_some_and(|(first, last)| first.floor_place < last.floor_place);
        for point in self.extractor.points() {
            let own = (point.column + POINT_COLUMNS + 1).saturating_sub(watched.start);
            let from = point.column.saturating_sub(POINT_COLUMNS + watched.start);
            let (low, high) = (point.place - POINT_REACH_MM, point.place + POINT_REACH_MM);
            let before = |limit: f32, is_lower: bool| {
                maps.partition_point(|map| (map.floor_place < limit) == is_lower)
            };
            let of_ray = if rises {
                before(low, true)..before(high, true)
            } else {
                before(high, false)..before(low, false)
            };
            for range in [from..own, of_ray] {
                let end = range.end.min(maps.len());
                self.explained[range.start.min(end)..end].fill(true);
            }
        }
    }

    /// The extraction of the last frame.
    #[must_use]
    pub const fn extractor(&self) -> &Extractor {
        &self.extractor
    }

    /// What the monitor found with the last frame.
    #[must_use]
    pub const fn report(&self) -> &StripeReport {
        &self.report
    }

    /// The gaps of the vote, along the stripe.
    #[must_use]
    pub fn gaps(&self) -> &[Gap] {
        &self.gaps
    }

    /// The objects of the last frame, along the stripe.
    #[must_use]
    pub fn objects(&self) -> &[StripeObject] {
        &self.objects
    }

    /// Heights along the stripe in the last frame: for people and recordings, worked out when it is asked for.
    #[must_use]
    pub fn profile(&self) -> Profile {
        Profile::of(&self.extractor, self.stripe)
    }

    /// Is there a stripe in the last frame, on the floor or off it? Less than [`SHORTEST_STRIPE_MM`] of it in all is
    /// texture.
    #[must_use]
    pub fn is_stripe_found(&self) -> bool {
        let geometry = self.extractor.geometry();
        let readings = self.extractor.readings().get(geometry.watched()).unwrap_or(&[]);
        let seen: f32 = geometry
            .maps()
            .windows(2)
            .zip(readings)
            .filter(|(_, reading)| reading.quality >= WEAKEST_SIGNAL)
            .map(|(pair, _)| (pair[1].floor_place - pair[0].floor_place).abs())
            .sum();
        f64::from(seen) >= SHORTEST_STRIPE_MM
    }
}

/// Each point's height becomes the median around it on its line. The points come line by line.
fn smooth_heights(extractor: &Extractor, samples: &mut Vec<Sample>) {
    let points = extractor.points();
    for (index, point) in points.iter().enumerate() {
        let mut around = [0.0; SMOOTHED_POINTS];
        let mut count = 0;
        let half = SMOOTHED_POINTS / 2;
        for other in &points[index.saturating_sub(half)..(index + half + 1).min(points.len())] {
            if other.line == point.line {
                around[count] = other.height;
                count += 1;
            }
        }
        let (_, median, _) = around[..count].select_nth_unstable_by(count / 2, f32::total_cmp);
        samples.push(Sample {
            place: point.place,
            height: *median,
            deviation: (point.height - *median).abs(),
            per_row: extractor.geometry().map(point.column).map_or(0.0, |map| map.height_per_row.abs()),
        });
    }
}

/// One standard deviation of an object's height.
fn deviation(points: &[Sample]) -> f32 {
    let count = points.len() as f32;
    let mean = |value: fn(&Sample) -> f32| points.iter().map(value).sum::<f32>() / count;
    let scatter = MEAN_TO_DEVIATION * mean(|point| point.deviation);
    (MEDIAN_SHARE * scatter).hypot(ROW_ERROR_PIXELS * mean(|point| point.per_row))
}

/// The height that represents an object: a high quantile, or for a drop the corresponding low one.
fn robust_extreme(heights: &mut [f32]) -> f32 {
    if heights.is_empty() {
        return f32::NAN;
    }
    let raised = heights.iter().filter(|height| **height > 0.0).count();
    let share = if 2 * raised >= heights.len() { HEIGHT_QUANTILE } else { 1.0 - HEIGHT_QUANTILE };
    let rank = (share * (heights.len() - 1) as f32).round() as usize;
    let (_, height, _) = heights.select_nth_unstable_by(rank, f32::total_cmp);
    *height
}
