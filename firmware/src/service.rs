//! What a service technician may change, and when.
