//! Tier 2: how high is what lifts the stripe, how deep is what lowers it, and where is nothing known.

use crate::columns::StripeGeometry;
use crate::cutoff::is_floor;
use crate::limits::{FLOOR_TOLERANCE, LARGE_HEIGHT};
use crate::units::Millimetres;

/// The paper's two sizes, and the honest third.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SizeClass {
    /// Below 50 mm, measured.
    Small,
    /// 50 mm or more, measured.
    Large,
    /// The stripe is missing or too little of it is seen; to be treated as large.
    Unknown,
}

impl SizeClass {
    /// The class of a measured height; NaN is unknown.
    #[must_use]
    pub fn of(height: Millimetres) -> Self {
        if height >= LARGE_HEIGHT {
            Self::Large
        } else if height < LARGE_HEIGHT {
            Self::Small
        } else {
            Self::Unknown
        }
    }
}

/// An extreme of the stripe: how high or low, and on which ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extreme {
    /// Height over the floor, negative below it.
    pub height: Millimetres,
    /// Stripe coordinate s of the column's floor point where it was seen.
    pub place: Millimetres,
}

/// What tier 2 finds in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Heights {
    /// Highest point over the floor, robustly; `None` if nothing is raised.
    pub highest: Option<Extreme>,
    /// Lowest point below the floor, robustly; `None` if nothing is.
    pub lowest: Option<Extreme>,
    /// Longest run of columns without any stripe.
    pub longest_unknown: Millimetres,
}

/// One connected piece of stripe off the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cluster {
    /// Place of its first column's floor point, millimetres.
    pub first: Millimetres,
    /// Place of its last column's floor point, millimetres.
    pub last: Millimetres,
    /// Its robust maximum (raised) or minimum (below the floor).
    pub extreme: Extreme,
    /// Columns in it.
    pub columns: u16,
}

/// Neighbouring columns belong to one cluster while their heights differ by no more than this. Reason: a column is
/// 0.3 to 2 mm wide; steeper steps are an edge between two surfaces.
const CLUSTER_STEP_MM: f32 = 15.0;
/// A cluster needs this many columns: a single one is noise (tier 1 still counts it as not floor).
const FEWEST_COLUMNS: u16 = 2;

/// Finds clusters, extremes and unknown stretches in one pass.
///
/// `heights` holds the stripe's height in each watched column (NaN = no stripe). The robust maximum of a cluster is
/// the largest median of three neighbours (of two: the smaller), so that one wild column decides nothing.
pub fn evaluate<const N: usize>(
    geometry: &StripeGeometry<N>,
    heights: &[f32],
    mut on_cluster: impl FnMut(Cluster),
) -> Heights {
    let mut found = Heights::default();
    let mut cluster = OpenCluster::default();
    let mut unknown_since: Option<f32> = None;
    let mut close = |cluster: &mut OpenCluster| {
        if let Some(closed) = core::mem::take(cluster).finish() {
            let height = closed.extreme.height;
            if height > Millimetres::ZERO {
                if found.highest.is_none_or(|highest| height > highest.height) {
                    found.highest = Some(closed.extreme);
                }
            } else if found.lowest.is_none_or(|lowest| height < lowest.height) {
                found.lowest = Some(closed.extreme);
            }
            on_cluster(closed);
        }
    };
    let mut longest_unknown = 0.0_f32;
    for (map, height) in geometry.maps().iter().zip(heights) {
        let place = map.floor_place;
        if height.is_nan() {
            let since = *unknown_since.get_or_insert(place);
            let length = (place - since).abs();
            longest_unknown = if length > longest_unknown { length } else { longest_unknown };
        } else {
            unknown_since = None;
        }
        // NaN fails `continues`, so a missing column ends a cluster.
        if !cluster.continues(*height) {
            close(&mut cluster);
        }
        if !height.is_nan() && !is_floor(*height) {
            cluster.push(place, *height);
        }
    }
    close(&mut cluster);
    found.longest_unknown = Millimetres::new(longest_unknown);
    found
}

/// A cluster while its columns arrive.
#[derive(Default)]
struct OpenCluster {
    columns: u16,
    first: f32,
    last: f32,
    /// The newest two heights, newest first.
    recent: [f32; 2],
    extreme: Option<Extreme>,
}

impl OpenCluster {
    fn continues(&self, height: f32) -> bool {
        let [newest, _] = self.recent;
        let same_side = (height > FLOOR_TOLERANCE.get() && newest > 0.0)
            || (height < -FLOOR_TOLERANCE.get() && newest < 0.0);
        self.columns > 0 && same_side && (height - newest).abs() <= CLUSTER_STEP_MM
    }

    fn push(&mut self, place: f32, height: f32) {
        let [newest, older] = self.recent;
        let candidate = match self.columns {
            0 => None,
            1 => Some(if height.abs() < newest.abs() { height } else { newest }),
            _ => Some(median(height, newest, older)),
        };
        if self.columns == 0 {
            self.first = place;
        }
        if let Some(candidate) = candidate {
            // The first pair only stands in until three columns are there.
            let better = self.columns == 2
                || self.extreme.is_none_or(|extreme| candidate.abs() > extreme.height.abs().get());
            if better {
                let at = if self.columns >= 2 { self.last } else { place };
                self.extreme =
                    Some(Extreme { height: Millimetres::new(candidate), place: Millimetres::new(at) });
            }
        }
        self.recent = [height, newest];
        self.last = place;
        self.columns = self.columns.saturating_add(1);
    }

    fn finish(self) -> Option<Cluster> {
        let extreme = self.extreme?;
        (self.columns >= FEWEST_COLUMNS).then_some(Cluster {
            first: Millimetres::new(self.first),
            last: Millimetres::new(self.last),
            extreme,
            columns: self.columns,
        })
    }
}

fn median(a: f32, b: f32, c: f32) -> f32 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if c < low {
        low
    } else if c > high {
        high
    } else {
        c
    }
}
