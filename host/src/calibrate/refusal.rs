//! Why a calibration cannot go on, in words that say what to do.

use super::CalibrationError;
use super::session::Inputs;

/// No line on the floor is the stripe.
pub(super) fn no_stripe(inputs: &Inputs) -> CalibrationError {
    CalibrationError::Picture {
        path: inputs.stripe.path.clone(),
        problem: "no laser stripe is found on the floor: is the laser on, the floor clear, and is this the picture \
                  of the clean stripe?"
            .to_owned(),
    }
}

/// The stripe found is no straight line.
pub(super) fn crooked(inputs: &Inputs, noise: f64) -> CalibrationError {
    CalibrationError::Picture {
        path: inputs.stripe.path.clone(),
        problem: format!(
            "what looks like the stripe is no straight line on the floor ({noise:.1} px off): is the floor flat, the \
             stripe sharp, and is this lens described (--lens, --view)?"
        ),
    }
}

/// None of the blocks can be used, and why.
pub(super) fn no_block(inputs: &Inputs, problems: &[Option<String>]) -> CalibrationError {
    let told = inputs.blocks.iter().zip(problems).map(|(block, problem)| {
        format!("{}: {}", block.picture.path.display(), problem.as_deref().unwrap_or("not used"))
    });
    let told: Vec<String> = told.collect();
    if told.is_empty() {
        return CalibrationError::Degenerate(
            "no block: the floor alone does not tell the laser's tilt; give the stripe over a block of known height \
             (--block HEIGHT=PICTURE)"
                .to_owned(),
        );
    }
    CalibrationError::Degenerate(format!(
        "no block can be used, so the laser's tilt is unknown\n  {}",
        told.join("\n  ")
    ))
}

/// The fit does not determine all that it should.
pub(super) fn unfixed() -> CalibrationError {
    CalibrationError::Degenerate(
        "the pictures do not fix lens, floor and laser together; take the board larger in the picture and a block \
         of 50 mm or more"
            .to_owned(),
    )
}
