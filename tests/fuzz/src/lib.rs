//! The fuzzed functions, the very file that the stable test `fuzz_corpus` uses.

#[path = "../../src/fuzz/mod.rs"]
pub mod fuzz;
