//! The harness of the behaviour tests, which lie in `tests/tests`, one file a subject.
//!
//! | module | what it is |
//! |---|---|
//! | [`stage`] | a safety controller on a virtual clock with a host that speaks to it: what most tests stand on |
//! | [`oracle`] | the geometry once more, in other words and double precision: heights are judged by it |
//! | [`campaign`] | faults one by one and in pairs over many thousand frames, with what must follow from each |
//! | [`fuzz`] | functions that are given arbitrary bytes, and their committed corpus |
//! | [`emulator`], [`pair`] | the Arm firmware in QEMU, alone and frame by frame beside the same code in process |
//!
//! Read `stage` first, then a test that uses it, then `campaign`. The rule that holds: a test states a promise of the product
//! and fails when the promise is broken; how it is shown that tests can fail stands in the README beside this folder.

pub mod campaign;
pub mod emulator;
pub mod fuzz;
pub mod oracle;
pub mod pair;
pub mod stage;
