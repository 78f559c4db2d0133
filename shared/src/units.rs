//! Newtypes for every quantity that crosses a function boundary: a bare number never says what it measures.

use num_traits::ToPrimitive as _;

/// A length or a coordinate in millimetres.
///
/// ```
/// use nearfield_shared::units::Millimetres;
/// assert!(Millimetres::new(5.5) > Millimetres::new(5.0));
/// assert_eq!(Millimetres::new(5.5).to_micrometres(), 5500);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct Millimetres(f32);

impl Millimetres {
    /// Zero length.
    pub const ZERO: Self = Self(0.0);

    /// `millimetres` may be anything; comparisons with NaN are false, so callers ask "is it proven small enough?".
    #[must_use]
    pub const fn new(millimetres: f32) -> Self {
        Self(millimetres)
    }

    /// The bare number, in millimetres.
    #[must_use]
    pub const fn get(self) -> f32 {
        self.0
    }

    /// Rounded to whole micrometres for the wire, saturated; NaN becomes `i32::MAX`, which readers treat as unknown.
    #[must_use]
    pub fn to_micrometres(self) -> i32 {
        let micrometres = self.0 * 1000.0;
        match (micrometres + 0.5_f32.copysign(micrometres)).to_i32() {
            Some(value) => value,
            None if micrometres < 0.0 => i32::MIN,
            None => i32::MAX,
        }
    }

    /// The inverse of [`Self::to_micrometres`].
    #[must_use]
    pub fn from_micrometres(micrometres: i32) -> Self {
        Self(narrow(f64::from(micrometres) / 1000.0))
    }

    /// Magnitude.
    #[must_use]
    pub fn abs(self) -> Self {
        Self(self.0.abs())
    }

    /// Sum.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }

    /// Difference.
    #[must_use]
    pub fn minus(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

/// f64 to f32, rounded to nearest; magnitudes beyond f32 become infinite.
#[must_use]
pub fn narrow(value: f64) -> f32 {
    value.to_f32().unwrap_or(f32::NAN)
}

/// A row of the image in sixteenths of a pixel (Q12.4), the line-scan's form. Integer = pixel centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct SubpixelRow(u16);

impl SubpixelRow {
    /// Says "no stripe in this column" on the wire.
    pub const NONE: Self = Self(u16::MAX);
    /// Steps in one pixel.
    pub const STEPS_PER_PIXEL: f32 = 16.0;

    /// From the wire's raw value.
    #[must_use]
    pub const fn from_raw(raw: u16) -> Self {
        Self(raw)
    }

    /// Rounds a row in pixels to the nearest sixteenth; `None` outside 0..4095.9 or for NaN.
    #[must_use]
    pub fn from_pixels(row: f32) -> Option<Self> {
        if row < 0.0 {
            return None;
        }
        (row * Self::STEPS_PER_PIXEL + 0.5).to_u16().map(Self).filter(|row| *row != Self::NONE)
    }

    /// The wire's raw value.
    #[must_use]
    pub const fn raw(self) -> u16 {
        self.0
    }

    /// In pixels; `None` for [`Self::NONE`].
    #[must_use]
    pub fn to_pixels(self) -> Option<f32> {
        if self == Self::NONE { None } else { Some(f32::from(self.0) / Self::STEPS_PER_PIXEL) }
    }
}

/// How well the stripe is seen in a column, 0 (not at all) to 255; the scale is the extractor's confidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct SignalQuality(u8);

impl SignalQuality {
    /// No stripe seen.
    pub const NONE: Self = Self(0);
    /// Best possible.
    pub const BEST: Self = Self(u8::MAX);

    /// From the wire's value.
    #[must_use]
    pub const fn new(quality: u8) -> Self {
        Self(quality)
    }

    /// The wire's value.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// A span or an instant of the MCU's monotonic clock in microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Micros(u64);

impl Micros {
    /// The clock's start, or no time at all.
    pub const ZERO: Self = Self(0);

    /// From microseconds.
    #[must_use]
    pub const fn new(micros: u64) -> Self {
        Self(micros)
    }

    /// From milliseconds, saturated.
    #[must_use]
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1000))
    }

    /// In microseconds.
    #[must_use]
    pub const fn get(self) -> u64 {
        self.0
    }

    /// In microseconds, saturated to the wire's 32 bits (71 minutes: far beyond every limit).
    #[must_use]
    pub fn to_wire(self) -> u32 {
        u32::try_from(self.0).unwrap_or(u32::MAX)
    }

    /// Time since `earlier`. A clock that ran backwards gives the longest span there is, so that every limit on an
    /// age fails: unknown means stop.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Self {
        match self.0.checked_sub(earlier.0) {
            Some(span) => Self(span),
            None => Self(u64::MAX),
        }
    }

    /// Sum, saturated.
    #[must_use]
    pub const fn plus(self, span: Self) -> Self {
        Self(self.0.saturating_add(span.0))
    }
}

/// Counts the host's line-scans; wraps at 2^32 (994 days at 50 frames per second).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SequenceNumber(u32);

impl SequenceNumber {
    /// From the wire.
    #[must_use]
    pub const fn new(number: u32) -> Self {
        Self(number)
    }

    /// For the wire.
    #[must_use]
    pub const fn get(self) -> u32 {
        self.0
    }

    /// The number that must come next.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0.wrapping_add(1))
    }

    /// How many steps ahead of `earlier` this number is, modulo 2^32: 0 is a repetition, 1 the expected next one,
    /// a few are a loss, and half the range or more means that it lies behind.
    #[must_use]
    pub const fn steps_after(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }
}

/// Which camera module a message comes from or is meant for (eight regions, four modules on one robot).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SourceId(u16);

impl SourceId {
    /// From configuration or the wire.
    #[must_use]
    pub const fn new(id: u16) -> Self {
        Self(id)
    }

    /// For the wire.
    #[must_use]
    pub const fn get(self) -> u16 {
        self.0
    }
}

/// Names one calibrated rig: the CRC-32 of its compact form. Host and MCU must agree on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CalibrationId(u32);

impl CalibrationId {
    /// From the wire or from a rig's compact form.
    #[must_use]
    pub const fn new(id: u32) -> Self {
        Self(id)
    }

    /// For the wire.
    #[must_use]
    pub const fn get(self) -> u32 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn micrometres_round_saturate_and_turn_unknown_into_the_largest_value() {
        assert_eq!(Millimetres::new(-1.2346).to_micrometres(), -1235);
        assert_eq!(Millimetres::new(1e9).to_micrometres(), i32::MAX);
        assert_eq!(Millimetres::new(-1e9).to_micrometres(), i32::MIN);
        assert_eq!(Millimetres::new(f32::NAN).to_micrometres(), i32::MAX);
        assert_eq!(Millimetres::from_micrometres(-1235).to_micrometres(), -1235);
    }

    #[test]
    fn a_row_survives_the_wire_to_a_sixteenth_and_refuses_what_it_cannot_hold() {
        let row = SubpixelRow::from_pixels(100.07).unwrap();
        assert_eq!(row.raw(), 1601);
        assert_eq!(row.to_pixels(), Some(100.0625));
        assert_eq!(SubpixelRow::from_pixels(4095.9), Some(SubpixelRow::from_raw(65534)));
        for bad in [-0.1, 4095.97, 4096.0, f32::NAN, f32::INFINITY] {
            assert_eq!(SubpixelRow::from_pixels(bad), None, "{bad}");
        }
        assert_eq!(SubpixelRow::NONE.to_pixels(), None);
    }

    #[test]
    fn a_clock_that_runs_backwards_makes_everything_too_old() {
        assert_eq!(Micros::new(5).since(Micros::new(3)), Micros::new(2));
        assert_eq!(Micros::new(3).since(Micros::new(5)), Micros::new(u64::MAX));
    }

    #[test]
    fn sequence_numbers_wrap() {
        assert_eq!(SequenceNumber::new(u32::MAX).next(), SequenceNumber::new(0));
        assert_eq!(SequenceNumber::new(1).steps_after(SequenceNumber::new(u32::MAX)), 2);
    }

    #[test]
    fn lengths_add_and_have_a_magnitude() {
        let (one, two) = (Millimetres::new(1.5), Millimetres::new(-4.0));
        assert_eq!((one.plus(two), one.minus(two)), (Millimetres::new(-2.5), Millimetres::new(5.5)));
        assert_eq!((two.abs(), one.abs()), (Millimetres::new(4.0), one));
    }

    /// A row above the picture is no row, however near to it; the first row is one.
    #[test]
    fn rows_begin_at_the_first_one() {
        assert_eq!(SubpixelRow::from_pixels(0.0), Some(SubpixelRow::from_raw(0)));
        assert_eq!(SubpixelRow::from_pixels(-0.01), None);
        assert_eq!(SubpixelRow::from_pixels(-1.0), None);
    }
}
