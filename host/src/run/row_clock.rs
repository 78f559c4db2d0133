//! When the stripe was exposed, from a camera's own stamp of its picture: a rolling shutter exposes one row after the other.
//!
//! The stamp is taken as the beginning of the first row's read-out, which is when that row's exposure ends (a Raspberry Pi's
//! camera front-end stamps the start of the frame it receives). Where a driver stamps the beginning of the exposure instead, as
//! libcamera's documentation words it, the picture is younger by an exposure than is told here: the error is to the safe side.

use nearfield_shared::rig::Rig;
use nearfield_shared::units::Micros;

/// A picture that is older than this was not taken now: the stamp is of another clock, or the picture of another time.
pub const LONGEST_AGE: Micros = Micros::from_millis(1000);

/// Why a stamp tells nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StampError {
    /// It is of the future.
    #[error("the camera's time stamp is {0} us ahead of the clock since power-up; is it of another clock?")]
    Ahead(u64),
    /// It is of long ago.
    #[error("the camera's time stamp is {0} us old; its pictures are stale, or it is of another clock")]
    Stale(u64),
}

/// See the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowClock {
    /// From the stamp to the middle of the exposure of the stripe's middle row, nanoseconds; negative = before.
    offset: i64,
}

impl RowClock {
    /// For this rig, with the time from the first row's read-out to the last one's, and the exposure of each row.
    #[must_use]
    pub fn new(rig: &Rig, read_out: Micros, exposure: Micros) -> Self {
        let rows = f64::from(rig.image().height);
        let row = stripe_row(rig).clamp(0.0, rows);
        let micros = read_out.get() as f64 * row / rows - exposure.get() as f64 / 2.0;
        Self { offset: (micros * 1000.0).round() as i64 }
    }

    /// How long ago the stripe was exposed (the middle of it), by a picture's stamp and the same clock now, nanoseconds.
    ///
    /// # Errors
    /// The two cannot belong together.
    pub fn age(&self, stamp: u64, now: u64) -> Result<Micros, StampError> {
        let exposed = stamp.saturating_add_signed(self.offset);
        let Some(age) = now.checked_sub(exposed) else {
            return Err(StampError::Ahead((exposed - now) / 1000));
        };
        let age = Micros::new(age.div_ceil(1000));
        if age > LONGEST_AGE { Err(StampError::Stale(age.get())) } else { Ok(age) }
    }
}

/// The middle of the rows in which the stripe lies on the floor; the picture's middle where it lies outside.
fn stripe_row(rig: &Rig) -> f64 {
    let stripe = rig.stripe();
    let row = |place: f64| rig.camera().project(stripe.at(place)).map(|pixel| pixel.v);
    match (row(stripe.start), row(stripe.end)) {
        (Some(first), Some(last)) => (first + last) / 2.0,
        (Some(only), None) | (None, Some(only)) => only,
        (None, None) => f64::from(rig.image().height) / 2.0,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::twin::gallery;

    const READ_OUT: Micros = Micros::new(17_300);
    const EXPOSURE: Micros = Micros::new(4000);

    /// The stripe lies level, at this share of the picture's height.
    fn clock() -> (RowClock, f64) {
        let rig = gallery::CENTRE.with_width(576).rig().unwrap();
        (RowClock::new(&rig, READ_OUT, EXPOSURE), stripe_row(&rig) / f64::from(rig.image().height))
    }

    #[test]
    fn the_stripe_was_exposed_when_its_own_row_was_and_not_the_first() {
        let (clock, share) = clock();
        assert!((0.1..0.9).contains(&share), "{share}: this rig does not tell first and last row apart");
        // Nothing has passed since the first row was read: what has, is the row's time less half an exposure.
        let expected = 30_000.0 - (17_300.0 * share - 2000.0);
        let age = clock.age(1_000_000_000, 1_030_000_000).unwrap();
        assert!((age.get() as f64 - expected).abs() <= 1.0, "{} us, not {expected}", age.get());
    }

    #[test]
    fn a_longer_exposure_makes_the_picture_older_and_a_slower_read_out_younger() {
        let rig = gallery::CENTRE.with_width(576).rig().unwrap();
        let age = |read_out: u64, exposure: u64| {
            let clock = RowClock::new(&rig, Micros::new(read_out), Micros::new(exposure));
            clock.age(1_000_000_000, 1_050_000_000).unwrap().get()
        };
        assert_eq!(age(17_300, 8000), age(17_300, 4000) + 2000);
        assert!(age(30_000, 4000) < age(17_300, 4000));
    }

    #[test]
    fn a_stamp_of_the_future_or_of_long_ago_is_told_and_not_used() {
        let (clock, _) = clock();
        assert!(matches!(clock.age(2_000_000_000, 1_000_000_000), Err(StampError::Ahead(_))));
        let long_ago = clock.age(1_000_000_000, 3_000_000_000).unwrap_err();
        assert!(matches!(long_ago, StampError::Stale(age) if age > LONGEST_AGE.get()), "{long_ago}");
        // The bound itself is still believed.
        let RowClock { offset } = clock;
        let exposed = 1_000_000_000_u64.saturating_add_signed(offset);
        assert_eq!(clock.age(1_000_000_000, exposed + LONGEST_AGE.get() * 1000), Ok(LONGEST_AGE));
        assert!(clock.age(1_000_000_000, exposed + LONGEST_AGE.get() * 1000 + 1).is_err());
    }
}
