//! The newest records of one length, in the order in which they came.

/// At most `N` records of `L` bytes; a new one takes the place of the oldest. All zero bits while empty.
#[derive(Debug, Clone)]
pub(crate) struct Ring<const N: usize, const L: usize> {
    slots: [[u8; L]; N],
    /// The slot that is written next, below `N`.
    next: usize,
    /// Records that are kept, at most `N`: the ones before `next`.
    count: usize,
}

impl<const N: usize, const L: usize> Ring<N, L> {
    pub(crate) const fn new() -> Self {
        Self { slots: [[0; L]; N], next: 0, count: 0 }
    }

    pub(crate) const fn count(&self) -> usize {
        self.count
    }

    pub(crate) fn push(&mut self, record: &[u8; L]) {
        if let Some(slot) = self.slots.get_mut(self.next) {
            *slot = *record;
        }
        self.next = self.next.saturating_add(1).checked_rem(N).unwrap_or(0);
        self.count = self.count.saturating_add(1).min(N);
    }

    /// Forgets all but the newest `count` records.
    pub(crate) fn keep_newest(&mut self, count: usize) {
        self.count = self.count.min(count);
    }

    pub(crate) fn oldest_first(&self) -> impl Iterator<Item = &[u8; L]> {
        let oldest = self.next.saturating_add(N).saturating_sub(self.count).checked_rem(N).unwrap_or(0);
        self.slots.iter().cycle().skip(oldest).take(self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(ring: &Ring<3, 1>) -> Vec<u8> {
        assert_eq!(ring.count(), ring.oldest_first().count());
        ring.oldest_first().map(|[record]| *record).collect()
    }

    #[test]
    fn the_newest_records_are_kept_in_their_order() {
        let mut ring = Ring::<3, 1>::new();
        assert_eq!(kept(&ring), []);
        let expected: [&[u8]; 6] = [&[1], &[1, 2], &[1, 2, 3], &[2, 3, 4], &[3, 4, 5], &[4, 5, 6]];
        for (record, expected) in (1..).zip(expected) {
            ring.push(&[record]);
            assert_eq!(kept(&ring), expected);
        }
        ring.keep_newest(4);
        assert_eq!(kept(&ring), [4, 5, 6]);
        ring.keep_newest(2);
        assert_eq!(kept(&ring), [5, 6]);
        ring.push(&[7]);
        assert_eq!(kept(&ring), [5, 6, 7], "room again");
        ring.keep_newest(0);
        assert_eq!(kept(&ring), []);
        ring.push(&[8]);
        assert_eq!(kept(&ring), [8]);
    }
}
