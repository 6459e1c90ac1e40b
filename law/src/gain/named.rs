//! The gains that have a name: the one list that wire, node, scenario, `check`, emergent dynamics and
//! reference share.
//!
//! A new gain is a file beside this one, and a row at the end of this list.

use super::{Algebraic, Linear, LocallyLinear, Logarithmic, Median, Reciprocal};
use super::{GainFunction, Solution};
use crate::math::Real;
use crate::range::Parameter;
use core::fmt;

/// Most parameters of a gain.
pub const MAX_PARAMETERS: usize = 2;

/// A gain that a configuration can name, beside what it computes.
pub trait NamedGain<F: Real>: GainFunction<F> + Copy {
    /// Its kind, as in a scenario.
    const KIND: &'static str;
    /// Its parameters, in the order of its fields.
    const PARAMETERS: &'static [Parameter];
    /// Whether the gain grows without bound at the funnel's edge, as Assumption 3 asks.
    const KEEPS_FUNNELS: bool = true;

    /// The gain with these values of [`Self::PARAMETERS`]; what is missing is zero.
    fn from_values(values: [F; MAX_PARAMETERS]) -> Self;

    /// `mu'(0) = gamma(0)`, state units / s.
    fn slope_at_zero(&self) -> F;

    /// The largest `|u|` up to which it is linear, state units / s; zero where it is so nowhere.
    fn linear_up_to(&self) -> F {
        F::ZERO
    }

    /// The gain of this kind with `mu(1 - gap) = u`; `None` where there is none. `gap` in (0, 1), `u > 0` in
    /// state units / s.
    ///
    /// The default scales the first parameter, in which most gains are linear.
    fn reaching(&self, gap: F, u: F) -> Option<Self>;
}

macro_rules! gains {
    ($($(#[$doc:meta])* $variant:ident { $($field:ident),+ }),+ $(,)?) => {
        /// A gain `mu(s) = gamma(|s|) s`, state units / s, for `s` in (-1, 1). Its parameters are documented
        /// at the structs of the same names.
        ///
        /// Append-only: it travels (funnelnet-protocol), so that nothing is renumbered.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[non_exhaustive]
        pub enum Gain<F> {
            $($(#[$doc])* #[allow(missing_docs)] $variant { $($field: F),+ }),+
        }

        /// Evaluates `$body` with `$gain` bound to the struct of the gain.
        macro_rules! with {
            ($self:expr, $gain:ident => $body:expr) => {
                match *$self { $(Gain::$variant { $($field),+ } => { let $gain = $variant { $($field),+ }; $body })+ }
            };
        }

        impl<F: Real> Gain<F> {
            /// Every kind, in the order of the wire.
            pub const KINDS: &'static [Kind<F>] = &[$(Kind {
                name: <$variant<F> as NamedGain<F>>::KIND,
                parameters: <$variant<F> as NamedGain<F>>::PARAMETERS,
                keeps_funnels: <$variant<F> as NamedGain<F>>::KEEPS_FUNNELS,
                build: |values| <$variant<F> as NamedGain<F>>::from_values(values).into(),
            }),+];

            /// The same gain with numbers of another type, each changed by `convert`.
            #[must_use]
            pub fn map<G>(self, convert: impl Fn(F) -> G) -> Gain<G> {
                match self { $(Self::$variant { $($field),+ } => Gain::$variant { $($field: convert($field)),+ }),+ }
            }

            /// Its parameters with their values, in the order of its kind.
            pub fn parameters(&self) -> impl Iterator<Item = (&'static Parameter, F)> + use<F> {
                let (parameters, values) = match *self { $(Self::$variant { $($field),+ } => {
                    let mut values = [F::ZERO; MAX_PARAMETERS];
                    values.iter_mut().zip([$($field),+]).for_each(|(slot, value)| *slot = value);
                    (<$variant<F> as NamedGain<F>>::PARAMETERS, values)
                }),+ };
                parameters.iter().zip(values)
            }
        }

        $(impl<F> From<$variant<F>> for Gain<F> {
            fn from(gain: $variant<F>) -> Self {
                let $variant { $($field),+ } = gain;
                Self::$variant { $($field),+ }
            }
        })+
    };
}

gains! {
    /// `scale * s / (1 - |s|)`, see [`Reciprocal`].
    Reciprocal { scale },
    /// `-scale * ln(1 - |s|) * sign(s)`, see [`Logarithmic`].
    Logarithmic { scale },
    /// `4 bound s` for `|s| < 1/2`, steeper beyond, see [`LocallyLinear`].
    LocallyLinear { bound },
    /// `mu^-1(s) >= 1 - eps` for `s >= eta`, see [`Median`].
    Median { eta, eps },
    /// `u = slope * nu` whatever the funnel is, see [`Linear`].
    Linear { slope },
    /// `scale * s / sqrt(1 - s^2)`, see [`Algebraic`].
    Algebraic { scale },
}

/// Gives the reciprocal gain of scale 1 (paper, Example 1).
impl<F: Real> Default for Gain<F> {
    fn default() -> Self {
        Self::Reciprocal { scale: F::ONE }
    }
}

/// A kind of gain.
///
/// ```
/// use funnelnet_law::Gain;
/// // What a program that reads gains from a file has to know.
/// let kind = Gain::<f64>::KINDS.iter().find(|kind| kind.name == "median").unwrap();
/// let names: Vec<_> = kind.parameters.iter().map(|parameter| parameter.name).collect();
/// assert_eq!(names, ["eta", "eps"]);
/// assert_eq!((kind.build)([0.1, 0.05]), Gain::Median { eta: 0.1, eps: 0.05 });
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Kind<F> {
    /// Its name in a scenario.
    pub name: &'static str,
    /// Parameters of a gain of this kind.
    pub parameters: &'static [Parameter],
    /// Whether the gain grows without bound at the funnel's edge, as Assumption 3 asks.
    pub keeps_funnels: bool,
    /// Makes a gain of the values of `parameters`, in their order.
    pub build: fn([F; MAX_PARAMETERS]) -> Gain<F>,
}

fn kind<F: Real, G: NamedGain<F>>(_: &G) -> &'static str {
    G::KIND
}

fn keeps_funnels<F: Real, G: NamedGain<F>>(_: &G) -> bool {
    G::KEEPS_FUNNELS
}

impl<F: Real> Gain<F> {
    /// The name of its kind, as in a scenario.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        with!(self, gain => kind(&gain))
    }

    /// Whether the gain grows without bound at the funnel's edge, as Assumption 3 asks.
    #[must_use]
    pub fn keeps_funnels(&self) -> bool {
        with!(self, gain => keeps_funnels(&gain))
    }

    /// `mu'(0) = gamma(0)`, state units / s.
    ///
    /// ```
    /// use funnelnet_law::Gain;
    /// assert_eq!(Gain::LocallyLinear { bound: 2.0 }.slope_at_zero(), 8.0);
    /// ```
    #[must_use]
    pub fn slope_at_zero(&self) -> F {
        with!(self, gain => gain.slope_at_zero())
    }

    /// The largest `|u|` up to which it is linear, state units / s; zero where it is so nowhere.
    #[must_use]
    pub fn linear_up_to(&self) -> F {
        with!(self, gain => gain.linear_up_to())
    }

    /// The gain of this kind with `mu(1 - gap) = u`; `None` where there is none. `gap` in (0, 1), `u > 0` in
    /// state units / s.
    ///
    /// ```
    /// use funnelnet_law::Gain;
    /// // Which scale leaves a tenth of the funnel at an input of 18 units/s?
    /// let wider = Gain::Reciprocal { scale: 1.0 }.reaching(0.1_f64, 18.0).unwrap();
    /// assert_eq!(wider.to_string(), "{ kind = \"reciprocal\", scale = 2 }");
    /// ```
    #[must_use]
    pub fn reaching(&self, gap: F, u: F) -> Option<Self> {
        with!(self, gain => gain.reaching(gap, u).map(Self::from))
    }

    /// Form of the same gain that costs least at every tick: the median gain becomes a reciprocal one.
    ///
    /// ```
    /// use funnelnet_law::Gain;
    /// let median = Gain::Median { eta: 0.25, eps: 0.5 };
    /// assert_eq!(median.prepared(), Gain::Reciprocal { scale: 0.25 });
    /// ```
    #[must_use]
    pub fn prepared(self) -> Self {
        match self {
            Self::Median { eta, eps } => Median { eta, eps }.reciprocal().into(),
            other => other,
        }
    }
}

impl<F: Real> GainFunction<F> for Gain<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        with!(self, gain => gain.inverse(u))
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        with!(self, gain => gain.inverse_slope(u))
    }

    #[inline]
    fn inverse_with_slope(&self, u: F) -> (F, F) {
        with!(self, gain => gain.inverse_with_slope(u))
    }

    fn inverse_curvature(&self, u: F) -> F {
        with!(self, gain => gain.inverse_curvature(u))
    }

    #[inline]
    fn gap_with_slope(&self, u: F, lift: F) -> (F, F) {
        with!(self, gain => gain.gap_with_slope(u, lift))
    }

    #[inline]
    fn decay(&self, u: F) -> F {
        with!(self, gain => gain.decay(u))
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        with!(self, gain => gain.apply(s))
    }

    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        with!(self, gain => gain.solve(psi, b, r))
    }
}

/// Writes it as in a scenario: `{ kind = "reciprocal", scale = 1 }`.
impl<F: Real + fmt::Display> fmt::Display for Gain<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{{ kind = \"{}\"", self.kind())?;
        for (parameter, value) in self.parameters() {
            write!(f, ", {} = {value}", parameter.name)?;
        }
        f.write_str(" }")
    }
}
