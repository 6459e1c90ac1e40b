//! A map from the time of the own clock to that of the network: straight, and for a while steeper or flatter.

/// A rate of one, as fixed point: rates are parts of 2^32.
pub const ONE: i64 = 1 << FRACTION;
/// Bits of it.
const FRACTION: u32 = 32;
/// The largest rate, and the steepest slew, that a map has: 200 ppm.
pub const LARGEST_RATE: i64 = ONE / 5000;
/// Steps that find a time of the own clock: each leaves 1/2500 of the error of the one before.
const STEPS: usize = 8;

/// Map from the own clock to that of the network. `network` runs by `1 + rate` while the own clock runs by
/// one, and by `slew` more for the first `slew_for` ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Map {
    own: u64,
    network: u64,
    rate: i64,
    slew: i64,
    slew_for: u64,
}

impl Map {
    /// Both clocks run alike from now on, where the own one shows `own` and that of the network `network`
    /// (ns).
    #[must_use]
    pub const fn new(own: u64, network: u64) -> Self {
        Self { own, network, rate: 0, slew: 0, slew_for: 0 }
    }

    /// Rate by which the network's clock is taken to run faster, in parts of 2^32.
    #[must_use]
    pub const fn rate(&self) -> i64 {
        self.rate
    }

    /// Time of the network when the own clock shows `own`, ns. Never goes back while the map stays; a time
    /// before its begin is taken for that.
    #[must_use]
    // Once in an image: it is asked for at many places, and 128 bits are long on 32.
    #[inline(never)]
    pub fn network(&self, own: u64) -> u64 {
        let passed = own.saturating_sub(self.own);
        let network = i128::from(self.network) + i128::from(passed) + self.gained(passed);
        u64::try_from(network.max(0)).unwrap_or(u64::MAX)
    }

    /// What the network's clock gains in `passed` ns of the own one, ns.
    fn gained(&self, passed: u64) -> i128 {
        let slewed = i128::from(passed.min(self.slew_for));
        (i128::from(passed) * i128::from(self.rate) + slewed * i128::from(self.slew)) >> FRACTION
    }

    /// The time of the own clock from which on that of the network is `network` or more, ns: at most a few ns
    /// after the first such one.
    #[must_use]
    #[inline(never)]
    pub fn own(&self, network: u64) -> u64 {
        let wanted = network.saturating_sub(self.network);
        let mut passed = wanted;
        for _ in 0..STEPS {
            let next = (i128::from(wanted) - self.gained(passed)).max(0);
            passed = u64::try_from(next).unwrap_or(u64::MAX);
        }
        let mut own = self.own.saturating_add(passed);
        // Rounding: the nearest one may be too early.
        for _ in 0..STEPS {
            if self.network(own) >= network {
                break;
            }
            own = own.saturating_add(1);
        }
        own
    }

    /// Goes on from `own` (ns) with another rate, both bounded by 200 ppm, and with `slew` more for the next
    /// `slew_for` ns. No jump.
    pub fn bend(&mut self, own: u64, rate: i64, slew: i64, slew_for: u64) {
        let network = self.network(own);
        let (rate, slew) = (bounded(rate), bounded(slew));
        *self = Self { own, network, rate, slew, slew_for };
    }

    /// Moves the network's clock by `by` ns at `own` (ns), forwards or backwards.
    pub fn step(&mut self, own: u64, by: i64) {
        let network = self.network(own).saturating_add_signed(by);
        *self = Self { own, network, rate: self.rate, slew: 0, slew_for: 0 };
    }
}

/// A rate, clipped to 200 ppm.
#[must_use]
pub fn bounded(rate: i64) -> i64 {
    rate.clamp(-LARGEST_RATE, LARGEST_RATE)
}
