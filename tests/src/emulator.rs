//! What a test does where there is no emulator.

use nearfield_host::link::LinkError;

/// Skips, with the reason in the test's output, where QEMU is not installed; in CI, under `cargo xtask` (which has
/// installed it), and for every other reason, fails.
///
/// # Panics
/// The emulator is there, or has to be there, and does not work.
pub fn without_emulator(error: &LinkError) {
    let missing = matches!(error, LinkError::NoEmulator { .. });
    let required = ["CI", "NEARFIELD_EMULATOR_REQUIRED"].iter().any(|name| std::env::var_os(name).is_some());
    assert!(missing && !required, "{error}");
    println!("SKIPPED: {error}");
}
