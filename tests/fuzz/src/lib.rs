//! The fuzzed functions, the very file that the stable test `fuzz_corpus` uses: what libFuzzer finds here becomes a file of the
//! corpus, and from then on every test run plays it. The programs beside it hold one call each.

#[path = "../../src/fuzz/mod.rs"]
pub mod fuzz;
