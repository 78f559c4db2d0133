//! The safety microcontroller.
#![no_std]
