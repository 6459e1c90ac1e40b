//! Random streams: one root seed, one independent stream per purpose and index.
//!
//! The generator is named (PCG XSL RR 128/64), since `rand`'s default ones change between versions.

use funnelnet_law::math;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng;

/// What a stream is for. The numbers are part of the meaning of a seed: never reuse or change one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// Random graphs.
    Graph = 1,
    /// Lost frames.
    Loss = 2,
    /// Delays of frames.
    Jitter = 3,
    /// Measurement noise.
    Noise = 4,
    /// Disturbed bits of a bus.
    BitErrors = 5,
    /// Frames that a link loses; from here on a link is `sender * 128 + receiver`, by index.
    LinkLoss = 16,
    /// Their delays.
    LinkJitter = 17,
    /// Which of them come after the next one.
    LinkOrder = 18,
    /// Which of them come twice.
    LinkCopies = 19,
    /// Which of them are read wrong, and where.
    LinkBits = 20,
    /// Disturbed bits of a serial line; lines are counted by the bus.
    LineBits = 21,
    /// How far the clock of a node is off.
    Clock = 22,
    /// How its rate changes.
    ClockWander = 23,
    /// Frames that an event loses on a link; from here on a link is its number and 2^14 times that of the event.
    EventLoss = 24,
    /// Frames that an event has read wrong.
    EventBits = 25,
    /// Which of the bits that may be disturbed are, where an event makes a bus noisy.
    EventNoise = 26,
    /// Events by chance.
    Faults = 27,
    /// Noise of a sensor at an event; an index is that of a node and 2^14 times that of the event.
    SensorNoise = 28,
    /// Samples that a sensor does not give.
    SensorLoss = 29,
    /// Initial states that are drawn; from here on an index is that of a node.
    AgentState = 32,
    /// Slopes of fields.
    AgentSlope = 33,
    /// Their offsets.
    AgentOffset = 34,
    /// Amplitudes of their sines.
    AgentAmplitude = 35,
    /// Phases of them.
    AgentPhase = 36,
    /// Points of a sweep.
    Design = 64,
}

/// The generator (PCG XSL RR 128/64) for one purpose and index, such as a node or a link.
#[must_use]
pub fn stream(seed: u64, purpose: Purpose, index: u64) -> Pcg64 {
    let low = mix(seed ^ mix(purpose as u64));
    let high = mix(low ^ mix(index));
    let selector = (u128::from(purpose as u64) << 64) | u128::from(index);
    Pcg64::new((u128::from(high) << 64) | u128::from(low), selector)
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, 2014): neighbouring seeds give unrelated states.
#[must_use]
pub const fn mix(value: u64) -> u64 {
    let z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Uniform in [0, 1) with 53 bits.
pub fn uniform(generator: &mut impl Rng) -> f64 {
    (generator.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Uniform in 0..n (n > 0); the bias of the multiplication is below n / 2^64.
pub fn below(generator: &mut impl Rng, n: usize) -> usize {
    ((u128::from(generator.next_u64()) * n as u128) >> 64) as usize
}

/// True with probability `probability` (0 to 1); no draw where it is zero.
pub fn happens(generator: &mut impl Rng, probability: f64) -> bool {
    probability > 0.0 && uniform(generator) < probability
}

/// Gaussian with mean 0 and standard deviation 1 (Box and Muller, 1958); two draws each.
pub fn gaussian(generator: &mut impl Rng) -> f64 {
    // In (0, 1], so that the logarithm is finite.
    let length = (-2.0 * math::ln(1.0 - uniform(generator))).sqrt();
    length * math::cos(std::f64::consts::TAU * uniform(generator))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_fixed_and_apart() {
        let first = |seed, purpose, index| stream(seed, purpose, index).next_u64();
        assert_eq!(first(1, Purpose::Graph, 0), first(1, Purpose::Graph, 0));
        assert_ne!(first(1, Purpose::Graph, 0), first(2, Purpose::Graph, 0));
        assert_ne!(first(1, Purpose::Graph, 0), first(1, Purpose::Loss, 0));
        assert_ne!(first(1, Purpose::Loss, 0), first(1, Purpose::Loss, 1));
    }

    #[test]
    fn gaussians_have_the_moments_that_they_should() {
        let mut generator = stream(3, Purpose::Noise, 0);
        let draws: Vec<f64> = (0..100_000).map(|_| gaussian(&mut generator)).collect();
        let mean = |of: fn(f64) -> f64| draws.iter().map(|&x| of(x)).sum::<f64>() / draws.len() as f64;
        let found = [mean(|x| x), mean(|x| x * x), mean(|x| x * x * x), mean(|x| x * x * x * x)];
        let near =
            found.iter().zip([0.0, 1.0, 0.0, 3.0]).all(|(found, moment)| (found - moment).abs() < 0.06);
        assert!(near, "{found:?}");
    }

    #[test]
    fn uniform_and_below_stay_inside() {
        let mut generator = stream(7, Purpose::Graph, 0);
        let mean = (0..10_000).map(|_| uniform(&mut generator)).sum::<f64>() / 10_000.0;
        assert!((mean - 0.5).abs() < 0.02, "{mean}");
        assert!((0..1_000).all(|_| below(&mut generator, 7) < 7));
    }
}
