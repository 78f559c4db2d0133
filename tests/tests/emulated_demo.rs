//! The whole demo against both controllers at once: pictures, faults, the hang and the watchdog's restart included, the
//! firmware library in this process and the Arm binary in QEMU answer the same bytes.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use nearfield_host::demo::Engine;
use nearfield_host::demo::script::minute;
use nearfield_host::demo::view::Nobody;
use nearfield_host::link::Emulated;
use nearfield_host::twin::gallery::CENTRE;
use nearfield_tests::emulator::without_emulator;
use nearfield_tests::pair::Pair;

#[test]
fn the_whole_demo_gives_the_same_bytes_in_process_and_emulated() {
    let emulated = match Emulated::new() {
        Ok(emulated) => emulated,
        Err(error) => return without_emulator(&error),
    };
    let link = Box::new(Pair::new(emulated));
    let engine = Engine::with_script(&CENTRE.rig().unwrap(), link, 1, minute()).unwrap();
    let record = engine.play(&mut Nobody).unwrap().record;
    assert!(record.met, "the emulated controller keeps every promise, too");
    assert_eq!((record.frames.len(), record.link.watchdog_resets), (3000, 1));
}
