//! The computer under the sensor.
//!
//! * [`real_time`]: what the stripe's path asks of the operating system: SCHED_FIFO, cores of its own, locked memory. What is
//!   refused is said, with what to do; nothing depends on it.
//! * [`service`]: readiness, state and watchdog for systemd.
//! * [`doctor`]: looks at camera, SPI, GPIO, rights, clock, temperature, power and disk, and says what to do.
//!
//! Read `real_time` first: it is what the stripe's path calls; then `service`, which the run loop calls once a second; `doctor`
//! stands by itself. The rule that holds everywhere here: the computer may refuse anything, the sensor runs on and says so; what
//! must be safe is safe without it, in the controller.
//!
//! **Built, not run on hardware:** what it finds on a Raspberry Pi is tested against made-up file trees only.

pub mod doctor;
pub mod real_time;
pub mod service;
