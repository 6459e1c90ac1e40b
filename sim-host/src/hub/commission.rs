//! Commissioning on real lines: until when the user's wish to stop is heard, and what devices have to say
//! about an error.

use super::outlets::Outlets;
use super::{Attached, Commissioned, Failed, HubError, Patience};
use crate::conductor::Commission;
use funnelnet_protocol::NodeConfig;

/// Nodes that are being commissioned.
pub struct Commissioning {
    commission: Commission,
    outlets: Outlets,
    patience: Patience,
}

impl Commissioning {
    /// Asks each node who it is, and stops it if it runs.
    ///
    /// # Errors
    /// A node that does not answer in time, another wire version, another chip, an interrupt. Nothing has
    /// changed then.
    pub fn new(attached: Vec<Attached>, patience: Patience) -> Result<Self, HubError> {
        let (seats, outlets) = Outlets::of(attached);
        let mut this = Self { commission: Commission::new(seats, patience), outlets, patience };
        let met = this.outlets.run(this.commission.meet());
        met.map_err(|error| this.explain(error))?;
        Ok(this)
    }

    /// Stages one configuration per node, compares all checksums, and commits.
    ///
    /// # Errors
    /// [`Failed::Before`] the first commit: every node has what it had. [`Failed::After`] it: some may have
    /// the new one.
    pub fn commission(mut self, configs: &[NodeConfig]) -> Result<Vec<Commissioned>, Failed> {
        let staged = self.outlets.run(self.commission.stage(configs));
        staged.map_err(|error| Failed::Before(self.explain(error)))?;
        self.go_through_with_it()?;
        let done = self.outlets.run(self.commission.commit(configs));
        done.map_err(|failed| failed.map(|error| self.explain(error)))
    }

    /// Makes all nodes blank at their next start, one after the other.
    ///
    /// # Errors
    /// [`Failed::Before`] where the first one refuses; [`Failed::After`] where a later one does, or where one
    /// does not answer.
    pub fn erase(mut self) -> Result<Vec<Commissioned>, Failed> {
        self.go_through_with_it()?;
        let done = self.outlets.run(self.commission.erase());
        done.map_err(|failed| failed.map(|error| self.explain(error)))
    }

    /// The last moment at which the user's wish to stop is heard: nodes of which some have changed are worse
    /// than either.
    fn go_through_with_it(&mut self) -> Result<(), Failed> {
        self.outlets.check_interrupt().map_err(Failed::Before)?;
        self.outlets.hurry(self.patience.answer);
        Ok(())
    }

    /// Adds to an error what the device of the node has to say.
    fn explain(&mut self, error: HubError) -> HubError {
        let words = self.outlets.last_words_of(self.commission.at(), &error).unwrap_or_default();
        error.with_words(words.join("\n"))
    }
}
