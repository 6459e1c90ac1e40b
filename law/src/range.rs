//! Ranges of the numbers that a law is made of: the one place for node, scenario and `check`.
//!
//! They are wide enough for any bench and narrow enough that no product in the law can overflow an f32
//! (law/tests/law.rs sweeps their corners).

/// Largest state, input and funnel scale, state units.
pub const LARGEST: f64 = 1e9;
/// Smallest positive scale.
pub const SMALLEST: f64 = 1e-9;
/// Largest edge weight and weighted degree.
pub const LARGEST_WEIGHT: f64 = 1e6;
/// Largest slope of a field (1/s), frequency (rad/s) and rate of a funnel (1/s).
pub const LARGEST_RATE: f64 = 1e6;
/// Largest phase of a sinusoid, rad.
pub const LARGEST_PHASE: f64 = 1e6;
/// Shortest tick period, ns.
pub const SHORTEST_TICK_NS: u32 = 10_000;
/// Range of the damping `c` of (**): below 1 not even two nodes agree.
pub const DAMPING: (f64, f64) = (1.0, 8.0);
/// Widest guard.
pub const WIDEST_GUARD: f64 = 0.9;
/// Most ticks in a round.
pub const LONGEST_ROUND: u8 = 100;
/// Longest slow start, ticks of the network.
pub const LONGEST_SLOW_START: u16 = 1_000;
/// Exponents of a funnel that closes in finite time.
pub const POWERS: (f64, f64) = (0.1, 10.0);
/// The `eps` of a schedule of funnels.
pub const SCHEDULE_EPS: (f64, f64) = (SMALLEST, 1.0);

/// The unit of an input.
pub const INPUT: &str = "state units per second";
/// The unit of a state.
pub const STATE: &str = "state units";

/// Parameter of a gain, funnel or coupling that has a name.
///
/// ```
/// use funnelnet_law::Gain;
/// let (parameter, value) = Gain::Linear { slope: 3.0_f64 }.parameters().next().unwrap();
/// assert_eq!((parameter.name, parameter.unit, value), ("slope", "1/s", 3.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Key in a scenario.
    pub name: &'static str,
    /// Unit, in words.
    pub unit: &'static str,
    /// Allowed range.
    pub allowed: Allowed,
    /// Default value; without one a scenario has to say it.
    pub default: Option<f64>,
}

/// Range of a number.
///
/// ```
/// use funnelnet_law::range::Allowed;
/// // What a node takes, and no product in the law overflows an f32.
/// assert_eq!(Allowed::Positive.on_node(), (1e-9, 1e9));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Allowed {
    /// More than zero; on a node from [`SMALLEST`] to [`LARGEST`].
    Positive,
    /// From the first to the second.
    Between(f64, f64),
}

impl Allowed {
    /// Smallest and largest value on a node.
    #[must_use]
    pub const fn on_node(self) -> (f64, f64) {
        match self {
            Self::Positive => (SMALLEST, LARGEST),
            Self::Between(low, high) => (low, high),
        }
    }
}

impl Parameter {
    /// One above zero.
    pub(crate) const fn positive(name: &'static str, unit: &'static str, default: Option<f64>) -> Self {
        Self { name, unit, allowed: Allowed::Positive, default }
    }
}
