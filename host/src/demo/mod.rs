//! A minute at the robot's edge, played through the whole safety path and checked: [`script`] says what happens and
//! what must follow, [`engine`] plays it, [`check`] judges, [`report`] and [`view`] show it.

pub mod check;
pub mod engine;
mod health;
pub mod overlay;
pub mod record;
pub mod report;
pub mod script;
pub mod timeline;
pub mod view;
pub mod watch;

pub use engine::{Audience, DemoError, Engine, Moment, Outcome, Snapshot};
