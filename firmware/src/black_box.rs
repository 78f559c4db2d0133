//! What happened around a stop, for people who ask afterwards.
