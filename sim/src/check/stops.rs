//! How likely it is that a healthy node stops in a run.

use super::silence::Hazard;
use super::{Status, share};
use funnelnet_law::math;

/// Share of the runs below which it is not waited for.
const SELDOM: f64 = 1e-3;
/// Share of the runs from which on a scenario cannot do what it is meant to.
const MOSTLY: f64 = 0.5;

/// A share of the runs, at least and at most.
#[derive(Clone, Copy)]
pub(super) struct Share {
    pub low: f64,
    pub high: f64,
}

impl Share {
    /// Of those in which something happens.
    pub fn of(hazard: Hazard) -> Self {
        let share = |hazard: f64| -math::exp_m1(-hazard);
        Self { low: share(hazard.low), high: share(hazard.high) }
    }

    pub fn status(self) -> Status {
        match self {
            Self { low, .. } if low >= MOSTLY => Status::Fail,
            Self { high, .. } if high >= SELDOM => Status::Warn,
            _ => Status::Ok,
        }
    }
}

impl std::fmt::Display for Share {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (low, high) = (share(self.low), share(self.high));
        match *self {
            Self { high, .. } if high < 1e-6 => f.write_str("fewer than one of a million runs"),
            Self { low: seldom, .. } if seldom < SELDOM && low != high => {
                write!(f, "up to {high} of the runs")
            }
            _ if low == high => write!(f, "about {low} of the runs"),
            _ => write!(f, "{low} to {high} of the runs"),
        }
    }
}
