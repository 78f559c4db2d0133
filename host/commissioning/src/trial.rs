//! What a test piece at one place has shown.

use nearfield_shared::units::Micros;

use crate::Check;

/// The ends of the stripe are tested so far inside them, millimetres.
pub const FROM_END_MM: f64 = 60.0;
/// A hand lays a rod as exactly as this, millimetres; farther off another place was tested.
pub const LAID_WITHIN_MM: f64 = 80.0;
/// Diameter of the usual test piece, a straight rod, millimetres.
pub const PIECE_MM: f64 = 12.0;
/// The relays must stay as they are for so long.
pub const STILL: Micros = Micros::from_millis(2000);

/// One test piece at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Where it was to be laid, millimetres along the stripe.
    pub wanted_mm: f64,
    /// Middle of the gap that it made; `None` = none was seen in time.
    pub seen_mm: Option<f64>,
    /// That gap's length, millimetres.
    pub gap_mm: f64,
    /// From the exposure of the first picture with a gap that is too long to the relays' open contacts.
    pub opened_after: Option<Micros>,
    /// Did they stay open after the piece was taken away, with nobody pressing the button?
    pub stayed_open: bool,
    /// Did they close when the button was pressed?
    pub closed_again: bool,
}

impl Trial {
    /// What it must be: a gap where the piece of `piece_mm` lies (`name`: which place), relays open in time, no restart by itself.
    #[must_use]
    pub fn checks(&self, name: &str, piece_mm: f64, worst_ms: f64) -> [Check; 3] {
        let place = self.wanted_mm;
        let title = |what: &str| format!("Rod of {piece_mm} mm, {name}: {what}");
        let seen = self.seen_mm.map_or("no gap".to_owned(), |seen| {
            format!("a gap of {:.1} mm at {:.0} mm", self.gap_mm, whole(seen))
        });
        let there = self.seen_mm.is_some_and(|seen| (seen - place).abs() <= LAID_WITHIN_MM);
        let took = self.opened_after.map(|took| took.get() as f64 / 1000.0);
        let words = |good: bool, yes: &'static str, no: &'static str| if good { yes } else { no };
        [
            Check::new(
                title("seen"),
                format!("a gap within {LAID_WITHIN_MM} mm of {place:.0} mm"),
                seen,
                there,
            ),
            Check::new(
                title("relays open"),
                format!("at most {worst_ms:.0} ms after the light"),
                took.map_or("they did not open for it".to_owned(), |took| format!("{took:.0} ms")),
                took.is_some_and(|took| took <= worst_ms),
            ),
            Check::new(
                title("taken away"),
                "stay open without the button, close with it",
                format!(
                    "{}, {}",
                    words(self.stayed_open, "stayed open", "closed by themselves"),
                    words(self.closed_again, "closed with the button", "did not close with the button")
                ),
                self.stayed_open && self.closed_again,
            ),
        ]
    }
}

/// Whole millimetres, without the sign of a zero.
fn whole(millimetres: f64) -> f64 {
    millimetres.round() + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_the_stripe_has_no_sign() {
        let trial = Trial {
            wanted_mm: 0.0,
            seen_mm: Some(-0.3),
            gap_mm: 15.4,
            opened_after: None,
            stayed_open: true,
            closed_again: true,
        };
        assert_eq!(trial.checks("middle", PIECE_MM, 100.0)[0].found, "a gap of 15.4 mm at 0 mm");
    }
}
