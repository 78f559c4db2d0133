//! Says whether a mutant is on: the one whose number is in the environment, for the life of the process.
//!
//! What the compiler evaluates is never mutated: such mutants survive here, and are judged one by one.
#![feature(const_eval_select, core_intrinsics)]
#![allow(internal_features)]

use core::sync::atomic::{AtomicU32, Ordering};

/// Not asked yet.
const UNKNOWN: u32 = u32::MAX;
/// The number that is on; 0 = none.
static ACTIVE: AtomicU32 = AtomicU32::new(UNKNOWN);

/// Whether the mutant of this number is on.
#[inline]
#[must_use]
pub const fn on(number: u32) -> bool {
    core::intrinsics::const_eval_select((number,), never, asked)
}

const fn never(_number: u32) -> bool {
    false
}

#[inline]
fn asked(number: u32) -> bool {
    match ACTIVE.load(Ordering::Relaxed) {
        UNKNOWN => ask() == number,
        active => active == number,
    }
}

#[cold]
fn ask() -> u32 {
    let text = std::env::var("NEARFIELD_MUTANT").unwrap_or_default();
    let active = text.parse().unwrap_or(0);
    ACTIVE.store(active, Ordering::Relaxed);
    active
}
