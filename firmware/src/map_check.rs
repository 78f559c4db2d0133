//! Are the column maps still what they were filled with?
//!
//! The maps are computed once, at start, and everything is measured by them. A few of them are digested in every tick;
//! a round over all of them (1152 columns: 72 ticks, 0.36 s) must give the digest that was taken at start.

use crate::integrity::{Digest, Seal};
use nearfield_shared::columns::{ColumnMap, StripeGeometry};

/// Maps that one tick digests. Reason: about 1500 instructions.
const MAPS_AT_ONCE: usize = 16;

/// Goes round and round over the maps; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MapCheck {
    reference: Seal,
    digest: Digest,
    next: usize,
    intact: bool,
}

impl MapCheck {
    /// For maps that have just been filled.
    #[must_use]
    pub fn of<const N: usize>(geometry: &StripeGeometry<N>) -> Self {
        let all = words(geometry, 0, N).fold(Digest::new(), Digest::with);
        Self { reference: all.sealed(), digest: Digest::new(), next: 0, intact: true }
    }

    /// For no maps at all: nothing to check.
    #[must_use]
    pub const fn empty() -> Self {
        Self { reference: Digest::new().sealed(), digest: Digest::new(), next: 0, intact: true }
    }

    /// What it rests on, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 2] {
        [self.reference.bits(), if self.intact { 0xA5 } else { 0x5A }]
    }

    /// Digests the next few maps. `false` once a round has not given what it must, for good.
    pub fn step<const N: usize>(&mut self, geometry: &StripeGeometry<N>) -> bool {
        self.digest = words(geometry, self.next, MAPS_AT_ONCE).fold(self.digest, Digest::with);
        self.next = self.next.saturating_add(MAPS_AT_ONCE);
        if self.next >= geometry.maps().len() {
            self.intact = self.intact && self.reference.holds(self.digest);
            (self.digest, self.next) = (Digest::new(), 0);
        }
        self.intact
    }
}

/// The maps from one on, as words.
fn words<const N: usize>(
    geometry: &StripeGeometry<N>,
    first: usize,
    count: usize,
) -> impl Iterator<Item = u64> + '_ {
    let maps = geometry.maps().iter().zip(geometry.reaches()).skip(first).take(count);
    maps.flat_map(|(map, reach)| map_words(map, *reach))
}

fn map_words(map: &ColumnMap, reach: u8) -> [u64; 4] {
    let pair = |one: f32, other: f32| (u64::from(one.to_bits()) << 32) | u64::from(other.to_bits());
    [
        pair(map.floor_row, map.floor_place),
        pair(map.height_per_row, map.perspective_per_row),
        pair(map.bend_per_row, map.place_per_height),
        u64::from(reach),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::rig;
    use nearfield_shared::columns::Decimation;
    use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
    use nearfield_shared::rig::{Rig, Stripe};

    fn geometry(rig: &Rig) -> Box<StripeGeometry<LARGEST_COLUMN_COUNT>> {
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(rig, Decimation::for_line_scan(640)).unwrap();
        geometry
    }

    #[test]
    fn intact_maps_stay_intact_round_after_round() {
        let geometry = geometry(&rig());
        let mut check = MapCheck::of(&geometry);
        assert!((0..500).all(|_| check.step(&geometry)));
    }

    #[test]
    fn changed_maps_are_found_within_two_rounds_and_for_good() {
        let good = geometry(&rig());
        let (rig, stripe) = (rig(), *rig().stripe());
        // A stripe that is named by places 1e-3 mm further on: all maps change by their last bits.
        let start = stripe.start + 1e-3;
        let shifted = Stripe { point: stripe.at(1e-3), start, ..stripe };
        let changed = geometry(&Rig::new(rig.image(), *rig.camera(), *rig.laser(), shifted).unwrap());
        let rounds = good.maps().len().div_ceil(MAPS_AT_ONCE);
        for lead in 0..rounds {
            let mut check = MapCheck::of(&good);
            assert!((0..lead).all(|_| check.step(&good)));
            let found = (0..2 * rounds).position(|_| !check.step(&changed));
            assert!(found.is_some(), "lead {lead}");
            assert!((0..2 * rounds).all(|_| !check.step(&good)), "for good");
        }
    }

    #[test]
    fn every_field_of_a_map_counts() {
        let map = geometry(&rig()).maps()[100];
        let words = map_words(&map, 3);
        let changed = [
            map_words(&ColumnMap { floor_row: map.floor_row.next_up(), ..map }, 3),
            map_words(&ColumnMap { floor_place: map.floor_place.next_up(), ..map }, 3),
            map_words(&ColumnMap { height_per_row: map.height_per_row.next_up(), ..map }, 3),
            map_words(&ColumnMap { perspective_per_row: map.perspective_per_row.next_up(), ..map }, 3),
            map_words(&ColumnMap { bend_per_row: map.bend_per_row.next_up(), ..map }, 3),
            map_words(&ColumnMap { place_per_height: map.place_per_height.next_up(), ..map }, 3),
            map_words(&map, 2),
        ];
        for (index, other) in changed.into_iter().enumerate() {
            let differing = words.iter().zip(other).filter(|(one, other)| **one != *other).count();
            assert_eq!(differing, 1, "field {index}");
        }
    }

    #[test]
    fn without_maps_there_is_nothing_to_find() {
        let nothing = Box::new(StripeGeometry::<LARGEST_COLUMN_COUNT>::empty());
        let mut check = MapCheck::empty();
        assert!((0..10).all(|_| check.step(&nothing)));
        let mut check = MapCheck::of(&nothing);
        assert!((0..10).all(|_| check.step(&nothing)));
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let empty = MapCheck::empty();
        let broken = MapCheck { intact: false, ..empty };
        crate::testing::all_differ(
            [empty, broken, MapCheck::of(&geometry(&rig()))].map(|check| check.words()),
        );
    }
}
