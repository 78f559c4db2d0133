//! Hands for the twin: on the page's commissioning they lay the test piece and take it away, as a person would.

use nearfield_commissioning::PIECE_MM;
use nearfield_operator::commission::{Hands, HandsAsked};

use crate::twin::SceneObject;
use crate::twin::gallery::plain;
use crate::twin::scene::Shape;

/// A straight rod of this diameter across the stripe, millimetres.
#[must_use]
pub fn test_piece(diameter_mm: f64, place_mm: f64) -> SceneObject {
    let shape = Shape::Rod { diameter_mm, length_mm: 140.0 };
    SceneObject { along_mm: place_mm, yaw_degrees: 90.0, ..plain("test piece", shape, 0.0, "grey_card") }
}

/// Pictures between what is asked and what is done: nobody is faster.
const HESITATION: u32 = 40;

/// See the module's documentation.
pub struct TwinHands {
    hands: Hands,
    asked: HandsAsked,
    waited: u32,
    /// Where the piece lies.
    laid: Option<f64>,
}

impl TwinHands {
    /// Nothing lies there yet.
    #[must_use]
    pub const fn new(hands: Hands) -> Self {
        Self { hands, asked: HandsAsked::Nothing, waited: 0, laid: None }
    }

    /// Asked once for every picture: the pieces that lie there, if that has changed.
    pub fn change(&mut self) -> Option<Option<SceneObject>> {
        let asked = self.hands.asked();
        if asked != self.asked {
            (self.asked, self.waited) = (asked, 0);
        }
        self.waited = self.waited.saturating_add(1);
        let wanted = match asked {
            _ if self.waited < HESITATION => self.laid,
            HandsAsked::Lay(place) => Some(place),
            HandsAsked::Wait => self.laid,
            HandsAsked::Nothing | HandsAsked::Press | HandsAsked::TakeAway => None,
        };
        if wanted == self.laid {
            return None;
        }
        self.laid = wanted;
        Some(wanted.map(|place| test_piece(PIECE_MM, place)))
    }
}
