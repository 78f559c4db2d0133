//! The harness of the behaviour tests.

pub mod campaign;
pub mod emulator;
pub mod fuzz;
pub mod oracle;
pub mod pair;
pub mod stage;
