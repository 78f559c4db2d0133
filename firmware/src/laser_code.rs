//! The laser's drive: full and dimmed by a secret code, dark for a moment at arming, off in lockout.
//!
//! A symbol lasts [`LASER_SYMBOL`]; no more than [`LONGEST_SYMBOL_RUN`] equal ones follow each other, so that the light
//! changes at least every 80 ms, and within that nobody can tell when. What the laser was driven with is remembered,
//! since the pictures arrive later.

use crate::secret::{Secret, Use};
use nearfield_shared::condition::LaserMode;
use nearfield_shared::limits::{LASER_DIMMED, LASER_FULL, LASER_SYMBOL, LONGEST_SYMBOL_RUN};
use nearfield_shared::units::Micros;

/// The laser off.
pub const LASER_OFF: u8 = 0;

/// Changes that are remembered. Reason: each level lasts at least [`LASER_SYMBOL`], so these reach back 320 ms, three
/// times the age of the oldest picture that is accepted.
const REMEMBERED_CHANGES: usize = 8;

/// A level and when it began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Drive {
    /// Brightness, 255 = full.
    pub level: u8,
    /// Since when.
    pub since: Micros,
}

/// What the laser was driven with, newest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DriveHistory {
    drives: [Option<Drive>; REMEMBERED_CHANGES],
}

impl DriveHistory {
    const fn new() -> Self {
        Self { drives: [None; REMEMBERED_CHANGES] }
    }

    fn note(&mut self, now: Micros, level: u8) {
        if self.drives.first().is_some_and(|newest| newest.is_some_and(|drive| drive.level == level)) {
            return;
        }
        self.drives.rotate_right(1);
        if let Some(newest) = self.drives.first_mut() {
            *newest = Some(Drive { level, since: now });
        }
    }

    /// The drive that held all the time from .. to; `None` if it changed in between or is not remembered.
    #[must_use]
    pub fn steady_over(&self, from: Micros, to: Micros) -> Option<Drive> {
        // The newest that had begun by `to` must have begun by `from` already.
        self.drives
            .iter()
            .flatten()
            .find(|drive| drive.since <= to)
            .filter(|drive| drive.since <= from)
            .copied()
    }
}

/// Drives the laser; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LaserCode {
    secret: Secret,
    level: u8,
    symbol: u64,
    run: u8,
    symbol_began: Option<Micros>,
    history: DriveHistory,
}

impl LaserCode {
    /// Off, with this secret.
    #[must_use]
    pub const fn new(secret: Secret) -> Self {
        Self { secret, level: LASER_OFF, symbol: 0, run: 0, symbol_began: None, history: DriveHistory::new() }
    }

    /// A tick: the level from now on.
    pub fn step(&mut self, now: Micros, mode: LaserMode) -> u8 {
        match mode {
            LaserMode::Off | LaserMode::Dark => {
                (self.level, self.symbol_began, self.run) = (LASER_OFF, None, 0);
            }
            LaserMode::Coded => {
                if self.symbol_began.is_none_or(|began| now.since(began) >= LASER_SYMBOL) {
                    self.begin_symbol(now);
                }
            }
        }
        self.history.note(now, self.level);
        self.level
    }

    fn begin_symbol(&mut self, now: Micros) {
        self.symbol = self.symbol.wrapping_add(1);
        let drawn =
            if self.secret.word(Use::LaserSymbol, self.symbol) & 1 == 0 { LASER_FULL } else { LASER_DIMMED };
        let level =
            if drawn == self.level && self.run >= LONGEST_SYMBOL_RUN { other_than(drawn) } else { drawn };
        self.run = if level == self.level { self.run.saturating_add(1) } else { 1 };
        self.level = level;
        self.symbol_began = Some(now);
    }

    /// The level now.
    #[must_use]
    pub const fn level(&self) -> u8 {
        self.level
    }

    /// What it was before.
    #[must_use]
    pub const fn history(&self) -> &DriveHistory {
        &self.history
    }

    /// The secret that it is driven by.
    #[must_use]
    pub const fn secret(&self) -> &Secret {
        &self.secret
    }

    /// All of it, for the check of the controller's memory.
    pub(crate) fn words(&self) -> impl Iterator<Item = u64> + '_ {
        let [first, second] = self.secret.bits();
        let began = self.symbol_began.map_or(u64::MAX, Micros::get);
        let state =
            [first, second, self.symbol, began, u64::from(u16::from_le_bytes([self.run, self.level]))];
        let drives = self.history.drives.iter().flatten();
        state.into_iter().chain(drives.map(|drive| drive.since.get() << 8 | u64::from(drive.level)))
    }
}

const fn other_than(level: u8) -> u8 {
    if level == LASER_FULL { LASER_DIMMED } else { LASER_FULL }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Micros {
        Micros::from_millis(millis)
    }

    /// Levels at every tick of 5 ms.
    fn levels(seed: u8, millis: u64) -> Vec<u8> {
        let mut laser = LaserCode::new(Secret::new([seed; 16]));
        (0..millis / 5).map(|tick| laser.step(at(tick * 5), LaserMode::Coded)).collect()
    }

    #[test]
    fn a_symbol_lasts_its_time_and_runs_are_short() {
        let all = levels(3, 200_000);
        let mut run = 1;
        let mut runs = std::collections::BTreeMap::new();
        for pair in all.windows(2) {
            if pair[0] == pair[1] {
                run += 1;
            } else {
                *runs.entry(run).or_insert(0_u32) += 1;
                run = 1;
            }
        }
        let ticks = LASER_SYMBOL.get() / 5_000;
        assert_eq!(runs.keys().copied().collect::<Vec<_>>(), [ticks, ticks * u64::from(LONGEST_SYMBOL_RUN)]);
        let (short, long) = (runs[&ticks], runs[&(2 * ticks)]);
        assert!(short > 1_200 && long > 1_200, "both come often: {short} {long}");
        assert!(all.iter().all(|level| [LASER_FULL, LASER_DIMMED].contains(level)));
    }

    #[test]
    fn the_code_is_the_secrets() {
        assert_eq!(levels(3, 2_000), levels(3, 2_000));
        assert_ne!(levels(3, 2_000), levels(4, 2_000));
    }

    #[test]
    fn a_symbol_ends_at_its_time_and_not_before() {
        // With this secret the first two symbols differ.
        let mut laser = LaserCode::new(Secret::new([3; 16]));
        let first = laser.step(Micros::ZERO, LaserMode::Coded);
        assert_eq!(laser.step(Micros::new(LASER_SYMBOL.get() - 1), LaserMode::Coded), first);
        let second = laser.step(LASER_SYMBOL, LaserMode::Coded);
        let third = laser.step(LASER_SYMBOL.plus(LASER_SYMBOL), LaserMode::Coded);
        assert!(first != second || second != third, "a run of at most two");
        assert_eq!(laser.level(), third);
    }

    #[test]
    fn dark_and_off_are_dark_and_the_code_begins_anew_after_them() {
        let mut laser = LaserCode::new(Secret::new([3; 16]));
        for mode in [LaserMode::Dark, LaserMode::Off] {
            assert_ne!(laser.step(at(0), LaserMode::Coded), LASER_OFF);
            assert_eq!(laser.step(at(5), mode), LASER_OFF);
            assert_eq!(laser.level(), LASER_OFF);
        }
        let level = laser.step(at(10), LaserMode::Coded);
        assert_ne!(level, LASER_OFF);
        assert_eq!(laser.step(at(45), LaserMode::Coded), level, "a whole symbol from its own beginning");
    }

    #[test]
    fn history_tells_a_level_only_where_it_held_all_the_time() {
        let mut laser = LaserCode::new(Secret::new([3; 16]));
        laser.step(at(0), LaserMode::Coded);
        laser.step(at(100), LaserMode::Dark);
        laser.step(at(105), LaserMode::Dark);
        laser.step(at(200), LaserMode::Coded);
        let level = |from: u64, to: u64| laser.history().steady_over(Micros::new(from), Micros::new(to));
        let dark = Some(Drive { level: LASER_OFF, since: at(100) });
        assert_eq!(level(99_999, 150_000), None);
        assert_eq!(level(100_000, 150_000), dark);
        assert_eq!(level(100_000, 199_999), dark);
        assert_eq!(level(100_000, 200_000), None);
        assert_eq!(level(200_000, 900_000).map(|drive| drive.since), Some(at(200)));
        let fresh = LaserCode::new(Secret::NONE);
        assert_eq!(fresh.history().steady_over(Micros::ZERO, Micros::ZERO), None, "nothing is known before");
    }

    #[test]
    fn history_reaches_back_far_enough_and_forgets_beyond() {
        let mut laser = LaserCode::new(Secret::new([3; 16]));
        for tick in 0..=400 {
            laser.step(at(tick * 5), LaserMode::Coded);
        }
        assert_eq!(laser.history().drives.iter().flatten().count(), REMEMBERED_CHANGES);
        let now = 2_000_u64;
        let known = (0..320)
            .filter(|age| laser.history().steady_over(at(now - age), at(now - age)).is_some())
            .count();
        assert_eq!(known, 320, "every millisecond of the last 320");
        assert_eq!(laser.history().steady_over(Micros::ZERO, Micros::ZERO), None);
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let new = || LaserCode::new(Secret::new([3; 16]));
        let after = |drives: &[(u64, u8)]| {
            let mut history = DriveHistory::new();
            drives.iter().for_each(|(since, level)| history.note(at(*since), *level));
            LaserCode { history, ..new() }
        };
        let all = [
            new(),
            LaserCode::new(Secret::NONE),
            LaserCode { level: LASER_FULL, ..new() },
            LaserCode { symbol: 1, ..new() },
            LaserCode { run: 1, ..new() },
            LaserCode { symbol_began: Some(at(0)), ..new() },
            LaserCode { symbol_began: Some(at(1)), ..new() },
            after(&[(1, LASER_FULL)]),
            after(&[(2, LASER_FULL)]),
            after(&[(1, LASER_DIMMED)]),
            after(&[(1, LASER_FULL), (2, LASER_DIMMED)]),
        ];
        crate::testing::all_differ(all.map(|laser| laser.words().collect::<Vec<_>>()));
    }
}
