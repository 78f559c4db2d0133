//! Ways of running a network, and one of not running any.

pub mod bottleneck;
pub mod depthwise;
#[cfg(feature = "hailo")]
pub mod hailo;
#[cfg(feature = "ort")]
pub mod onnxruntime;
pub mod recorded;
pub mod rten;
