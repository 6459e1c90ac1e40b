#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

pub mod model;
pub mod neighbour;
pub mod node;
pub mod observe;
pub mod params;
pub mod plant;
pub mod session;
pub mod time;
pub mod watchdog;

pub use funnelnet_law as law;
pub use funnelnet_protocol as protocol;

pub use model::{Configured, Fixed, Model};
pub use node::{Action, Node};
pub use observe::{Event, Observation, Phase};
pub use params::Params;
pub use plant::{InputRange, PlantSetup};
pub use session::{Output, Session, Task};
