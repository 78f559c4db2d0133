//! Proof by linking that the safety core cannot panic, and the test of that proof.

use crate::run::{FIRMWARE_PROFILE, FIRMWARE_TARGET, Step};
use anyhow::{Result, bail};

/// The symbol that the proof's panic handler calls; nothing defines it.
const SYMBOL: &str = "nearfield_a_panic_path_is_left";

/// Links the safety core with a panic handler that cannot be linked; then adds a panic path and sees it caught.
pub fn prove() -> Result<()> {
    let build =
        ["build", "--package", "panic-free", "--target", FIRMWARE_TARGET, "--profile", FIRMWARE_PROFILE];
    Step::cargo(&build).run()?;
    let (linked, output) = Step::cargo(&[&build[..], &["--features", "control"]].concat()).capture()?;
    if linked {
        bail!(
            "the panic-free proof proves nothing: it links even with a panic path added (feature `control`)"
        );
    }
    if !output.contains(SYMBOL) {
        bail!("the control build of the panic-free proof failed for another reason:\n{output}");
    }
    eprintln!("panic-free: the safety core links without a panic path, and an added one is caught");
    Ok(())
}
