//! Random streams: one per node and purpose, all from the scenario's seed.
//!
//! The generator is named (PCG-XSH-RR 64/32), since `rand`'s default ones change between versions.

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// What a stream is for. Numbers are part of what a recorded seed means: append only.
#[derive(Clone, Copy, Debug)]
pub enum Purpose {
    /// Loss of frames at a receiver.
    Loss = 1,
    /// Extra delay of a sender's frames.
    Jitter = 2,
    /// Edges of a random graph.
    Graph = 3,
}

/// One random stream.
#[derive(Clone, Debug)]
pub struct Stream(Pcg32);

impl Stream {
    /// The stream of `node` (its index) for `purpose`.
    pub fn new(seed: u64, purpose: Purpose, node: usize) -> Self {
        Self(Pcg32::new(seed, (purpose as u64) << 32 | node as u64))
    }

    /// True with probability `probability`, to 2^-32; no draw where it is zero.
    #[inline]
    pub fn happens(&mut self, probability: f64) -> bool {
        probability > 0.0 && f64::from(self.0.next_u32()) < probability * 4_294_967_296.0
    }

    /// A whole number below `bound`, nearly uniform (to 2^-32); 0 where `bound` is 0, without a draw.
    #[inline]
    pub fn below(&mut self, bound: u64) -> u64 {
        if bound == 0 { 0 } else { ((u128::from(self.0.next_u32()) * u128::from(bound)) >> 32) as u64 }
    }
}
