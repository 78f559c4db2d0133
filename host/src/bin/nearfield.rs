//! The command `nearfield`.
fn main() {}
