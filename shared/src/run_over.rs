//! Run-over of small debris: what the host may claim, and which stretches of the stripe a controller may let pass.
//!
//! A **claim** is tier 3's word for a stretch of the stripe: this category, this confidence, seen so long ago. It rides on
//! every line-scan. A **permit** is the controller's own: stretches in which a column whose stripe the controller itself
//! measures as low ([`crate::limits::RUN_OVER_HEIGHT`]) does not count as cut. Without a permit a claim does nothing.
//!
//! On the wire a claim has [`CLAIM_LENGTH`] bytes, little-endian: first and last place i16 (whole millimetres of stripe
//! coordinate, first <= last), category u8 (codes that differ in at least four bits), confidence u8 (255 = certain), age
//! of the picture that it comes from u16 (milliseconds). All zero = no claim.

use crate::action::{Action, Category, action_for};
use crate::height::SizeClass;
use crate::limits::{
    LEAST_CLAIM_CONFIDENCE, LONGEST_CLAIM_AGE, LONGEST_RUN_OVER_STRETCH, RUN_OVER_OBJECTION_MARGIN,
};
use crate::units::{Micros, Millimetres};
use crate::wire::{Reader, Writer};

/// Claims that a line-scan carries at most.
pub const LARGEST_CLAIM_COUNT: usize = 4;
/// Bytes of a claim on the wire.
pub const CLAIM_LENGTH: usize = 8;

/// A stretch of the stripe, in stripe coordinates; start <= end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    start: i16,
    end: i16,
}

impl Stretch {
    /// The stripe's own origin, and nothing beside it.
    pub const POINT: Self = Self { start: 0, end: 0 };

    /// Between two places, whole millimetres; `None` if they are in the wrong order.
    #[must_use]
    pub const fn new(start: i16, end: i16) -> Option<Self> {
        if start <= end { Some(Self { start, end }) } else { None }
    }

    /// Smaller end.
    #[must_use]
    pub fn start(self) -> Millimetres {
        Millimetres::new(f32::from(self.start))
    }

    /// Larger end.
    #[must_use]
    pub fn end(self) -> Millimetres {
        Millimetres::new(f32::from(self.end))
    }

    /// Its length.
    #[must_use]
    pub fn length(self) -> Millimetres {
        self.end().minus(self.start())
    }

    /// Do they share a place, if the other one is widened by `margin` at both ends?
    #[must_use]
    pub fn meets(self, other: Self, margin: Millimetres) -> bool {
        self.start().minus(margin) <= other.end() && other.start().minus(margin) <= self.end()
    }

    /// The places that both have.
    #[must_use]
    pub fn shared_with(self, other: Self) -> Option<Self> {
        Self::new(self.start.max(other.start), self.end.min(other.end))
    }

    /// All of it, for checks of memory.
    #[must_use]
    pub const fn word(self) -> u64 {
        let [low, high] = self.start.to_le_bytes();
        let [end_low, end_high] = self.end.to_le_bytes();
        u64::from_le_bytes([low, high, end_low, end_high, 0xA5, 0, 0, 0])
    }
}

/// What tier 3 says of one stretch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Claim {
    /// Where.
    pub stretch: Stretch,
    /// What it takes it for.
    pub category: Category,
    /// How sure it is: calibrated probability, 255 = certain.
    pub confidence: u8,
    /// Age of the picture when the line-scan was sent.
    pub age: Micros,
}

/// The claims of one line-scan.
pub type Claims = [Option<Claim>; LARGEST_CLAIM_COUNT];

/// No claim.
pub const NO_CLAIMS: Claims = [None; LARGEST_CLAIM_COUNT];

const fn category_code(category: Category) -> u8 {
    match category {
        Category::Human => 0x2D,
        Category::Tool => 0x4B,
        Category::Material => 0x66,
        Category::Part => 0x87,
        Category::Vehicle => 0xAA,
        Category::Environment => 0xCC,
        Category::SafetyItem => 0xE1,
        Category::Unknown => 0xFF,
    }
}

impl Claim {
    /// Does it speak for letting this stretch pass, as far as the claim goes? The action table must say "run over" for a
    /// small object of its category, the host must be sure, the picture fresh, the stretch no longer than debris.
    #[must_use]
    pub fn speaks_for_run_over(&self) -> bool {
        matches!(action_for(self.category, SizeClass::Small), Action::RunOver)
            && self.confidence >= LEAST_CLAIM_CONFIDENCE
            && self.age <= LONGEST_CLAIM_AGE
            && self.stretch.length() <= LONGEST_RUN_OVER_STRETCH
    }

    /// Does it object to letting `other` pass? A person does wherever they are; anything else that is no run-over
    /// matter, whatever its age and confidence, does where it lies and beside it.
    #[must_use]
    pub fn objects_to(&self, other: Stretch) -> bool {
        match self.category {
            Category::Human => true,
            Category::Tool
            | Category::Material
            | Category::Part
            | Category::Vehicle
            | Category::Environment
            | Category::SafetyItem
            | Category::Unknown => {
                !self.speaks_for_run_over() && self.stretch.meets(other, RUN_OVER_OBJECTION_MARGIN)
            }
        }
    }

    /// All of it, for checks of memory; never zeros.
    #[must_use]
    pub fn words(&self) -> [u64; 2] {
        let kind = u64::from(category_code(self.category)) << 48 | u64::from(self.confidence) << 40;
        [self.stretch.word() | kind, self.age.get()]
    }

    /// Writes a slot; `None` as zeros.
    pub(crate) fn write(slot: Option<&Self>, writer: &mut Writer<'_>) {
        let Some(claim) = slot else { return writer.skip(CLAIM_LENGTH) };
        writer.bytes(&claim.stretch.start.to_le_bytes());
        writer.bytes(&claim.stretch.end.to_le_bytes());
        writer.u8(category_code(claim.category));
        writer.u8(claim.confidence);
        // An age beyond the field is told as the longest: too old in any case.
        writer.u16(u16::try_from(claim.age.get().div_ceil(1000)).unwrap_or(u16::MAX));
    }

    /// Reads a slot; `None` if its bytes are impossible.
    pub(crate) fn read(reader: &mut Reader<'_>) -> Option<Option<Self>> {
        let [s0, s1, e0, e1, code, confidence, a0, a1] =
            *reader.slice(CLAIM_LENGTH)?.first_chunk::<CLAIM_LENGTH>()?;
        if [s0, s1, e0, e1, code, confidence, a0, a1] == [0; CLAIM_LENGTH] {
            return Some(None);
        }
        let stretch = Stretch::new(i16::from_le_bytes([s0, s1]), i16::from_le_bytes([e0, e1]))?;
        let category = Category::ALL.into_iter().find(|category| category_code(*category) == code)?;
        let age = Micros::from_millis(u64::from(u16::from_le_bytes([a0, a1])));
        Some(Some(Self { stretch, category, confidence, age }))
    }
}

/// The stretches that a controller lets pass in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RunOverPermit {
    /// Where low columns do not count as cut.
    pub stretches: [Option<Stretch>; LARGEST_CLAIM_COUNT],
}

impl RunOverPermit {
    /// Nothing passes: the default, and what a host uses for its own view of the stripe.
    pub const NONE: Self = Self { stretches: [None; LARGEST_CLAIM_COUNT] };

    /// Does nothing pass?
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.stretches.iter().all(Option::is_none)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Reader;
    use proptest::prelude::*;

    fn stretch(start: i16, end: i16) -> Stretch {
        Stretch::new(start, end).unwrap()
    }

    fn claim(category: Category) -> Claim {
        Claim { stretch: stretch(-20, 30), category, confidence: 255, age: Micros::from_millis(40) }
    }

    fn round_trip(slot: Option<Claim>) -> Option<Option<Claim>> {
        let mut bytes = [0; CLAIM_LENGTH];
        Claim::write(slot.as_ref(), &mut Writer::new(&mut bytes));
        Claim::read(&mut Reader::new(&bytes))
    }

    #[test]
    fn category_codes_are_far_apart_and_far_from_no_claim() {
        let codes = Category::ALL.map(category_code);
        for (index, one) in codes.iter().enumerate() {
            assert!(one.count_ones() >= 4, "{one:02x}");
            for other in &codes[index + 1..] {
                assert!((one ^ other).count_ones() >= 4, "{one:02x} {other:02x}");
            }
        }
    }

    #[test]
    fn only_the_run_over_cells_of_the_action_table_speak_for_it() {
        for category in Category::ALL {
            let expected = matches!(category, Category::Tool | Category::Material);
            assert_eq!(claim(category).speaks_for_run_over(), expected, "{category:?}");
        }
    }

    #[test]
    fn each_limit_of_a_claim_holds_on_both_sides() {
        let good = claim(Category::Tool);
        let sure = |confidence| Claim { confidence, ..good }.speaks_for_run_over();
        assert!(sure(LEAST_CLAIM_CONFIDENCE) && !sure(LEAST_CLAIM_CONFIDENCE - 1));
        let aged = |age| Claim { age, ..good }.speaks_for_run_over();
        assert!(aged(LONGEST_CLAIM_AGE) && !aged(LONGEST_CLAIM_AGE.plus(Micros::new(1))));
        let longest = LONGEST_RUN_OVER_STRETCH.get() as i16;
        let long = |end| Claim { stretch: stretch(0, end), ..good }.speaks_for_run_over();
        assert!(long(longest) && !long(longest + 1));
    }

    #[test]
    fn a_person_anywhere_objects_and_anything_else_where_it_lies() {
        let debris = stretch(300, 320);
        assert!(claim(Category::Human).objects_to(debris), "far away");
        for category in Category::ALL {
            let margin = RUN_OVER_OBJECTION_MARGIN.get() as i16;
            let beside = Claim { stretch: stretch(100, 300 - margin), ..claim(category) };
            let apart = Claim { stretch: stretch(100, 299 - margin), ..claim(category) };
            let behind = Claim { stretch: stretch(320 + margin, 500), ..claim(category) };
            let farther = Claim { stretch: stretch(321 + margin, 500), ..claim(category) };
            match category {
                Category::Human => {}
                Category::Tool | Category::Material => {
                    assert!(!beside.objects_to(debris), "{category:?}");
                    // The same, but unsure: it is no debris then.
                    assert!(Claim { confidence: 10, ..beside }.objects_to(debris));
                    assert!(!Claim { confidence: 10, ..apart }.objects_to(debris));
                }
                Category::Part
                | Category::Vehicle
                | Category::Environment
                | Category::SafetyItem
                | Category::Unknown => {
                    assert!(beside.objects_to(debris) && behind.objects_to(debris), "{category:?}");
                    assert!(!apart.objects_to(debris) && !farther.objects_to(debris), "{category:?}");
                }
            }
        }
    }

    #[test]
    fn stretches_meet_share_and_measure() {
        assert_eq!(Stretch::new(1, 0), None);
        assert_eq!(stretch(5, 5).length(), Millimetres::ZERO);
        assert_eq!(stretch(-5, 7).length(), Millimetres::new(12.0));
        assert_eq!(stretch(0, 10).shared_with(stretch(5, 20)), Some(stretch(5, 10)));
        assert_eq!(stretch(0, 10).shared_with(stretch(10, 20)), Some(stretch(10, 10)));
        assert_eq!(stretch(0, 10).shared_with(stretch(11, 20)), None);
        assert!(stretch(0, 10).meets(stretch(12, 20), Millimetres::new(2.0)));
        assert!(!stretch(0, 10).meets(stretch(13, 20), Millimetres::new(2.0)));
        let words = [stretch(0, 1), stretch(1, 1), stretch(0, 2), stretch(-1, 1)].map(Stretch::word);
        for (index, one) in words.iter().enumerate() {
            assert!(*one != 0 && words[index + 1..].iter().all(|other| one != other));
        }
    }

    #[test]
    fn golden_bytes_of_a_claim() {
        let claim = Claim {
            stretch: stretch(-2, 0x0304),
            category: Category::Material,
            confidence: 0x55,
            age: Micros::new(0x0102 * 1000),
        };
        let mut bytes = [0; CLAIM_LENGTH];
        Claim::write(Some(&claim), &mut Writer::new(&mut bytes));
        assert_eq!(bytes, [0xFE, 0xFF, 0x04, 0x03, 0x66, 0x55, 0x02, 0x01]);
        assert_eq!(round_trip(None), Some(None));
    }

    #[test]
    fn impossible_claims_are_refused() {
        let read = |bytes: [u8; CLAIM_LENGTH]| Claim::read(&mut Reader::new(&bytes));
        assert_eq!(read([1, 0, 0, 0, 0x66, 0, 0, 0]), None, "ends before it begins");
        assert_eq!(read([0, 0, 1, 0, 0x67, 0, 0, 0]), None, "an unknown category");
        assert_eq!(read([0, 0, 1, 0, 0, 0, 0, 0]), None, "no category");
        assert_eq!(Claim::read(&mut Reader::new(&[0; 7])), None, "cut off");
    }

    #[test]
    fn an_age_is_never_told_as_younger() {
        for (micros, told) in [(0, 0), (1, 1), (1000, 1), (1001, 2), (u64::MAX, 65_535)] {
            let slot = Some(Claim { age: Micros::new(micros), ..claim(Category::Part) });
            assert_eq!(round_trip(slot).unwrap().unwrap().age, Micros::from_millis(told));
        }
    }

    proptest! {
        #[test]
        fn what_was_claimed_is_what_is_read(
            start: i16, length in 0_i16..1000, category in 0_usize..8, confidence: u8, age in 0_u64..65_536,
        ) {
            let stretch = stretch(start.min(i16::MAX - 1000), start.min(i16::MAX - 1000) + length);
            let age = Micros::from_millis(age);
            let claim = Claim { stretch, category: Category::ALL[category], confidence, age };
            prop_assert_eq!(round_trip(Some(claim)), Some(Some(claim)));
        }
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let one = claim(Category::Tool);
        let mut words: Vec<_> = Category::ALL.map(|category| claim(category).words()).to_vec();
        words.extend([
            Claim { stretch: stretch(-21, 30), ..one }.words(),
            Claim { stretch: stretch(-20, 31), ..one }.words(),
            Claim { confidence: 254, ..one }.words(),
            Claim { confidence: 1, ..one }.words(),
            Claim { age: Micros::from_millis(41), ..one }.words(),
            [0; 2],
        ]);
        for (index, one) in words.iter().enumerate() {
            assert!(words.iter().skip(index + 1).all(|other| other != one), "{one:x?}");
        }
    }

    #[test]
    fn a_permit_for_anything_is_not_none() {
        assert!(RunOverPermit::NONE.is_none());
        for slot in 0..LARGEST_CLAIM_COUNT {
            let mut permit = RunOverPermit::NONE;
            permit.stretches[slot] = Some(stretch(0, 1));
            assert!(!permit.is_none());
        }
    }
}
