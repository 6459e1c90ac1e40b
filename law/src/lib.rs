#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

#[cfg(feature = "std")]
extern crate std;

pub mod breach;
#[doc(hidden)]
pub mod collect;
pub mod coupling;
pub mod emergent;
pub mod field;
pub mod floor;
pub mod funnel;
pub mod gain;
pub mod law;
pub mod math;
pub mod program;
pub mod range;
pub mod root;
pub mod start;

pub use breach::Breach;
pub use coupling::Coupling;
pub use field::{AffineSines, Field, PreparedField, VectorField};
pub use funnel::Funnel;
pub use gain::{Gain, GainFunction};
pub use math::Real;
pub use program::Program;
