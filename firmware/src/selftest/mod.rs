//! Self-tests of the controller's own hardware.
