//! The computer under the sensor.
//!
//! * [`real_time`]: what the stripe's path asks of the operating system: SCHED_FIFO, cores of its own, locked memory. What is
//!   refused is said, with what to do; nothing depends on it.
//! * [`service`]: readiness, state and watchdog for systemd.
//! * [`doctor`]: looks at camera, SPI, GPIO, rights, clock, temperature, power and disk, and says what to do.
//!
//! **Built, not run on hardware:** what it finds on a Raspberry Pi is tested against made-up file trees only.

pub mod doctor;
pub mod real_time;
pub mod service;
