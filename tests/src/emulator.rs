//! What a test does where there is no emulator.

use nearfield_host::link::LinkError;

/// Skips, with the reason in the test's output, where QEMU is not installed; in CI, and for every other reason, fails.
///
/// # Panics
/// The emulator is there, or has to be there, and does not work.
pub fn without_emulator(error: &LinkError) {
    let missing = matches!(error, LinkError::NoEmulator { .. });
    assert!(missing && std::env::var_os("CI").is_none(), "{error}");
    println!("SKIPPED: {error}");
}
