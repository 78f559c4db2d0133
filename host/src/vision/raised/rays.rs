//! Which rays of the laser reach the floor, and which are held by something above it.

use super::super::floor::FloorColumn;
use super::super::grid::Grid;
use super::RaisedPoint;

/// Length of the stretches in which rays are counted, millimetres.
const RAY_BIN_MM: f32 = 0.5;
/// Dark stretches are widened by this on both sides: the ray's place is known to about this, millimetres.
const RAY_MARGIN_MM: f32 = 1.5;
/// Rays this near to a dark stretch are looked at too, millimetres: the laser's line ends with the dark stretch, what
/// goes on beside it is a thing that is red itself.
const BESIDE_MM: f32 = 8.0;
/// A line of this length along the stripe is one whatever lies around it, millimetres ...
const LONG_LINE_MM: f32 = 12.0;
/// ... a shorter one must take at least this share of the dark stretch that it lies in.
const LEAST_EXPLAINED: f32 = 0.08;

/// Which rays of the laser reach the floor, in stretches of [`RAY_BIN_MM`].
#[derive(Debug, Clone)]
pub(super) struct Rays {
    start: f32,
    bins: Vec<Ray>,
    /// Rays that look lit and are held by a line off the floor.
    claimed: Vec<bool>,
    /// How many bins before each are dark.
    dark_before: Vec<u32>,
    /// Place of each grid column's floor point, millimetres.
    places: Vec<f32>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ray {
    /// It reaches the floor.
    Lit,
    /// It does, near to one that does not.
    Beside,
    /// It does not, and nothing is known of what it hits.
    Dark,
    /// It does not; a line explains where it ends.
    Taken,
}

impl Rays {
    pub(super) fn new(grid: &Grid) -> Self {
        let places: Vec<f32> = grid.columns().iter().map(|column| column.place).collect();
        let (low, high) = places.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), place| {
            (low.min(*place), high.max(*place))
        });
        let count = if low <= high { ((high - low) / RAY_BIN_MM) as usize + 1 } else { 0 };
        Self {
            start: low,
            bins: vec![Ray::Lit; count],
            claimed: vec![false; count],
            dark_before: vec![0; count + 1],
            places,
        }
    }

    /// Marks the dark stretches; true if there is one. A single dark column is not.
    pub(super) fn set(&mut self, floor: &[FloorColumn]) -> bool {
        self.bins.fill(Ray::Lit);
        self.claimed.fill(false);
        let mut any = false;
        for (index, columns) in floor.windows(2).enumerate() {
            if columns.iter().all(|column| !column.lit) {
                any = true;
                let (one, other) = (self.places[index], self.places[index + 1]);
                self.mark(one.min(other) - RAY_MARGIN_MM, one.max(other) + RAY_MARGIN_MM, Ray::Dark);
            }
        }
        let mut dark = 0;
        for (before, ray) in self.dark_before.iter_mut().skip(1).zip(&self.bins) {
            dark += u32::from(*ray == Ray::Dark);
            *before = dark;
        }
        self.mark_beside();
        any
    }

    /// Was any ray between two places dark when [`Self::set`] looked?
    pub(super) fn any_dark(&self, [low, high]: [f32; 2]) -> bool {
        // `as` saturates: what lies before the stripe begins with its first bin.
        let bin = |place: f32| ((place - self.start) / RAY_BIN_MM).floor() as usize;
        let end = bin(high).saturating_add(1).min(self.bins.len());
        let first = bin(low).min(end);
        self.dark_before[end] > self.dark_before[first]
    }

    fn mark_beside(&mut self) {
        const REACH: usize = (BESIDE_MM / RAY_BIN_MM) as usize;
        for backwards in [false, true] {
            let mut left = 0;
            for index in 0..self.bins.len() {
                let index = if backwards { self.bins.len() - 1 - index } else { index };
                match self.bins[index] {
                    Ray::Dark => left = REACH,
                    Ray::Lit if left > 0 => self.bins[index] = Ray::Beside,
                    _ => {}
                }
                left = left.saturating_sub(1);
            }
        }
    }

    fn mark(&mut self, low: f32, high: f32, as_what: Ray) {
        let bin = |place: f32| ((place - self.start) / RAY_BIN_MM).max(0.0) as usize;
        let (from, to) = (bin(low), (bin(high) + 1).min(self.bins.len()));
        if let Some(bins) = self.bins.get_mut(from..to) {
            bins.fill(as_what);
        }
    }

    /// Claims what looks lit within a line.
    pub(super) fn claim(&mut self, points: &[RaisedPoint]) {
        for pair in points.windows(2).filter(|pair| pair[0].beside || pair[1].beside) {
            let (low, high) = (pair[0].place.min(pair[1].place), pair[0].place.max(pair[1].place));
            let bin = |place: f32| ((place - self.start) / RAY_BIN_MM).max(0.0) as usize;
            let (from, to) = (bin(low), (bin(high) + 1).min(self.claimed.len()));
            if let Some(claimed) = self.claimed.get_mut(from..to) {
                claimed.fill(true);
            }
        }
    }

    pub(super) fn is_claimed(&self, place: f32) -> bool {
        let bin = (place - self.start) / RAY_BIN_MM;
        bin >= 0.0 && self.claimed.get(bin as usize).is_some_and(|claimed| *claimed)
    }

    fn at(&self, place: f32) -> Option<Ray> {
        let bin = (place - self.start) / RAY_BIN_MM;
        // NaN and what lies before the stripe are no bins.
        if bin >= 0.0 { self.bins.get(bin as usize).copied() } else { None }
    }

    /// Is it within the watched stripe?
    pub(super) fn is_watched(&self, place: f32) -> bool {
        self.at(place).is_some()
    }

    pub(super) fn is_dark(&self, place: f32) -> bool {
        matches!(self.at(place), Some(Ray::Dark | Ray::Taken))
    }

    /// Is it dark, or beside a dark one?
    pub(super) fn is_of_interest(&self, place: f32) -> bool {
        self.at(place).is_some_and(|ray| ray != Ray::Lit)
    }

    pub(super) fn is_taken(&self, place: f32) -> bool {
        self.at(place) == Some(Ray::Taken)
    }

    /// Is a line long enough for the dark stretch that it lies in? Next to nothing of it explains nothing: that is a
    /// glint, or the red rim of something that daylight overexposes.
    pub(super) fn is_explained_by(&self, points: &[RaisedPoint]) -> bool {
        let [first, .., last] = points else { return false };
        let length = (last.place - first.place).abs();
        if length >= LONG_LINE_MM {
            return true;
        }
        let middle = ((first.place + last.place) / 2.0 - self.start) / RAY_BIN_MM;
        let middle = (middle.max(0.0) as usize).min(self.bins.len());
        let is_dark = |ray: &&Ray| matches!(ray, Ray::Dark | Ray::Taken);
        let dark = self.bins[..middle].iter().rev().take_while(is_dark).count()
            + self.bins[middle..].iter().take_while(is_dark).count();
        length >= LEAST_EXPLAINED * dark as f32 * RAY_BIN_MM
    }

    pub(super) fn take(&mut self, one: f32, other: f32) {
        self.mark(one.min(other), one.max(other), Ray::Taken);
    }
}
