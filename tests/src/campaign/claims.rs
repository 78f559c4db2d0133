//! What the host of the campaign claims for run-over: nothing, lies, or the truth about debris that stays.

use nearfield_shared::action::Category;
use nearfield_shared::limits::RUN_OVER_AGREEMENT;
use nearfield_shared::run_over::{Claim, Claims, NO_CLAIMS, Stretch};
use nearfield_shared::units::Micros;

use super::Fault;

/// Where the debris of [`Fault::StayingDebris`] lies, stripe coordinates in millimetres.
pub const DEBRIS: (i16, i16) = (-30, 30);
/// Its height, millimetres.
pub const DEBRIS_HEIGHT: f32 = 20.0;
/// Frames in which it is claimed before it lies on the stripe, as a host does that sees it come.
pub const LEAD_FRAMES: usize = RUN_OVER_AGREEMENT;

fn debris(start: i16, end: i16) -> Option<Claim> {
    let stretch = Stretch::new(start, end)?;
    Some(Claim { stretch, category: Category::Tool, confidence: u8::MAX, age: Micros::from_millis(30) })
}

/// The claims of a host under these faults.
#[must_use]
pub fn claims_under(active: &[Fault]) -> Claims {
    if active.contains(&Fault::FalseClaims) {
        // All that fits, over the foot and beside it.
        return [-100, -50, 0, 50].map(|start| debris(start, start + 50));
    }
    if active.contains(&Fault::StayingDebris) {
        return [debris(DEBRIS.0 - 10, DEBRIS.1 + 10), None, None, None];
    }
    NO_CLAIMS
}
