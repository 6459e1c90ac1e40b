//! Funnel coupling as mathematics: gains, performance funnels, vector fields, the implicit sampled law, emergent dynamics.
//!
//! Each node adds `u_i = mu_i(nu_i / psi_i(t))` to its own dynamics, with the diffusive term
//! `nu_i = sum_j alpha_ij (x_j - x_i)` (Lee, Trenn, Shim: "Synchronization with prescribed transient behavior"). A node
//! samples; the implicit form in [`law::node_wise`] keeps the sampled law stable for every funnel width and gain.
#![no_std]
#![forbid(unsafe_code)]

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
pub mod range;
pub mod root;

pub use breach::Breach;
pub use coupling::Coupling;
pub use field::{AffineSines, Field, VectorField};
pub use funnel::Funnel;
pub use gain::{Gain, GainFunction};
pub use math::Real;
