//! The sampled funnel coupling law.
#![no_std]
