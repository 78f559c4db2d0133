//! Response time as a sum of named parts, and the stopping distance and permitted speed that follow from it.
//!
//! From the moment something first interrupts the light until the robot's circuit is open:
//!
//! ```text
//! wait for an exposure + exposure + read-out + image processing + host + transfer + vote + controller + relay
//! ```
//!
//! The vote over three pictures adds two frame periods for gaps of 5 to 20 mm; longer ones open at once
//! (`IMMEDIATE_GAP`). After ISO 13855 the stripe must lie at least `S = K T + C` away; here with the robot's own motion and
//! braking: `S = (v + K) (T + brake delay) + v^2 / (2 a) + C`, `K` the speed at which people walk towards it.

use nearfield_shared::limits::VOTE_FRAMES;
use nearfield_shared::linescan::LINE_SCAN_LENGTH;

use crate::file::Configuration;
use crate::sections::{LinkKind, Robot};

/// One part of the sum, milliseconds.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// What takes the time.
    pub name: &'static str,
    /// In the middle of what happens.
    pub typical_ms: f64,
    /// At most.
    pub worst_ms: f64,
    /// Where the figures come from.
    pub source: &'static str,
}

/// What the host takes, milliseconds; measured by `nearfield run` or assumed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HostTimes {
    /// Image processing before the host has the picture (ISP, driver): typical and worst.
    pub delivery_ms: (f64, f64),
    /// Vision and encoding: typical and worst.
    pub work_ms: (f64, f64),
    /// Were they measured on this host?
    pub measured: bool,
}

impl HostTimes {
    /// Before anything was measured: a frame period of delivery at most (libcamera hands a picture over when the next one
    /// begins), and a budget of 5 ms for the host that nearfield's own figures keep easily.
    pub const ASSUMED: Self = Self { delivery_ms: (3.0, 10.0), work_ms: (1.0, 5.0), measured: false };
}

/// All parts for one configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseTime {
    /// In the order of time.
    pub parts: Vec<Part>,
    /// Two frame periods for gaps that the vote decides, milliseconds; part of the sums below.
    pub vote_ms: f64,
}

/// SPI's share beside the bits: the READY line, the driver, waiting for the controller's tick at most.
const TRANSFER_OVERHEAD_MS: (f64, f64) = (0.2, 1.0);
/// The controller's own work: 250,000 instructions at 170 MHz.
const CONTROLLER_MS: (f64, f64) = (1.0, 1.5);

impl ResponseTime {
    /// For this configuration.
    #[must_use]
    pub fn of(configuration: &Configuration, host: &HostTimes) -> Self {
        let camera = &configuration.camera;
        let period = 1000.0 / camera.frames_per_second;
        let exposure = f64::from(camera.exposure_us) / 1000.0;
        let read_out = f64::from(camera.read_out_us) / 1000.0;
        let bits = 8.0 * f64::from(u32::try_from(LINE_SCAN_LENGTH).unwrap_or(u32::MAX));
        let transfer = match configuration.link.kind {
            LinkKind::Spi => 1000.0 * bits / f64::from(configuration.link.hertz),
            // A simulated controller takes bytes at once; the board's figure is what counts.
            LinkKind::InProcess | LinkKind::Emulated => 1000.0 * bits / 16e6,
        };
        let relay = configuration.robot.relay_drop_out_ms;
        let host_source = if host.measured { "measured on this host" } else { "assumed" };
        let part = |name, (typical_ms, worst_ms), source| Part { name, typical_ms, worst_ms, source };
        let parts = vec![
            part("wait for the next exposure", (period / 2.0, period), "frame rate"),
            part("exposure", (exposure / 2.0, exposure), "configuration"),
            part("read-out", (read_out / 2.0, read_out), "configuration (rows times row time)"),
            part("image processing, delivery", host.delivery_ms, host_source),
            part("host: vision, encoding", host.work_ms, host_source),
            part(
                "transfer",
                (transfer + TRANSFER_OVERHEAD_MS.0, transfer + TRANSFER_OVERHEAD_MS.1),
                "3944 bytes at the link's clock",
            ),
            part("controller", CONTROLLER_MS, "at most 250,000 instructions, counted, at 170 MHz"),
            part("relay drop-out", (relay, relay), "configuration (data sheet)"),
        ];
        let frames = f64::from(u32::try_from(VOTE_FRAMES).unwrap_or(u32::MAX)) - 1.0;
        Self { parts, vote_ms: frames * period }
    }

    /// Something narrow, decided by the vote: typical and worst, milliseconds.
    #[must_use]
    pub fn by_vote(&self) -> (f64, f64) {
        let (typical, worst) = self.at_once();
        (typical + self.vote_ms, worst + self.vote_ms)
    }

    /// Something that leaves a gap over 20 mm, or no stripe: typical and worst, milliseconds.
    #[must_use]
    pub fn at_once(&self) -> (f64, f64) {
        let sum = |value: fn(&Part) -> f64| self.parts.iter().map(value).sum();
        (sum(|part| part.typical_ms), sum(|part| part.worst_ms))
    }
}

/// Distance from the stripe to the robot that a speed needs, millimetres.
#[must_use]
pub fn stopping_distance(robot: &Robot, speed_mm_s: f64, response_ms: f64) -> f64 {
    let time = (response_ms + robot.brake_delay_ms) / 1000.0;
    let braking = speed_mm_s * speed_mm_s / (2.0 * robot.deceleration_mm_s2);
    let braking_time = speed_mm_s / robot.deceleration_mm_s2;
    // People go on walking while the robot brakes.
    (speed_mm_s + robot.approach_mm_s) * time
        + braking
        + robot.approach_mm_s * braking_time
        + robot.supplement_mm
}

/// The greatest speed that a distance permits, mm/s; 0 if even standing still does not fit.
#[must_use]
pub fn permitted_speed(robot: &Robot, distance_mm: f64, response_ms: f64) -> f64 {
    // v^2 / (2 a) + v (T + K / a) + (K T + C - S) = 0
    let time = (response_ms + robot.brake_delay_ms) / 1000.0;
    let (a, k) = (robot.deceleration_mm_s2, robot.approach_mm_s);
    let linear = time + k / a;
    let rest = k * time + robot.supplement_mm - distance_mm;
    if rest >= 0.0 {
        return 0.0;
    }
    a * ((linear * linear - 2.0 * rest / a).sqrt() - linear)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;
    use std::path::Path;

    fn configuration(text: &str) -> Configuration {
        Configuration::read(text, Path::new("robot.toml")).unwrap()
    }

    #[test]
    fn the_sum_is_what_the_safety_concept_says() {
        let response = ResponseTime::of(&configuration("[link]\nkind = \"spi\""), &HostTimes::ASSUMED);
        let (_, worst) = response.at_once();
        // 20 + 4 + 17.3 + 10 + 5 + (1.97 + 1) + 1.5 + 20
        assert!((worst - 80.77).abs() < 0.01, "{worst}");
        let (typical, voted) = response.by_vote();
        assert!((voted - worst - 40.0).abs() < 1e-9 && typical < voted);
        assert!(
            response.parts.iter().all(|part| part.typical_ms <= part.worst_ms && !part.source.is_empty())
        );
    }

    #[test]
    fn a_faster_camera_and_a_slower_link_show() {
        let fast = "[camera]\nframes_per_second = 120\nread_out_us = 8000";
        let worst = |text: &str| ResponseTime::of(&configuration(text), &HostTimes::ASSUMED).by_vote().1;
        // 11.67 ms less to wait for, twice that less to vote, 9.3 ms less to read out.
        assert!((worst("") - worst(fast) - 44.3).abs() < 0.01);
        let slow = "[link]\nkind = \"spi\"\nhertz = 1000000";
        assert!((worst(slow) - worst("[link]\nkind = \"spi\"") - 29.58).abs() < 0.01);
    }

    #[test]
    fn distances_add_up() {
        let robot = configuration("[robot]\nbrake_delay_ms = 50\nsupplement_mm = 10").robot;
        // 1 m/s, 0.15 s of delay, 2 m/s^2: 150 + 250 + 10.
        assert!((stopping_distance(&robot, 1000.0, 100.0) - 410.0).abs() < 1e-9);
        let people = Robot { approach_mm_s: 1600.0, ..robot.clone() };
        // and 1.6 m/s over 0.15 s and 0.5 s of braking
        assert!((stopping_distance(&people, 1000.0, 100.0) - 410.0 - 240.0 - 800.0).abs() < 1e-9);
        assert_eq!(permitted_speed(&people, 200.0, 100.0), 0.0);
        assert!((stopping_distance(&robot, 0.0, 100.0) - 10.0).abs() < 1e-9);
    }

    proptest! {
        /// The permitted speed is the one whose stopping distance just fits.
        #[test]
        fn the_permitted_speed_fits_exactly(
            distance in 50.0..3000.0, response in 20.0..300.0, a in 200.0..6000.0, k in 0.0..2000.0, c in 0.0..100.0,
        ) {
            let robot = Robot {
                deceleration_mm_s2: a, approach_mm_s: k, supplement_mm: c,
                ..configuration("").robot
            };
            let speed = permitted_speed(&robot, distance, response);
            let needed = stopping_distance(&robot, speed, response);
            if speed > 0.0 {
                prop_assert!((needed - distance).abs() < 1e-6 * distance, "{speed} {needed} {distance}");
            } else {
                prop_assert!(needed >= distance - 1e-6);
            }
        }
    }
}
