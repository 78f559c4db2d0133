//! Light-to-light liveness: do the pictures show the code that this controller dims the laser by?
//!
//! The line-scan carries how bright the stripe is in 64 parts of the picture. From one picture whose laser level is
//! known to the next, most parts must have become dimmer, brighter or stayed, as the code says. A picture that was
//! exposed while the level changed (within its exposure time and [`EXPOSURE_UNCERTAINTY`]) tells nothing.
//!
//! | event | doubt |
//! |---|---|
//! | a change of level that the light shows: a **proof** | -1 |
//! | a change that it does not show, or one that the laser did not make | +2 |
//! | no majority among the parts | 0 |
//!
//! The pictures are live while the doubt is below [`LIVENESS_DOUBT_LIMIT`] and the last proof is no older than
//! [`LIVENESS_TIMEOUT`]. A frozen picture misses two changes within 160 ms of its freezing, which this controller knows
//! at most 110 ms later (age of the picture and of the message): **within 270 ms, 14 frames at 50 a second**. A covered
//! lens, a synthetic picture of constant brightness, a neighbour's laser and a dead one do the same or have no
//! brightness at all: then the time-out stops. A recording of an earlier code is right about half of the changes: doubt
//! grows by 0.5 a change, so that it is found after 8 changes on average.
//!
//! **False alarms.** A change is missed where more than half of 64 parts are wrong. With parts wrong one in five
//! (far more than measured) Hoeffding's bound is exp(-2 x 64 x 0.3^2) = 1e-5 a change; two such within three changes
//! are 2e-10, one in 13 years of driving. **Misses.** A blind host must guess each of 12 changes a second: one chance in
//! 4096 to last a second, 6e-8 for two.
//!
//! It also measures: from the level's change to the first line-scan that shows it is the age of the light, without
//! believing the host's clock.

use crate::laser_code::{DriveHistory, LASER_OFF};
use nearfield_shared::light::{BrightnessProfile, LightChange};
use nearfield_shared::limits::{EXPOSURE_UNCERTAINTY, LIVENESS_DOUBT_LIMIT, LIVENESS_TIMEOUT};
use nearfield_shared::units::Micros;

/// A missed or invented change.
const MISS: u16 = 2;
/// A proof takes away this much.
const PROOF: u16 = 1;
/// Doubt grows no further: three proofs make good again.
const MOST_DOUBT: u16 = LIVENESS_DOUBT_LIMIT.saturating_add(MISS);

/// A picture as the host says that it was taken.
#[derive(Debug, Clone, Copy)]
pub struct Exposed {
    /// The exposure's middle, on this controller's clock.
    pub middle: Micros,
    /// Its length.
    pub length: Micros,
}

impl Exposed {
    /// The level of the laser during all of it, if there was one.
    #[must_use]
    pub fn drive(&self, history: &DriveHistory) -> Option<crate::laser_code::Drive> {
        let half = Micros::new(self.length.get() >> 1).plus(EXPOSURE_UNCERTAINTY);
        history.steady_over(self.middle.since(half), self.middle.plus(half))
    }
}

/// Judges picture after picture; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Liveness {
    before: BrightnessProfile,
    before_level: u8,
    doubt: u16,
    last_proof: Option<Micros>,
    light_age: Micros,
    longest_light_age: Micros,
}

impl Liveness {
    /// Nothing proven.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            before: BrightnessProfile::DARK,
            before_level: LASER_OFF,
            doubt: 0,
            last_proof: None,
            light_age: Micros::ZERO,
            longest_light_age: Micros::ZERO,
        }
    }

    /// Earlier pictures no longer count, proofs neither; doubts do.
    pub const fn forget(&mut self) {
        self.before = BrightnessProfile::DARK;
        self.before_level = LASER_OFF;
        self.last_proof = None;
    }

    /// A picture has arrived.
    pub fn observe(
        &mut self,
        now: Micros,
        exposed: Exposed,
        profile: &BrightnessProfile,
        history: &DriveHistory,
    ) {
        let Some(drive) = exposed.drive(history) else { return };
        let (before, before_level) = (self.before, self.before_level);
        (self.before, self.before_level) = (*profile, drive.level);
        if before_level == LASER_OFF || drive.level == LASER_OFF {
            return;
        }
        let expected = match drive.level.cmp(&before_level) {
            core::cmp::Ordering::Less => LightChange::Dimmer,
            core::cmp::Ordering::Equal => LightChange::Same,
            core::cmp::Ordering::Greater => LightChange::Brighter,
        };
        let seen = profile.change_since(&before);
        if seen == LightChange::Unclear {
            return;
        }
        if seen != expected {
            self.doubt = self.doubt.saturating_add(MISS).min(MOST_DOUBT);
        } else if expected != LightChange::Same {
            self.doubt = self.doubt.saturating_sub(PROOF);
            self.last_proof = Some(now);
            self.light_age = now.since(drive.since);
            self.longest_light_age = self.longest_light_age.max(self.light_age);
        }
    }

    /// Are the pictures proven to be live?
    #[must_use]
    pub fn is_live(&self, now: Micros) -> bool {
        self.doubt < LIVENESS_DOUBT_LIMIT
            && self.last_proof.is_some_and(|proof| now.since(proof) <= LIVENESS_TIMEOUT)
    }

    /// The doubt.
    #[must_use]
    pub const fn doubt(&self) -> u16 {
        self.doubt
    }

    /// From a change of the laser to the line-scan that showed it: the last one, and the longest since start. Zero = none
    /// yet.
    #[must_use]
    pub const fn light_ages(&self) -> [Micros; 2] {
        [self.light_age, self.longest_light_age]
    }

    /// What it rests on, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 2] {
        [self.last_proof.map_or(u64::MAX, Micros::get), u64::from(self.doubt)]
    }
}

impl Default for Liveness {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laser_code::LaserCode;
    use crate::secret::Secret;
    use nearfield_shared::condition::LaserMode;
    use nearfield_shared::limits::{LASER_DIMMED, LASER_FULL};

    const EXPOSURE: Micros = Micros::from_millis(4);
    /// From the middle of the exposure to the arrival.
    const AGE: u64 = 40;

    fn at(millis: u64) -> Micros {
        Micros::from_millis(millis)
    }

    /// What a sensor sees of a level, with the stripe's core clipped: a factor of 0.8.
    fn lit(level: u8) -> BrightnessProfile {
        let value = match level {
            LASER_FULL => 10_000,
            LASER_DIMMED => 8_000,
            _ => 0,
        };
        BrightnessProfile { blocks: [value; 64] }
    }

    /// A laser on a clock of ticks, and pictures 50 times a second.
    struct Bench {
        laser: LaserCode,
        liveness: Liveness,
        now: u64,
        levels: Vec<(u64, u8)>,
    }

    impl Bench {
        fn new(seed: u8) -> Self {
            let secret = Secret::new([seed; 16]);
            Self { laser: LaserCode::new(secret), liveness: Liveness::new(), now: 0, levels: Vec::new() }
        }

        fn level_at(&self, time: u64) -> u8 {
            self.levels.iter().rev().find(|(since, _)| *since <= time).map_or(0, |(_, level)| *level)
        }

        /// A frame period; `show` makes a picture's light from the level at its exposure.
        fn frame(&mut self, show: impl Fn(u64, u8) -> BrightnessProfile) {
            for _ in 0..4 {
                let level = self.laser.step(at(self.now), LaserMode::Coded);
                self.levels.push((self.now, level));
                self.now += 5;
            }
            let exposed = self.now.saturating_sub(AGE);
            let picture = show(exposed, self.level_at(exposed));
            let taken = Exposed { middle: at(exposed), length: EXPOSURE };
            self.liveness.observe(at(self.now), taken, &picture, self.laser.history());
        }

        fn honest(&mut self, frames: u32) {
            for _ in 0..frames {
                self.frame(|_, level| lit(level));
            }
        }

        /// Milliseconds until the pictures no longer count as live.
        fn until_stop(&mut self, show: impl Fn(u64, u8) -> BrightnessProfile) -> u64 {
            assert!(self.liveness.is_live(at(self.now)));
            let start = self.now;
            while self.liveness.is_live(at(self.now)) {
                self.frame(&show);
                assert!(self.now < start + 10_000, "never");
            }
            self.now - start
        }
    }

    #[test]
    #[cfg_attr(miri, ignore = "twenty thousand frames")]
    fn honest_light_is_live_for_ever_and_without_doubt() {
        for seed in 0..20 {
            let mut bench = Bench::new(seed);
            assert!(!bench.liveness.is_live(at(0)), "nothing is proven at start");
            bench.honest(20);
            for _ in 0..1_000 {
                bench.honest(1);
                assert!(bench.liveness.is_live(at(bench.now)) && bench.liveness.doubt() == 0);
            }
            let [age, longest] = bench.liveness.light_ages();
            assert!(age >= at(AGE) && age <= longest && longest <= at(AGE + 40), "{longest:?}");
        }
    }

    #[test]
    fn frozen_covered_and_dead_light_stops_within_the_stated_time() {
        for seed in 0..50 {
            let (mut frozen, mut covered) = (Bench::new(seed), Bench::new(seed));
            frozen.honest(30);
            covered.honest(30);
            let taken = frozen.until_stop(|_, _| lit(LASER_FULL));
            assert!(taken <= 270, "frozen: {taken} ms");
            let taken = covered.until_stop(|_, _| BrightnessProfile::DARK);
            assert!(taken <= LIVENESS_TIMEOUT.get() / 1000 + 20, "covered: {taken} ms");
        }
    }

    #[test]
    fn a_replay_and_a_stale_picture_stop() {
        for seed in 0..20 {
            let (mut replay, mut stale, other) = (Bench::new(seed), Bench::new(seed), Bench::new(seed + 100));
            let mut other = other;
            other.honest(1_000);
            replay.honest(30);
            let taken = replay.until_stop(|exposed, _| lit(other.level_at(exposed)));
            assert!(taken <= 2_000, "replay: {taken} ms");
            stale.honest(30);
            let levels = stale.levels.clone();
            let level_at =
                |time: u64| levels.iter().rev().find(|(since, _)| *since <= time).map_or(0, |(_, l)| *l);
            let taken = stale.until_stop(|exposed, _| lit(level_at(exposed.saturating_sub(500))));
            assert!(taken <= 2_000, "half a second old: {taken} ms");
        }
    }

    #[test]
    fn doubt_needs_two_misses_and_three_proofs_make_good() {
        let mut bench = Bench::new(1);
        bench.honest(30);
        let inverted = |level: u8| lit(if level == LASER_FULL { LASER_DIMMED } else { LASER_FULL });
        let mut doubts = vec![0];
        while bench.liveness.doubt() < MOST_DOUBT {
            assert!(bench.now < 3_000, "never in doubt: {doubts:?}");
            bench.frame(|_, level| inverted(level));
            if bench.liveness.doubt() != doubts[doubts.len() - 1] {
                doubts.push(bench.liveness.doubt());
                assert_eq!(
                    bench.liveness.is_live(at(bench.now)),
                    bench.liveness.doubt() < LIVENESS_DOUBT_LIMIT
                );
            }
        }
        assert_eq!(doubts, [0, 2, 4, 6]);
        for _ in 0..10 {
            bench.frame(|_, level| inverted(level));
        }
        assert_eq!(bench.liveness.doubt(), MOST_DOUBT, "and no further");
        let before = bench.now;
        while !bench.liveness.is_live(at(bench.now)) {
            bench.honest(1);
            assert!(bench.now - before <= 400, "{}", bench.now - before);
        }
        assert_eq!(bench.liveness.doubt(), 3);
    }

    #[test]
    fn a_light_that_changes_by_itself_is_no_laser_of_ours() {
        let mut bench = Bench::new(2);
        bench.honest(30);
        let taken =
            bench.until_stop(|exposed, _| lit(if exposed % 100 < 50 { LASER_FULL } else { LASER_DIMMED }));
        assert!(taken <= 500, "{taken} ms");
    }

    #[test]
    fn a_proof_lasts_for_its_time_and_a_silence_takes_it() {
        let mut bench = Bench::new(3);
        bench.honest(30);
        let proof = bench.liveness.last_proof.unwrap();
        assert!(bench.liveness.is_live(proof.plus(LIVENESS_TIMEOUT)));
        assert!(!bench.liveness.is_live(Micros::new(proof.plus(LIVENESS_TIMEOUT).get() + 1)));
        bench.liveness.forget();
        assert!(!bench.liveness.is_live(at(bench.now)));
        bench.honest(12);
        assert!(bench.liveness.is_live(at(bench.now)));
    }

    #[test]
    fn a_picture_across_a_change_tells_nothing() {
        let mut laser = LaserCode::new(Secret::new([3; 16]));
        laser.step(at(100), LaserMode::Coded);
        laser.step(at(200), LaserMode::Dark);
        let margin = EXPOSURE.get() / 2 + EXPOSURE_UNCERTAINTY.get();
        let drive =
            |middle: u64| Exposed { middle: Micros::new(middle), length: EXPOSURE }.drive(laser.history());
        assert_eq!(drive(100_000 + margin - 1), None);
        assert!(drive(100_000 + margin).is_some());
        assert!(drive(200_000 - margin - 1).is_some());
        assert_eq!(drive(200_000 - margin), None);
        assert_eq!(drive(200_000 + margin).map(|drive| drive.level), Some(LASER_OFF));
    }

    #[test]
    fn light_out_of_the_dark_or_into_it_is_no_proof() {
        let mut liveness = Liveness::new();
        let mut laser = LaserCode::new(Secret::new([3; 16]));
        laser.step(at(0), LaserMode::Dark);
        laser.step(at(100), LaserMode::Coded);
        let taken = |middle: u64| Exposed { middle: at(middle), length: EXPOSURE };
        // However bright the dark picture is (a lamp), and whatever the next one makes of it.
        for dark in [lit(LASER_OFF), lit(LASER_DIMMED), lit(LASER_FULL)] {
            for light in [lit(LASER_DIMMED), lit(LASER_FULL)] {
                liveness.observe(at(90), taken(50), &dark, laser.history());
                assert_eq!((liveness.doubt(), liveness.is_live(at(90))), (0, false), "into the dark");
                liveness.observe(at(160), taken(120), &light, laser.history());
                assert_eq!((liveness.doubt(), liveness.is_live(at(160))), (0, false), "out of the dark");
            }
        }
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let new = Liveness::new;
        let all = [
            new(),
            Liveness { doubt: 1, ..new() },
            Liveness { last_proof: Some(at(0)), ..new() },
            Liveness { last_proof: Some(at(1)), ..new() },
        ];
        crate::testing::all_differ(all.map(|liveness| liveness.words()));
    }
}
