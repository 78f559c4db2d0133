//! The subcommands of `nearfield`, one file each: arguments in, exit code out.

pub mod evaluate_scenes;
pub mod twin;
