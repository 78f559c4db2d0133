//! For this crate's unit tests.
