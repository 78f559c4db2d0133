//! The stored rig: old or new, never a mixture.
