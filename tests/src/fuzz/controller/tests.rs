//! The rule is tested with controllers that break it: whatever commands the relays, each of its sentences must be able
//! to fail.

use super::*;
use std::panic::catch_unwind;

/// The rule would hold for a controller that never closes: it must close, and not without the button.
#[test]
fn an_honest_robot_runs_after_a_press_of_the_button() {
    assert!(controller(&arming_frames()));
    assert!(!controller(&[0; 90]));
}

const CUT: u8 = 0x07;
const SILENCE: u8 = 0x01;
const FROZEN_LIGHT: u8 = 0x0D;
const CONTACT_B_STUCK_OPEN: u8 = 0x40;
const SELF_TEST_FAILED: u8 = 0x90;
const CLOCK_JUMPS_BACK: u8 = 0xC0;
const LATE_TICK: u8 = 0xA0;

fn stays_closed(before: Outputs, commanded: Outputs, _: After) -> Outputs {
    let relays = if before.relays == Channels::CLOSED { Channels::CLOSED } else { commanded.relays };
    Outputs { relays, ..commanded }
}

fn closes_with_the_laser(_: Outputs, commanded: Outputs, _: After) -> Outputs {
    let relays = if commanded.laser_level > 0 { Channels::CLOSED } else { Channels::OPEN };
    Outputs { relays, ..commanded }
}

fn leaves_channel_b_closed(before: Outputs, commanded: Outputs, _: After) -> Outputs {
    let b = commanded.relays.b || before.relays.b;
    Outputs { relays: Channels { b, ..commanded.relays }, ..commanded }
}

fn closes_in_exchanges(_: Outputs, commanded: Outputs, after: After) -> Outputs {
    let relays = if after == After::Exchange { Channels::CLOSED } else { commanded.relays };
    Outputs { relays, ..commanded }
}

fn closes_channel_b_alone(_: Outputs, commanded: Outputs, _: After) -> Outputs {
    Outputs { relays: Channels { a: false, ..commanded.relays }, ..commanded }
}

/// What a faulty controller does, what it is put through after a start or after arming, and the sentence that it breaks.
const BROKEN: [(&str, Tampering, bool, &[u8], &str); 10] = [
    ("goes on in silence", stays_closed, true, &[SILENCE; 8], "without fresh proof of a free floor"),
    ("goes on over a cut stripe", stays_closed, true, &[CUT], "although the message itself demands a stop"),
    ("opens one channel only", leaves_channel_b_closed, true, &[CLOCK_JUMPS_BACK], "one channel alone"),
    ("closes by itself", closes_with_the_laser, false, &[0; 40], "without a press of the button"),
    ("closes between its ticks", closes_in_exchanges, true, &[], "which may only open"),
    ("does not mind a late tick", stays_closed, true, &[LATE_TICK], "that is late or too early"),
    ("forgets a failed self-test", stays_closed, true, &[SELF_TEST_FAILED], "after a failed self-test"),
    ("does not watch its contacts", stays_closed, true, &[CONTACT_B_STUCK_OPEN; 8], "while a contact lies"),
    (
        "takes light that does not change",
        stays_closed,
        true,
        &[FROZEN_LIGHT; 40],
        "in another state than running",
    ),
    ("uses one channel", closes_channel_b_alone, true, &[], "one channel alone"),
];

#[test]
fn every_sentence_of_the_rule_fails_for_a_controller_that_breaks_it() {
    for (name, tampering, armed, frames, sentence) in BROKEN {
        let start = if armed { arming_frames() } else { Vec::new() };
        let frames = [&start[..], frames].concat();
        let _ = controller(&frames);
        let complaint = catch_unwind(|| play(&frames, tampering)).expect_err(name);
        let text = complaint.downcast_ref::<String>().map_or("", String::as_str);
        assert!(text.contains(sentence), "{name}: {text}");
    }
}
