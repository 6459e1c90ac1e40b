//! An update on real lines: until when the user's wish to stop is heard, and the trial, which is a run.

use super::outlets::Outlets;
use super::{Attached, Failed, HubError, Patience, Relayed};
use crate::bus::ideal::IdealBus;
use crate::conductor::{Conductor, Seat, Update, Updated};
use crate::presence::Presence;
use crate::program::Program;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::update::MAX_BLOCK;
use std::time::Duration;

/// Ticks of a trial that come after all nodes were asked once more: the answer may be one tick old.
const LAST_TICKS: u32 = 2;
/// Ticks that those may take more, where a flash has not taken its confirmation at once.
const MORE_TICKS: u32 = 10;

/// How far an update has come.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UpdateStage {
    /// These were on trial, from another update, and went back.
    WentBack(Vec<u8>),
    /// So many bytes of so many were sent to these.
    Sent {
        /// Their ids.
        nodes: Vec<u8>,
        /// To each.
        done: u32,
        /// Of the program.
        all: u32,
    },
    /// Each has read back what it has written.
    Checked,
    /// All are told to swap.
    Swapping,
    /// These are on trial.
    OnTrial(Vec<u8>),
    /// The trial has so many ticks left of so many.
    Trial {
        /// Still to come.
        left: u32,
        /// At its beginning.
        all: u32,
    },
    /// All stay; they are restarted.
    Confirmed,
    /// Something has failed: those on trial are restarted.
    GoingBack,
}

/// What the nodes run while they are on trial.
pub struct Trial {
    /// One per node.
    pub configs: Vec<NodeConfig>,
    /// Between them.
    pub bus: IdealBus<Relayed>,
}

/// Nodes that are being updated.
pub struct Updating<'a> {
    update: Update,
    seats: Vec<Seat>,
    outlets: Outlets,
    patience: Patience,
    tell: &'a mut dyn FnMut(&UpdateStage),
    /// Nodes may have the configuration of the trial.
    configured: bool,
}

impl<'a> Updating<'a> {
    /// Asks each node who it is and which program it has, and stops it if it runs. `swap` is how long a node may
    /// take to swap and start.
    ///
    /// # Errors
    /// A node that does not answer in time, another wire version, another chip, an interrupt; or all nodes that
    /// cannot take this program. Nothing has changed then.
    pub fn new(
        attached: Vec<Attached>,
        program: &Program,
        (patience, swap): (Patience, Duration),
        tell: &'a mut dyn FnMut(&UpdateStage),
    ) -> Result<Self, HubError> {
        let (seats, outlets) = Outlets::of(attached);
        let update = Update::new(seats.clone(), patience, swap, program.image());
        let mut this = Self { update, seats, outlets, patience, tell, configured: false };
        let met = this.outlets.run(this.update.meet());
        met.map_err(|error| this.explain(error))?;
        Ok(this)
    }

    /// Whether all nodes have the program already.
    pub fn is_done(&self) -> bool {
        self.update.is_done()
    }

    /// Gives all nodes the program, or none.
    ///
    /// # Errors
    /// [`Failed::Before`] any node was told to swap: each has what it had, or had before an earlier trial. [`Failed::After`] that, or where a node
    /// was lost as its earlier trial ended: what is known of each.
    pub fn update(mut self, program: &Program, trial: Trial) -> Result<Vec<Updated>, Failed> {
        self.end_other_trials()?;
        self.send(program.bytes()).map_err(Failed::Before)?;
        if self.update.is_done() {
            // They have gone back to it.
            return Ok(self.update.updated());
        }
        // The last moment at which there is nothing to take back.
        self.outlets.check_interrupt().map_err(Failed::Before)?;
        match self.swap_and_try(trial) {
            Ok(()) => Ok(self.update.updated()),
            Err(error) => Err(self.take_back(error)),
        }
    }

    fn end_other_trials(&mut self) -> Result<(), Failed> {
        let mut back = Vec::new();
        let ended = self.outlets.run(self.update.end_other_trials(&mut back));
        if !back.is_empty() {
            (self.tell)(&UpdateStage::WentBack(back));
        }
        ended.map_err(|error| {
            let known = self.update.known();
            let error = self.explain(error);
            if known.unsure.is_empty() {
                Failed::Before(error)
            } else {
                Failed::After(error, Box::new(known))
            }
        })
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), HubError> {
        let all = self.update.bytes_to_send();
        if all == 0 {
            return Ok(());
        }
        self.outlets.run(self.update.begin())?;
        let nodes = self.update.in_need();
        let mut done = 0;
        (self.tell)(&UpdateStage::Sent { nodes: nodes.clone(), done, all });
        for block in bytes.chunks(MAX_BLOCK) {
            self.outlets.run(self.update.send(done, block))?;
            done += block.len() as u32;
            (self.tell)(&UpdateStage::Sent { nodes: nodes.clone(), done, all });
        }
        self.outlets.run(self.update.check())?;
        (self.tell)(&UpdateStage::Checked);
        Ok(())
    }

    fn swap_and_try(&mut self, trial: Trial) -> Result<(), HubError> {
        if self.update.bytes_to_send() > 0 {
            (self.tell)(&UpdateStage::Swapping);
            self.outlets.run(self.update.swap())?;
            self.outlets.run(self.update.await_new())?;
        }
        (self.tell)(&UpdateStage::OnTrial(self.update.on_trial()));
        let mut conductor = Conductor::new(self.seats.clone(), &trial.configs, trial.bus, self.patience);
        let ran = self.run_trial(&mut conductor);
        // Whether or not it went well: those on trial restart only when they stand still.
        self.outlets.hurry(self.patience.answer);
        // One that is not heard to stop is stopped once more before its restart.
        let _ = self.outlets.run(conductor.halt());
        ran?;
        (self.tell)(&UpdateStage::Confirmed);
        self.outlets.run(self.update.restart())
    }

    /// All nodes tick together: none completes a tick alone, so that all complete their trials or none does.
    fn run_trial(&mut self, conductor: &mut Conductor) -> Result<(), HubError> {
        let all = self.outlets.run(self.update.ticks_left())?;
        self.update.check_trials(all)?;
        self.configured = true;
        self.outlets.run(conductor.meet())?;
        self.outlets.run(conductor.start())?;
        for tick in 0..all.saturating_sub(LAST_TICKS) {
            self.tick(conductor)?;
            (self.tell)(&UpdateStage::Trial { left: all - tick - 1, all });
        }
        self.outlets.run(self.update.ticks_left())?;
        self.update.check_trials(LAST_TICKS + 1)?;
        // All are there still; from here on some may stay, so nobody is listened to any more.
        self.outlets.check_interrupt()?;
        self.outlets.hurry(self.patience.answer);
        for _ in 0..LAST_TICKS + MORE_TICKS {
            self.tick(conductor)?;
            let left = self.outlets.run(self.update.ticks_left())?;
            (self.tell)(&UpdateStage::Trial { left, all });
            if left == 0 {
                return Ok(());
            }
        }
        let node = self.update.on_trial().first().copied().unwrap_or_default();
        Err(HubError::NotConfirmed { node, left: 1 })
    }

    fn tick(&mut self, conductor: &mut Conductor) -> Result<(), HubError> {
        let tick = conductor.next_tick();
        self.outlets.run(conductor.advance())?;
        let stopped = conductor.presence().iter().position(|&presence| presence == Presence::Stopped);
        match stopped.and_then(|index| self.seats.get(index)) {
            Some(seat) => Err(HubError::StoppedOnTrial { node: seat.id, tick }),
            None => Ok(()),
        }
    }

    /// An error with what is left behind, once all that are on trial, or configured for it, have been restarted.
    fn take_back(&mut self, error: HubError) -> Failed {
        (self.tell)(&UpdateStage::GoingBack);
        self.outlets.hurry(self.patience.answer);
        let known = self.outlets.run(self.update.go_back(self.configured));
        Failed::After(self.explain(error), Box::new(known))
    }

    /// Adds to an error what the device of the node has to say, where its line is gone or it was never heard.
    fn explain(&mut self, error: HubError) -> HubError {
        let is_of_device =
            matches!(error, HubError::Died { .. } | HubError::NoAnswer { awaited: "identity", .. });
        let words = error.node().filter(|_| is_of_device);
        let words = words.and_then(|id| self.outlets.last_words(id, &error)).unwrap_or_default();
        error.with_words(words.join("\n"))
    }
}
