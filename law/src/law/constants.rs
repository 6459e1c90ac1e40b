//! Constants that all sampled laws share.

/// `theta` = 1/2: second order in `T`.
pub const THETA: f64 = 0.5;
/// `c` = 2.2: above 2, which covers every weighted undirected graph (law.md 3), and 13 % more exact than 2.5
/// at the same robustness to loss (docs/notes/2026-11-23-first-light.md).
pub const C: f64 = 2.2;
/// `g` = 0.1: positive real on every graph up to 1/6, where the slow modes of large graphs are hardly damped
/// (law.md 3).
pub const G: f64 = 0.1;

/// Constants of a law, for callers who know more of the network than a node does.
///
/// ```
/// use funnelnet_law::law::node_wise::Constants;
/// // Whoever knows the graph can do with less damping (law.md 4): 1.1 lambda_max(D^-1 L), here of the complete graph of five.
/// let exact = Constants { damping: 1.1 * 1.25, ..Constants::default() };
/// assert_eq!(exact.g, 0.1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constants {
    /// `theta` in [1/2, 1]; (**) is for 1/2.
    pub theta: f64,
    /// `c`, at least the largest eigenvalue of `D^-1 L`, which is at most 2.
    pub damping: f64,
    /// `g` in [0, 1/6].
    pub g: f64,
}

impl Constants {
    /// Constants of law (*), which has no look back.
    pub const WITHOUT_LOOK_BACK: Self = Self { theta: THETA, damping: C, g: 0.0 };

    /// Default constants with another `c`.
    #[must_use]
    pub fn damped_by(damping: f64) -> Self {
        Self { damping, ..Self::default() }
    }
}

impl Default for Constants {
    fn default() -> Self {
        Self { theta: THETA, damping: C, g: G }
    }
}
