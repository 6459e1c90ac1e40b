//! Plots of a run as SVG text.
//!
//! [`states_svg`] shows the states, the emergent trajectory and the blended dynamics, [`funnels_svg`] each
//! node inside its funnel, [`inputs_svg`] their inputs, [`agreement_svg`] how far apart the nodes are beside
//! their bound. They show what is true: true terms in the scenario's funnels, nothing where nothing is known,
//! and words where something is cut.

mod agreement;
mod axis;
mod clip;
mod curve;
mod envelope;
mod funnels;
mod legend;
mod lines;
mod losses;
mod marks;
mod notes;
mod overlay;
mod panel;
mod quantiles;
mod states;
mod style;
mod text;
mod thin;
mod trace;

pub use agreement::agreement_svg;
pub use funnels::funnels_svg;
pub use lines::{Lines, Spot};
pub use marks::Kind as MarkKind;
pub use overlay::Overlay;
pub use quantiles::quantiles_svg;
pub use states::{inputs_svg, states_svg};
pub use trace::Trace;

/// A plot could not be drawn: there is nothing to show, or the plotting library refused.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw the plot: {0}")]
pub struct PlotError(String);

impl PlotError {
    fn new(reason: impl std::fmt::Display) -> Self {
        Self(reason.to_string())
    }
}

#[cfg(test)]
mod tests;
