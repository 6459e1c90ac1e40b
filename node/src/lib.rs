//! The sampled funnel coupling law and the sans-IO node that runs it.
//!
//! Each node adds `u_i = mu_i(nu_i / psi_i(t))` to its own dynamics, with the diffusive term
//! `nu_i = sum_j alpha_ij (x_j - x_i)` (Lee, Trenn, Shim: "Synchronization with prescribed transient behavior"). A node
//! samples; the implicit form in [`funnelnet_law::law::node_wise`] keeps the sampled law stable for every funnel width and gain.
//!
//! `Node` takes events and time, and gives actions: it never reads a clock, allocates or panics.
#![no_std]
#![forbid(unsafe_code)]

pub mod model;
pub mod neighbour;
pub mod node;
pub mod observe;
pub mod params;
pub mod plant;
pub mod session;
pub mod watchdog;

pub use model::{Configured, Fixed, Model};
pub use node::{Action, Node};
pub use observe::{Event, Observation, Phase};
pub use params::Params;
pub use plant::{InputRange, PlantSetup};
pub use session::{Output, Session, Task};
