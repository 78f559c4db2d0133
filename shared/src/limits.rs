//! Every limit of the safety function: unit, source and reason. Tests check each on both sides.

use crate::units::{Micros, Millimetres, SignalQuality};

/// Tier 1: a stripe cut for longer than this stops. Source: paper, section 3.3 ("typically five millimetres").
pub const LONGEST_ALLOWED_GAP: Millimetres = Millimetres::new(5.0);
/// Tier 1: length of the running average along the stripe. Source: paper, section 3.3.
pub const AVERAGING_WINDOW: Millimetres = Millimetres::new(5.0);
/// Tier 1: frames in the vote, this one and two earlier ones. Source: paper, section 3.3.
pub const VOTE_FRAMES: usize = 3;
/// Tier 1: a gap longer than this in one single frame stops at once, without the vote. Reason: speckle and noise
/// cut single columns, never four windows in a row; a foot or a box must not wait 20 ms for a second opinion.
pub const IMMEDIATE_GAP: Millimetres = Millimetres::new(20.0);
/// Tier 1: a stripe point within this distance of the floor is floor. Reason: floors are uneven by 1 mm and the
/// worst rig resolves 0.65 px/mm; objects that matter lift the stripe by more (5 mm seen from above is z = 3.3 mm).
pub const FLOOR_TOLERANCE: Millimetres = Millimetres::new(1.8);
/// Tier 2: from this height on an object is large. Source: paper, table 1.
pub const LARGE_HEIGHT: Millimetres = Millimetres::new(50.0);
/// Tier 2: the floor may drop away by this much and no more. Reason: a robot's wheels take 5 mm; tiles, joints and
/// door sills stay above it.
pub const DEEPEST_ALLOWED_DROP: Millimetres = Millimetres::new(-5.0);
/// Tier 2: the highest point the column maps are fitted for. Heights above it are reported, but less exactly.
pub const HIGHEST_MAPPED: Millimetres = Millimetres::new(200.0);
/// Tier 2: the deepest point the column maps are fitted for.
pub const DEEPEST_MAPPED: Millimetres = Millimetres::new(-30.0);
/// A column whose signal is weaker than this has no stripe. Reason: below it the extractor's confidence does not
/// tell stripe from texture any more.
pub const WEAKEST_SIGNAL: SignalQuality = SignalQuality::new(24);

/// Longest wire message in either direction, bytes. Source: Linux spidev's default `bufsiz`.
pub const LARGEST_TRANSFER: usize = 4096;
/// Columns of a line-scan. Source: the chroma grid of a 2304-wide YUV420 frame.
pub const LARGEST_COLUMN_COUNT: usize = 1152;
/// Highest row that the line-scan's Q12.4 can carry.
pub const LARGEST_IMAGE_HEIGHT: u16 = 4095;
/// Widest picture that a rig may name (the camera's 4608 columns; four image columns for one of the line-scan).
pub const LARGEST_IMAGE_WIDTH: u16 = 4608;

/// A line-scan whose picture is older than this at its evaluation is stale. Reason: two frame periods at 50 frames
/// per second plus read-out; DESIGN of the response time adds it up.
pub const LONGEST_CAPTURE_AGE: Micros = Micros::from_millis(60);
/// No accepted line-scan for this long stops. Reason: three frame periods at 50 frames per second; shorter would
/// stop on one lost frame.
pub const LINK_TIMEOUT: Micros = Micros::from_millis(60);
/// A line-scan was put together no longer ago than this, on the MCU's own clock (the age of the status that it
/// answers). Reason: two frame periods at 50 frames per second, so that one lost exchange is tolerated, and a tick.
pub const LONGEST_MESSAGE_AGE: Micros = Micros::from_millis(45);
/// Sequence numbers of accepted line-scans rise by no more than this: one may be lost.
pub const LARGEST_SEQUENCE_STEP: u32 = 2;
/// A second refused line-scan within this time of the one before stops, and the stop latches; a single one is
/// discarded like a lost one. Reason: at a bit error rate of 1e-9 (a damaged cable) single errors are half an hour
/// apart; two within a minute are no chance.
pub const LINK_ERROR_INTERVAL: Micros = Micros::from_millis(60_000);
/// Consecutive good line-scans that the link needs before it counts as healthy.
pub const HEALTHY_STREAK: u32 = 3;

/// The safety task's period.
pub const TICK_PERIOD: Micros = Micros::from_millis(5);
/// The safety task may be late by no more than this (deadline supervision).
pub const LONGEST_TICK_PERIOD: Micros = Micros::from_millis(15);
/// Two ticks are at least this far apart. Reason: a clock that stands still would keep every age at zero.
pub const SHORTEST_TICK_PERIOD: Micros = Micros::from_millis(1);
/// A watchdog that is not fed for this long resets the MCU, which opens the relays. Reason: several missed deadlines
/// of the safety task, and well within the stopping time's budget for a fault of the controller itself.
pub const WATCHDOG_TIMEOUT: Micros = Micros::from_millis(100);
/// Both feedback contacts must follow their channel within this time. Source: force-guided relays drop out within
/// 20 ms; the margin covers contact bounce.
pub const FEEDBACK_DISCREPANCY: Micros = Micros::from_millis(50);
/// A reset press must last at least this long (a bounce or a glitch is no reset) ...
pub const SHORTEST_RESET_PRESS: Micros = Micros::from_millis(100);
/// ... and at most this long (a button that is stuck or taped down is no reset).
pub const LONGEST_RESET_PRESS: Micros = Micros::from_millis(3000);

/// The laser code's full and dimmed levels, 255 = full brightness. Reason: 60 % leaves at least 0.80 of the light signal
/// where the stripe is clipped, clearly below [`crate::light`]'s 0.9, and costs the vision two fifths of its contrast.
pub const LASER_FULL: u8 = 255;
/// See [`LASER_FULL`].
pub const LASER_DIMMED: u8 = 153;
/// Length of one symbol of the laser's code. Reason: two frame periods at 50 frames per second, so that within every
/// symbol at least one picture is exposed whole, for exposures up to 10 ms.
pub const LASER_SYMBOL: Micros = Micros::from_millis(40);
/// Equal symbols in a row, at most. Reason: a light that does not change is told within this many symbols.
pub const LONGEST_SYMBOL_RUN: u8 = 2;
/// A picture may have been exposed this much earlier or later than the host says, beyond half its exposure time. Reason:
/// rolling shutter over the stripe's rows (a quarter of 17.3 ms for a diagonal stripe) and the laser's ticks.
pub const EXPOSURE_UNCERTAINTY: Micros = Micros::from_millis(5);
/// The laser's code must have been seen in the light no longer ago than this. Reason: with at most two equal symbols
/// it changes every 80 ms; four changes may go unseen in a row (an object that covers most of the stripe has stopped
/// the robot by then), and the picture is up to 105 ms old.
pub const LIVENESS_TIMEOUT: Micros = Micros::from_millis(450);
/// Doubt at which the light is not live: two changes that did not come, without two that did between them.
pub const LIVENESS_DOUBT_LIMIT: u16 = 4;
/// Arming: pictures that must show the dark laser as a cut stripe.
pub const DARK_PROOFS: u8 = 2;
/// Arming: at most this share of the columns may look like floor in the dark, one in so many. Reason: noise and
/// reflections; a vision that invents a stripe invents more.
pub const DARK_FLOOR_DIVISOR: u16 = 20;
/// Arming: the dark must be proven, and after it the light, within this time each. Reason: five times what they need.
pub const ARMING_TIMEOUT: Micros = Micros::from_millis(1000);

/// Audit: the controller's own peak may differ from the reported row by this, pixels. Reason: chroma has half the rows,
/// a clipped core has two flanks; a row is about 1.5 mm of height at most.
pub const AUDIT_TOLERANCE_ROWS: f32 = 3.0;
/// Audit: doubt that one contradicted window adds ...
pub const AUDIT_CONTRADICTION: u16 = 40;
/// ... and one confirmed window takes away.
pub const AUDIT_CONFIRMATION: u16 = 1;
/// Audit: doubt at which the host is not believed. Reason: Wald's test of "one column in 17 is invented" against "one
/// in 200 is misread": six contradictions; eight at once come from a host that answers nothing or shifts everything.
pub const AUDIT_DOUBT_LIMIT: u16 = 240;
/// Audit: contradictions in one of the stripe's blocks, without a confirmation there between them, at which the host is
/// not believed. Reason: an invention as short as one object meets the same block again and again.
pub const AUDIT_BLOCK_LIMIT: u8 = 3;

/// Health: a floor that lies this far from where the calibration says (mean over seconds) stops: beyond half of what
/// tells floor from object, either is taken for the other.
pub const LARGEST_FLOOR_OFFSET: Millimetres = Millimetres::new(1.0);
/// Health: ... and warns from here.
pub const WARNING_FLOOR_OFFSET: Millimetres = Millimetres::new(0.5);
/// Health: an object this high must be seen as one everywhere: the floor's tolerance, its offset and three standard
/// deviations of its noise together. Reason: seen from above, a 5 mm object lifts the stripe by 3.3 mm.
pub const CONFIGURED_OBJECT_HEIGHT: Millimetres = Millimetres::new(3.3);
/// Health: ... and warns from here.
pub const WARNING_OBJECT_HEIGHT: Millimetres = Millimetres::new(2.8);
/// Health: ambient light beside the stripe from which the controller warns (255 = white).
pub const WARNING_AMBIENT: u8 = 220;
/// Health: share of clipped columns from which the controller warns (255 = all).
pub const WARNING_SATURATED: u8 = 230;
/// Speed that the controller permits while a health warning holds, per cent of the configured one.
pub const REDUCED_SPEED_PERCENT: u8 = 50;

/// Run-over: debris is lower than this everywhere, as the controller itself measures it. Reason: the paper's small class
/// ends at 50 mm; what is seen from one side may be higher a little farther back.
pub const RUN_OVER_HEIGHT: Millimetres = Millimetres::new(40.0);
/// Run-over: debris covers no more of the stripe than this. Reason: hand tools and packing tape, not a plank.
pub const LONGEST_RUN_OVER_STRETCH: Millimetres = Millimetres::new(200.0);
/// Run-over: what is no debris objects this far beside it. Reason: the size of a hand that reaches for it.
pub const RUN_OVER_OBJECTION_MARGIN: Millimetres = Millimetres::new(100.0);
/// Run-over: confidence that a claim needs, 255 = certain. Reason: calibrated probability 0.9; the height is the
/// controller's own in any case.
pub const LEAST_CLAIM_CONFIDENCE: u8 = 230;
/// Run-over: age of the picture that a claim comes from, at most. Reason: several detections at 25 pictures per second.
pub const LONGEST_CLAIM_AGE: Micros = Micros::from_millis(300);
/// Run-over: consecutive line-scans whose claims agree before a stretch may pass.
pub const RUN_OVER_AGREEMENT: usize = 3;
/// Run-over: a permit ends this long after its first use. Reason: at 0.3 m/s a stretch of 300 mm has passed; what lies
/// there longer is no debris that is being run over.
pub const LONGEST_RUN_OVER: Micros = Micros::from_millis(1000);

/// Pulse test: one channel's turn comes this often; both are tested within twice the time. Reason: a fault is found
/// long before a second, independent one is likely.
pub const PULSE_PERIOD: Micros = Micros::from_millis(500);
/// Pulse test: length of the pulse that the board applies, microseconds. Reason: far shorter than a relay's drop-out or
/// pick-up (5 ms and more), far longer than a driver's switching.
pub const PULSE_LENGTH: Micros = Micros::new(300);

/// Rig checks: a camera or laser lower than this over the floor is a mistake, millimetres.
pub const LOWEST_MOUNT_MM: f64 = 10.0;
/// Rig checks: no coordinate is farther from the robot's edge than this, millimetres.
pub const FARTHEST_COORDINATE_MM: f64 = 10_000.0;
/// Rig checks: shortest stripe that makes sense, millimetres (two averaging windows and a bit).
pub const SHORTEST_STRIPE_MM: f64 = 20.0;
/// Rig checks: unit vectors and rotation matrices may miss their conditions by this (nine decimals written by tools,
/// f32 in the compact form).
pub const UNIT_TOLERANCE: f64 = 1e-4;
/// Rig checks: points said to lie on the floor or in the laser's sheet may miss it by this, millimetres.
pub const INCIDENCE_TOLERANCE_MM: f64 = 1.0;
/// Rig checks: largest magnitude of each distortion coefficient; a lens beyond it needs another model (fisheye).
pub const DISTORTION_LIMIT: f64 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// The other tests check every limit on both sides of wherever it is. This one holds the limits themselves: who
    /// moves one must find its reason above, and the response times and the safety concept that follow from it.
    #[test]
    fn no_limit_moves_unnoticed() {
        let lengths = [
            (LONGEST_ALLOWED_GAP, 5.0),
            (AVERAGING_WINDOW, 5.0),
            (IMMEDIATE_GAP, 20.0),
            (FLOOR_TOLERANCE, 1.8),
            (LARGE_HEIGHT, 50.0),
            (DEEPEST_ALLOWED_DROP, -5.0),
            (HIGHEST_MAPPED, 200.0),
            (DEEPEST_MAPPED, -30.0),
            (LARGEST_FLOOR_OFFSET, 1.0),
            (WARNING_FLOOR_OFFSET, 0.5),
            (CONFIGURED_OBJECT_HEIGHT, 3.3),
            (WARNING_OBJECT_HEIGHT, 2.8),
            (RUN_OVER_HEIGHT, 40.0),
            (LONGEST_RUN_OVER_STRETCH, 200.0),
            (RUN_OVER_OBJECTION_MARGIN, 100.0),
        ];
        for (limit, millimetres) in lengths {
            assert_eq!(limit, Millimetres::new(millimetres));
        }
        let times = [
            (LONGEST_CAPTURE_AGE, 60_000),
            (LINK_TIMEOUT, 60_000),
            (LONGEST_MESSAGE_AGE, 45_000),
            (LINK_ERROR_INTERVAL, 60_000_000),
            (LONGEST_TICK_PERIOD, 15_000),
            (SHORTEST_TICK_PERIOD, 1_000),
            (WATCHDOG_TIMEOUT, 100_000),
            (FEEDBACK_DISCREPANCY, 50_000),
            (SHORTEST_RESET_PRESS, 100_000),
            (LONGEST_RESET_PRESS, 3_000_000),
            (LASER_SYMBOL, 40_000),
            (LIVENESS_TIMEOUT, 450_000),
            (ARMING_TIMEOUT, 1_000_000),
            (PULSE_PERIOD, 500_000),
            (LONGEST_CLAIM_AGE, 300_000),
            (LONGEST_RUN_OVER, 1_000_000),
        ];
        for (limit, micros) in times {
            assert_eq!(limit, Micros::new(micros));
        }
        assert_eq!((VOTE_FRAMES, HEALTHY_STREAK, LARGEST_SEQUENCE_STEP), (3, 3, 2));
        assert_eq!((LIVENESS_DOUBT_LIMIT, AUDIT_DOUBT_LIMIT, AUDIT_BLOCK_LIMIT, DARK_PROOFS), (4, 240, 3, 2));
        assert_eq!(WEAKEST_SIGNAL, SignalQuality::new(24));
        assert_eq!((LEAST_CLAIM_CONFIDENCE, RUN_OVER_AGREEMENT), (230, 3));
    }
}
