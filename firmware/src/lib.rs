//! The safety microcontroller's decisions.
//!
//! Everything that decides is here, without hardware: time, pins and messages come in as arguments, commands go out
//! as values. The board's and the emulator's binaries move bytes and pins and nothing else; the host links the same
//! code as its in-process controller.
//!
//! | module | what it decides |
//! |---|---|
//! | [`link`] | is this message from the host new, whole, ours and young enough to be believed? |
//! | [`laser_code`], [`secret`] | how bright is the laser now, so that nobody can foresee it? |
//! | [`liveness`] | do the pictures show the laser's own code: are they live? |
//! | [`audit`] | do raw pixels of unforeseeable columns bear the host's report out? |
//! | [`health`] | does the floor lie where it should, are small objects still seen? |
//! | [`evidence`] | what does an accepted line-scan, with all these judges, prove about the stripe? |
//! | [`run_over`] | may small debris pass, where and how long? |
//! | [`arming`] | was the dark seen as dark before the relays close? |
//! | [`interlock`] | was the reset button pressed and released as a person does? |
//! | [`relay`] | do the contacts follow their commands, and is the command itself intact? |
//! | [`output_test`] | do the relay drivers follow their commands and test pulses, each by itself? |
//! | [`selftest`] | are memory, program, processor, stack, clocks, supply and watchdogs sound? |
//! | [`integrity`], [`map_check`] | is the memory that the decision rests on what the program left there? |
//! | [`flow`] | did the safety task run whole, in order and on time? Only then may a watchdog be fed |
//! | [`supervisor`] | may the relays be closed? |
//! | [`safety`] | the controller that ties these together, one tick and one exchange at a time |
//! | [`black_box`], [`fault_log`] | what happened around a stop, for people; no way to the relays |
//! | [`service`], [`store`] | what may a technician change, and when; the stored rig, old or new, never a mixture |
//! | [`lockstep`] | the controller over a byte stream on the host's time, for the emulator |
//!
//! Permission to run needs every one of them; a stop needs one. The safety concept, fault by fault: `SAFETY.md`.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![deny(missing_docs, unused_must_use)]
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::unreachable,
    clippy::todo,
    clippy::unimplemented,
    clippy::indexing_slicing,
    clippy::string_slice,
    clippy::as_conversions,
    clippy::arithmetic_side_effects,
    clippy::float_cmp,
    clippy::wildcard_enum_match_arm,
    clippy::match_wildcard_for_single_variants
)]
// Tests may cast, index and compare; the build without tests keeps the strict set for all other code.
#![cfg_attr(
    test,
    allow(
        clippy::as_conversions,
        clippy::float_cmp,
        clippy::arithmetic_side_effects,
        clippy::indexing_slicing,
        clippy::wildcard_enum_match_arm
    )
)]

pub mod arming;
pub mod audit;
pub mod black_box;
pub mod evidence;
pub mod fault_log;
pub mod flow;
pub mod health;
pub mod integrity;
pub mod interlock;
pub mod laser_code;
pub mod link;
pub mod liveness;
pub mod lockstep;
pub mod map_check;
#[cfg(test)]
mod model_check;
pub mod output_test;
pub mod relay;
pub mod run_over;
pub mod safety;
pub mod secret;
pub mod selftest;
pub mod service;
pub mod store;
pub mod supervisor;
#[cfg(test)]
mod testing;
