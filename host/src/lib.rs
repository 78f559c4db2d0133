//! The Pi host of nearfield.
