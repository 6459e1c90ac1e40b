//! How diffusive terms become inputs, by name.

use core::fmt;

/// Kind of coupling: the rule by which diffusive terms become inputs.
///
/// Append-only: what a node can run travels (funnelnet-protocol), so that nothing is renumbered.
/// Exhaustive on purpose: node and scenario match it, and a new variant shall not compile until both know it.
///
/// ```
/// use funnelnet_law::Coupling;
/// assert_eq!(Coupling::<f64>::EdgeWise.to_string(), "edge-wise");
/// // No node can know the gains of all others.
/// assert!(Coupling::<f64>::WeaklyCentralised.on_node(|x| x as f32).is_none());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Coupling<F> {
    /// The paper's law `u_i = mu_i(nu_i / psi_i)`, component by component.
    NodeWise,
    /// The paper's maximum gain, for vector states: the largest gain of all components.
    MaxGain,
    /// One funnel per edge.
    EdgeWise,
    /// `u = k nu` with a `k` that grows while `|nu| > eta`, from the slope of the (linear) gain on.
    LambdaTracker {
        /// State units, zero or more.
        eta: F,
    },
    /// No input at all.
    None,
    /// The same as [`Self::NodeWise`], said of vector states.
    #[cfg_attr(feature = "serde", serde(skip))]
    ElementWise,
    /// The same as [`Self::NodeWise`] with a linear gain: `u_i = k nu_i`.
    #[cfg_attr(feature = "serde", serde(skip))]
    Linear,
    /// The largest gain of all nodes (paper, Section 1.3, "Related approaches"). No node can run it: each
    /// would have to know the gains of all.
    #[cfg_attr(feature = "serde", serde(skip))]
    WeaklyCentralised,
}

impl<F> Coupling<F> {
    /// Name of the coupling, as in a scenario.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::NodeWise => "node-wise",
            Self::EdgeWise => "edge-wise",
            Self::ElementWise => "element-wise",
            Self::MaxGain => "max-gain",
            Self::WeaklyCentralised => "weakly-centralised",
            Self::Linear => "linear",
            Self::LambdaTracker { .. } => "lambda-tracker",
            Self::None => "none",
        }
    }

    /// Whether the coupling keeps diffusive terms inside funnels; baselines to compare with do not.
    #[must_use]
    pub fn keeps_funnels(&self) -> bool {
        !matches!(self, Self::Linear | Self::LambdaTracker { .. } | Self::None)
    }

    /// Coupling that a node is told to run, with numbers changed by `convert`; `None` for the one that no
    /// node can run.
    #[must_use]
    pub fn on_node<G>(self, convert: impl Fn(F) -> G) -> Option<Coupling<G>> {
        match self {
            Self::NodeWise | Self::ElementWise | Self::Linear => Some(Coupling::NodeWise),
            Self::MaxGain => Some(Coupling::MaxGain),
            Self::EdgeWise => Some(Coupling::EdgeWise),
            Self::LambdaTracker { eta } => Some(Coupling::LambdaTracker { eta: convert(eta) }),
            Self::None => Some(Coupling::None),
            Self::WeaklyCentralised => None,
        }
    }
}

/// Writes the name of its kind.
impl<F> fmt::Display for Coupling<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.kind())
    }
}
