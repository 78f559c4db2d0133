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
