//! The scenarios of the board's model hold the firmware to times; those must be the firmware's own limits.

use nearfield_firmware::selftest::ROUND_DEADLINE;
use nearfield_firmware::selftest::clock::WINDOW;
use nearfield_shared::limits::{
    FEEDBACK_DISCREPANCY, LASER_SYMBOL, LINK_TIMEOUT, LONGEST_SYMBOL_RUN, PULSE_PERIOD, TICK_PERIOD,
    WATCHDOG_TIMEOUT,
};
use std::path::Path;

fn scenarios() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("board/scenarios.py");
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The value of `NAME = 0.060` or `NAME = 2 * 0.250`, in seconds.
fn seconds(text: &str, name: &str) -> f64 {
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(" = "));
    let value = line.unwrap_or_else(|| panic!("scenarios.py has no {name}"));
    value.split('*').map(|factor| factor.trim().parse::<f64>().expect("a number")).product()
}

#[test]
fn scenarios_keep_to_the_firmwares_limits() {
    let text = scenarios();
    for (name, micros) in [
        ("TICK", TICK_PERIOD.get()),
        ("LINK_TIMEOUT", LINK_TIMEOUT.get()),
        ("FEEDBACK", FEEDBACK_DISCREPANCY.get()),
        ("PULSES", 2 * PULSE_PERIOD.get()),
        ("ROUND", ROUND_DEADLINE.get()),
        ("CLOCK_WINDOWS", 2 * WINDOW.get()),
        ("INDEPENDENT_WATCHDOG", WATCHDOG_TIMEOUT.get()),
        ("CODE_CHANGE", u64::from(LONGEST_SYMBOL_RUN) * LASER_SYMBOL.get()),
    ] {
        let limit = micros as f64 / 1e6;
        assert!((seconds(&text, name) - limit).abs() < 1e-9, "{name}: the firmware's limit is {limit} s");
    }
}
