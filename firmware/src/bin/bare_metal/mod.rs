//! What both boards' self-tests need of a Cortex-M4F: memory as [`Cells`](nearfield_firmware::selftest::memory::Cells),
//! the march before start-up, patterns in all registers, the program's bytes. What it means is judged in
//! `nearfield_firmware::selftest`.

pub(crate) mod memory;
pub(crate) mod program;
pub(crate) mod registers;
pub(crate) mod start_up;
