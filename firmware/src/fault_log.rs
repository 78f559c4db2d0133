//! Faults and stops that are remembered across resets.
