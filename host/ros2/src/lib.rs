//! A running sensor as ROS 2 sees it, in pure Rust: no ROS installation, no system library.
//!
//! ```text
//! stripe path --Tap (never waits)--> queue --> thread "ros2": Reporter --> DDS
//! ```
//!
//! | topic | type | quality of service |
//! |---|---|---|
//! | `NAMESPACE/scan` | `sensor_msgs/LaserScan` | sensor data: best effort, volatile, the last 5 |
//! | `NAMESPACE/heights` | `sensor_msgs/PointCloud2` | the same |
//! | `NAMESPACE/status` | `nearfield_msgs/ModuleStatus` | reliable, transient local, the last 10 |
//! | `/diagnostics` | `diagnostic_msgs/DiagnosticArray` | reliable, volatile, the last 10 |
//!
//! * [`floor`]: the frame of reference, and which beam of the scan each column of the line-scan speaks for.
//! * [`observer`]: scan and cloud. **Unknown is never free:** where the stripe is not seen an obstacle stands at the stripe.
//! * [`reporter`]: status and diagnostics; also what is told when nothing is heard.
//! * `outlet` (feature `dds`): publishes.
//!
//! None of this is a safety function: the relays stop the robot, whether somebody listens here or not.

pub mod floor;
pub mod messages;
pub mod observer;
#[cfg(feature = "dds")]
pub mod outlet;
pub mod reporter;

pub use floor::FloorError;
#[cfg(feature = "dds")]
pub use outlet::{Outlet, OutletError, Settings, Stamp};
pub use reporter::{About, Reporter};
