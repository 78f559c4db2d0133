//! The stack: a guard zone at its far end that nobody may touch, and how deep it was used.
//!
//! At start the whole stack is painted with [`PAINT`]. The last [`GUARD_WORDS`] words must keep it for ever; the words
//! above it are scanned for the deepest one that was used (the high-water mark), a slice at a time. On the board
//! nothing is mapped below the stack, so that an overflow also faults at once; the guard finds a stack that comes near.
//!
//! **Time:** about 5 instructions a word, [`SLICE_WORDS`] a slice. **Failure:**
//! [`SelfTestKind::Stack`](super::SelfTestKind::Stack).

use super::Outcome;
use super::memory::Cells;

/// What unused stack holds: no address, no small number, both halves different.
pub const PAINT: u32 = 0xA5A5_5A5A;
/// Words at the stack's far end that stay unused: 2 KiB. Reason: an interrupt's frame with floating-point registers is
/// 104 bytes, and three priorities may nest with a few hundred bytes each.
pub const GUARD_WORDS: usize = 512;
/// Words that a slice looks at.
pub const SLICE_WORDS: usize = 256;

/// Looks through the stack, slice by slice, again and again. Place 0 is the stack's far end (its lowest address).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StackCheck {
    next: usize,
    unused: Option<usize>,
}

impl StackCheck {
    /// Nothing was looked at yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { next: 0, unused: None }
    }

    /// The next slice. [`Outcome::Passed`] when the first used word was reached above an untouched guard zone.
    pub fn step<C: Cells>(&mut self, stack: &C) -> Outcome {
        let end = self.next.saturating_add(SLICE_WORDS).min(stack.count());
        match (self.next..end).find(|place| stack.read(*place) != PAINT) {
            Some(used) => self.finish(used),
            None if end == stack.count() => self.finish(end),
            None => {
                self.next = end;
                Outcome::Pending
            }
        }
    }

    fn finish(&mut self, unused: usize) -> Outcome {
        self.next = 0;
        self.unused = Some(unused);
        Outcome::passed_if(unused >= GUARD_WORDS)
    }

    /// Words that were never used, as of the last complete look.
    #[must_use]
    pub const fn unused_words(&self) -> Option<usize> {
        self.unused
    }
}

impl Default for StackCheck {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Stack(Vec<u32>);

    impl Cells for Stack {
        fn count(&self) -> usize {
            self.0.len()
        }
        fn read(&self, place: usize) -> u32 {
            self.0[place]
        }
        fn write(&mut self, _: usize, _: u32) {
            panic!("the stack is only looked at");
        }
    }

    const WORDS: usize = 2_000;

    /// A stack of which the words from `first_used` on were used.
    fn used_from(first_used: usize) -> Stack {
        Stack((0..WORDS).map(|place| if place < first_used { PAINT } else { 7 }).collect())
    }

    fn look(check: &mut StackCheck, stack: &Stack) -> Outcome {
        for _ in 0..=WORDS / SLICE_WORDS {
            match check.step(stack) {
                Outcome::Pending => {}
                outcome => return outcome,
            }
        }
        panic!("the look does not end")
    }

    #[test]
    fn the_guard_zone_must_stay_untouched() {
        for (first_used, expected) in [
            (0, Outcome::Failed),
            (GUARD_WORDS - 1, Outcome::Failed),
            (GUARD_WORDS, Outcome::Passed),
            (GUARD_WORDS + 1, Outcome::Passed),
            (WORDS - 1, Outcome::Passed),
            (WORDS, Outcome::Passed),
        ] {
            let mut check = StackCheck::new();
            for _ in 0..2 {
                assert_eq!(look(&mut check, &used_from(first_used)), expected, "{first_used}");
                assert_eq!(check.unused_words(), Some(first_used));
            }
        }
    }

    #[test]
    fn a_single_changed_word_of_the_guard_zone_is_found() {
        for place in [0, 1, 255, 256, GUARD_WORDS - 1] {
            let mut stack = used_from(1_500);
            stack.0[place] ^= 1 << 31;
            let mut check = StackCheck::new();
            assert_eq!(look(&mut check, &stack), Outcome::Failed, "word {place}");
        }
    }

    #[test]
    fn a_stack_that_was_never_looked_at_has_no_mark_and_one_without_words_fails() {
        assert_eq!(StackCheck::new().unused_words(), None);
        assert_eq!(StackCheck::default().step(&Stack(Vec::new())), Outcome::Failed);
    }
}
