//! Tier 2: how high is what lifts the stripe, how deep is what lowers it, and where is nothing known.

use crate::columns::StripeGeometry;
use crate::cutoff::is_floor;
use crate::limits::LARGE_HEIGHT;
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
        } else if height.get().is_nan() {
            Self::Unknown
        } else {
            Self::Small
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
    on_cluster: impl FnMut(Cluster),
) -> Heights {
    let mut pass = Pass::new(on_cluster);
    for (map, height) in geometry.maps().iter().zip(heights) {
        let (place, height) = (map.floor_place, *height);
        // By far the most columns are like the one before: floor after floor, or nothing after nothing.
        if is_floor(height) {
            if pass.before != Seen::Floor {
                pass.end_run(Seen::Floor);
            }
        } else if height.is_nan() {
            if pass.before != Seen::Nothing {
                pass.end_run(Seen::Nothing);
                pass.unknown_since = place;
            }
            pass.unknown_until = place;
        } else if pass.before == Seen::Stripe && pass.cluster.continues(height) {
            pass.cluster.push(place, height);
        } else {
            pass.end_run(Seen::Stripe);
            pass.cluster = OpenCluster::new(place, height);
        }
    }
    pass.end_run(Seen::Floor);
    pass.found
}

/// A height without its sign, as the bits of the float: these compare like the magnitudes, as integers, which the
/// MCU does in a third of the instructions. Within a cluster all heights have one sign.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Magnitude(u32);

impl Magnitude {
    #[inline]
    const fn of(height: f32) -> Self {
        Self(height.to_bits() & 0x7FFF_FFFF)
    }

    #[inline]
    fn median(self, other: Self, third: Self) -> Self {
        self.min(other).max(self.max(other).min(third))
    }
}

/// What the column before showed.
#[derive(Clone, Copy, PartialEq)]
enum Seen {
    Floor,
    /// No stripe.
    Nothing,
    /// The stripe, off the floor.
    Stripe,
}

/// One pass over the columns.
struct Pass<C> {
    found: Heights,
    before: Seen,
    /// Places of the first and the last column of the run without stripe.
    unknown_since: f32,
    unknown_until: f32,
    cluster: OpenCluster,
    on_cluster: C,
}

impl<C: FnMut(Cluster)> Pass<C> {
    const fn new(on_cluster: C) -> Self {
        Self {
            found: Heights { highest: None, lowest: None, longest_unknown: Millimetres::ZERO },
            before: Seen::Floor,
            unknown_since: 0.0,
            unknown_until: 0.0,
            cluster: OpenCluster::new(0.0, 0.0),
            on_cluster,
        }
    }

    /// A run of columns of one kind has ended; the next one begins with a column of this kind.
    fn end_run(&mut self, next: Seen) {
        match core::mem::replace(&mut self.before, next) {
            Seen::Floor => {}
            Seen::Nothing => {
                let length = Millimetres::new((self.unknown_until - self.unknown_since).abs());
                if length > self.found.longest_unknown {
                    self.found.longest_unknown = length;
                }
            }
            Seen::Stripe => self.close_cluster(),
        }
    }

    fn close_cluster(&mut self) {
        let Some(cluster) = self.cluster.finish() else { return };
        let height = cluster.extreme.height;
        if height > Millimetres::ZERO {
            if self.found.highest.is_none_or(|highest| height > highest.height) {
                self.found.highest = Some(cluster.extreme);
            }
        } else if self.found.lowest.is_none_or(|lowest| height < lowest.height) {
            self.found.lowest = Some(cluster.extreme);
        }
        (self.on_cluster)(cluster);
    }
}

/// A cluster while its columns arrive.
struct OpenCluster {
    columns: u16,
    first: f32,
    last: f32,
    newest: f32,
    /// Magnitude of the height before the newest one.
    older: Magnitude,
    /// Robust extreme so far and its place; meaningful from two columns on.
    extreme: Magnitude,
    extreme_place: f32,
}

impl OpenCluster {
    /// Of one column.
    const fn new(place: f32, height: f32) -> Self {
        Self {
            columns: 1,
            first: place,
            last: place,
            newest: height,
            older: Magnitude::of(height),
            extreme: Magnitude::of(height),
            extreme_place: place,
        }
    }

    /// Does a column of this height, which is not floor, belong to it?
    #[inline]
    fn continues(&self, height: f32) -> bool {
        const SIGN: u32 = 0x8000_0000;
        let same_side = (height.to_bits() ^ self.newest.to_bits()) & SIGN == 0;
        same_side && Magnitude::of(height - self.newest) <= const { Magnitude::of(CLUSTER_STEP_MM) }
    }

    #[inline]
    fn push(&mut self, place: f32, height: f32) {
        let (newest, candidate) = (Magnitude::of(self.newest), Magnitude::of(height));
        if self.columns == 1 {
            // A pair: the smaller one, which stands in until three columns are there.
            (self.extreme, self.extreme_place) = (newest.min(candidate), place);
        } else {
            let candidate = newest.median(candidate, self.older);
            if self.columns == 2 || candidate > self.extreme {
                (self.extreme, self.extreme_place) = (candidate, self.last);
            }
        }
        (self.older, self.newest, self.last) = (newest, height, place);
        self.columns = self.columns.saturating_add(1);
    }

    fn finish(&self) -> Option<Cluster> {
        let magnitude = f32::from_bits(self.extreme.0);
        let height = if self.newest < 0.0 { -magnitude } else { magnitude };
        (self.columns >= FEWEST_COLUMNS).then_some(Cluster {
            first: Millimetres::new(self.first),
            last: Millimetres::new(self.last),
            extreme: Extreme {
                height: Millimetres::new(height),
                place: Millimetres::new(self.extreme_place),
            },
            columns: self.columns,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::tests::level;

    /// What is found on a stripe of a column a millimetre whose columns from 100 on have these heights, in runs of
    /// (columns, height); the rest is floor.
    fn found(runs: &[(usize, f32)]) -> (Heights, Vec<Cluster>, Vec<f32>) {
        let geometry = level(400);
        let places: Vec<f32> = geometry.maps().iter().map(|map| map.floor_place).collect();
        let mut heights = vec![0.0; places.len()];
        let raised = runs.iter().flat_map(|(columns, height)| core::iter::repeat_n(*height, *columns));
        for (height, raised) in heights.iter_mut().skip(100).zip(raised) {
            *height = raised;
        }
        let mut clusters = Vec::new();
        let found = evaluate(&geometry, &heights, |cluster| clusters.push(cluster));
        (found, clusters, places)
    }

    #[test]
    fn floor_between_two_things_parts_them() {
        let (_, clusters, places) = found(&[(10, 30.0), (1, 0.0), (20, 30.0)]);
        let columns: Vec<_> = clusters.iter().map(|cluster| cluster.columns).collect();
        assert_eq!(columns, [10, 20]);
        assert_eq!((clusters[0].first.get(), clusters[0].last.get()), (places[100], places[109]));
        assert_eq!((clusters[1].first.get(), clusters[1].last.get()), (places[111], places[130]));
    }

    #[test]
    fn floor_between_two_unknown_stretches_parts_them() {
        let (found, clusters, places) = found(&[(10, f32::NAN), (1, 0.0), (20, f32::NAN)]);
        assert!(clusters.is_empty());
        assert_eq!(found.longest_unknown.get(), places[130] - places[111]);
    }

    /// Two surfaces: a step of more than [`CLUSTER_STEP_MM`], or from above the floor to below it.
    #[test]
    fn a_step_parts_two_surfaces() {
        let columns = |runs: &[(usize, f32)]| found(runs).1.iter().map(|one| one.columns).collect::<Vec<_>>();
        assert_eq!(columns(&[(10, 20.0), (10, 20.0 + CLUSTER_STEP_MM)]), [20]);
        assert_eq!(columns(&[(10, 20.0), (10, (20.0 + CLUSTER_STEP_MM).next_up())]), [10, 10]);
        assert_eq!(columns(&[(10, 20.0), (10, 20.0 - CLUSTER_STEP_MM)]), [20]);
        assert_eq!(columns(&[(10, 4.0), (10, -4.0)]), [10, 10]);
    }

    #[test]
    fn of_equally_high_and_equally_low_things_the_first_is_told() {
        let runs = [(9, 30.0), (9, 0.0), (9, 30.0), (9, 0.0), (9, -8.0), (9, 0.0), (9, -8.0)];
        let (found, clusters, _) = found(&runs);
        assert_eq!(clusters.len(), 4);
        assert_eq!(found.highest.unwrap(), clusters[0].extreme);
        assert_eq!(found.lowest.unwrap(), clusters[2].extreme);
        assert_ne!(clusters[0].extreme.place, clusters[1].extreme.place);
    }

    /// One cluster's height, and which of its columns it was seen in.
    fn height_of(heights: &[f32]) -> (f32, usize) {
        let runs: Vec<_> = heights.iter().map(|height| (1, *height)).collect();
        let (_, clusters, places) = found(&runs);
        let [cluster] = clusters[..] else { panic!("{clusters:?}") };
        let column = places.iter().position(|place| *place == cluster.extreme.place.get()).unwrap();
        (cluster.extreme.height.get(), column - 100)
    }

    /// The rule: of two columns the smaller one; from three on the largest median of three neighbours, where it is
    /// first reached.
    #[test]
    fn the_height_of_a_cluster_is_its_largest_median_of_three() {
        assert_eq!(height_of(&[20.0, 30.0]).0, 20.0);
        assert_eq!(height_of(&[30.0, 20.0]).0, 20.0);
        assert_eq!(height_of(&[20.0, 30.0, 25.0]).0, 25.0);
        assert_eq!(height_of(&[30.0, 30.0, 44.0, 30.0, 30.0]).0, 30.0, "one wild column");
        assert_eq!(height_of(&[20.0, 22.0, 24.0, 26.0]), (24.0, 2));
        assert_eq!(height_of(&[26.0, 24.0, 22.0, 20.0]), (24.0, 1));
        assert_eq!(height_of(&[30.0; 6]), (30.0, 1));
        assert_eq!(height_of(&[-8.0, -9.0, -10.0, -9.5, -8.0]), (-9.5, 2));
    }
}
