//! What a calibration is worth, in words.

use serde::Serialize;

use super::session::Calibration;
use super::uncertainty::{HeightSigma, height_sigmas, plane_sigma_degrees};

/// A good rig's heights are sure to this, millimetres (one sigma, up to 100 mm high).
const GOOD_SIGMA_MM: f64 = 1.0;
/// Beyond this the large class (50 mm) is no longer told reliably.
const USABLE_SIGMA_MM: f64 = 3.0;
/// A board that lies flat under a well-known lens is met to this, pixels at 2304 columns.
const GOOD_BOARD_ERROR: f64 = 0.6;

/// The plain verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// Use it.
    Good,
    /// It works, but something should be better; the notes say what.
    Usable,
    /// Do not use it; the notes say why.
    Unfit,
}

impl Grade {
    /// As it is told.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Usable => "usable, see the notes",
            Self::Unfit => "not fit for use, see the notes",
        }
    }
}

/// Verdict and its reasons.
#[derive(Debug, Clone, Serialize)]
pub struct Verdict {
    /// In one word.
    pub grade: Grade,
    /// What should be known or done.
    pub notes: Vec<String>,
    /// How sure heights are along the stripe.
    pub height_sigmas: Vec<HeightSigma>,
    /// One sigma of the sheet's direction, degrees.
    pub plane_sigma_degrees: f64,
}

/// Judges a calibration.
#[must_use]
pub fn judge(calibration: &Calibration) -> Verdict {
    let height_sigmas = height_sigmas(&calibration.fit, calibration.extent, calibration.place_shift);
    let worst = height_sigmas
        .iter()
        .map(|sigma| sigma.sigma_mm)
        .filter(|sigma| sigma.is_finite())
        .fold(0.0, f64::max);
    let mut notes = Vec::new();
    let mut grade = match worst {
        worst if worst <= GOOD_SIGMA_MM => Grade::Good,
        worst if worst <= USABLE_SIGMA_MM => Grade::Usable,
        _ => Grade::Unfit,
    };
    if grade != Grade::Good {
        notes.push(format!(
            "heights are sure to {worst:.1} mm only: use a higher block, a larger board, or a calibrated lens (--lens)"
        ));
    }
    let mut weigh = |lesser: Grade, note: String| {
        notes.push(note);
        if grade == Grade::Good {
            grade = lesser;
        }
    };
    let width = f64::from(calibration.rig.image().width);
    if calibration.board_error > GOOD_BOARD_ERROR * (width / 2304.0).max(0.5) {
        let note = format!(
            "the board's corners miss by {:.2} px: is the board flat on the floor and the lens the right one?",
            calibration.board_error
        );
        weigh(Grade::Usable, note);
    }
    for block in &calibration.blocks {
        if let Some(problem) = &block.problem {
            notes.push(format!("the block of {} mm was not used: {problem}", block.stated_mm));
        }
    }
    let used = calibration.blocks.iter().filter(|block| block.measured_mm.is_some()).count();
    if used < 2 {
        notes.push(
            "one block only: nothing checks its height or the board's square size; compare the camera's height below \
             with a tape"
                .to_owned(),
        );
    }
    if calibration.lens.is_nominal() && calibration.observations.boards.len() < 2 {
        notes.push(
            "the lens was estimated from one view of the board: heights are good where the blocks stood, places along \
             the stripe less; `nearfield calibrate lens` does better"
                .to_owned(),
        );
    }
    if calibration.apex.rays < 2 {
        notes.push(format!(
            "the laser's own place rests on {} shadow(s) and on the assumption that it stands as far out as the \
             camera; heights do not depend on it, places of raised things do",
            calibration.apex.rays
        ));
    }
    Verdict {
        grade,
        notes,
        height_sigmas,
        plane_sigma_degrees: plane_sigma_degrees(&calibration.fit).unwrap_or(f64::NAN),
    }
}
