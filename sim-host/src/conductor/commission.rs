//! Gives nodes a configuration that survives a restart, or takes it from them: all of them, or none.
//!
//! Every node stages its configuration beside the one that it has. Only when all have, with the checksum that
//! this program expects, are they told to commit (protocol/README.md, "Commit"). A node can still fail then:
//! what is known of each of them is told.

use super::contact::{Contact, Seat};
use super::member::check_identity;
use super::task::{Outside, Task};
use super::{HubError, Patience, Received, STOP};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::message::{Command, FaultCode, Message, Target};
use funnelnet_protocol::serial;
use funnelnet_protocol::service::{Identity, Reply, Request};
use std::fmt;

/// Makes what is staged the configuration of a node, at once where it does not run.
const COMMIT: Message = Message::Ctrl { target: Target::All, command: Command::Commit, arg: 0, at_tick: 0 };

/// A node that was given a configuration, or that lost it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Commissioned {
    /// Its id in the bench file.
    pub node: u8,
    /// What it was reached by.
    pub place: String,
    /// Who it said it was, before.
    pub before: Identity,
    /// Who it says it is now; `None` where it will be blank at its next start.
    pub after: Option<Identity>,
}

impl fmt::Display for Commissioned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, place, before, after } = self;
        write!(f, "node {node}: {place}, uid = \"{:016x}\": was {}, ", before.uid, Has(before))?;
        match after {
            Some(after) => write!(f, "is {}", Has(after)),
            None => f.write_str("will be blank at its next start"),
        }
    }
}

/// What a node says of its configuration.
struct Has<'a>(&'a Identity);

impl fmt::Display for Has<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.id {
            serial::HOST => f.write_str("blank")?,
            id => write!(f, "id {id} with configuration {:08x}", self.0.checksum)?,
        }
        if self.0.has_key { f.write_str(" and a key") } else { Ok(()) }
    }
}

/// Nodes that are being commissioned: met, then staged, then changed.
pub struct Commission {
    outside: Outside,
    nodes: Vec<Candidate>,
    patience: Patience,
    /// Index of the node that was dealt with last.
    at: usize,
}

struct Candidate {
    contact: Contact,
    uid: Option<u64>,
    before: Identity,
}

impl Commission {
    /// Of nodes in these seats.
    pub fn new(seats: Vec<Seat>, patience: Patience) -> Self {
        let outside = Outside::default();
        let candidate = |(index, Seat { id, place, uid }): (usize, Seat)| {
            let contact = Contact::new(index, id, place, &outside);
            Candidate { contact, uid, before: Identity::default() }
        };
        let nodes = seats.into_iter().enumerate().map(candidate).collect();
        Self { outside, nodes, patience, at: 0 }
    }

    /// Asks each node who it is, and stops it if it runs.
    ///
    /// Its error: a node that does not answer in time, another wire version, another chip, an interrupt.
    /// Nothing has changed then.
    pub fn meet(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            for (index, node) in self.nodes.iter_mut().enumerate() {
                self.at = index;
                node.meet(self.patience).await?;
            }
            Ok(())
        })
    }

    /// Stages one configuration per node, and compares all checksums.
    ///
    /// Its error: every node has what it had.
    pub fn stage<'a>(&'a mut self, configs: &'a [NodeConfig]) -> Task<'a, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            for (index, (node, config)) in self.nodes.iter_mut().zip(configs).enumerate() {
                self.at = index;
                node.stage(config, self.patience).await?;
            }
            Ok(())
        })
    }

    /// Makes what is staged the configuration of each node, one after the other.
    ///
    /// Its error: [`Failed::Before`] the first one has changed, or [`Failed::After`] that.
    pub fn commit<'a>(
        &'a mut self,
        configs: &'a [NodeConfig],
    ) -> Task<'a, Result<Vec<Commissioned>, Failed>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let mut done = Vec::new();
            for (index, (node, config)) in self.nodes.iter_mut().zip(configs).enumerate() {
                self.at = index;
                match node.commit(config, self.patience).await {
                    Ok(node) => done.push(node),
                    Err(error) => return Err(self.fail(error, &done)),
                }
            }
            Ok(done)
        })
    }

    /// Makes all nodes blank at their next start, one after the other.
    ///
    /// Its error: [`Failed::Before`] where the first one refuses; [`Failed::After`] where a later one does,
    /// or where one does not answer.
    pub fn erase(&mut self) -> Task<'_, Result<Vec<Commissioned>, Failed>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let mut done = Vec::new();
            for (index, node) in self.nodes.iter_mut().enumerate() {
                self.at = index;
                match node.erase(self.patience).await {
                    Ok(node) => done.push(node),
                    Err(error) => return Err(self.fail(error, &done)),
                }
            }
            Ok(done)
        })
    }

    /// Index of the node that was dealt with last: an error is about it.
    pub fn at(&self) -> usize {
        self.at
    }

    /// Sorts the nodes by what is known of them, where all before the failed one were `done`.
    fn fail(&self, error: HubError, done: &[Commissioned]) -> Failed {
        let mut known = Known { done: done.iter().map(|node| node.node).collect(), ..Known::default() };
        let mut rest = self.nodes.iter().skip(done.len());
        let Some(failed) = rest.next() else { return Failed::Before(error) };
        let unchanged = failed.has_surely_not_changed(&error);
        let group = if unchanged { &mut known.unchanged } else { &mut known.unsure };
        group.push(failed.contact.id());
        known.unchanged.extend(rest.map(|node| node.contact.id()));
        if done.is_empty() && unchanged {
            Failed::Before(error)
        } else {
            Failed::After(error, Box::new(known))
        }
    }
}

impl Candidate {
    async fn meet(&mut self, patience: Patience) -> Result<(), HubError> {
        self.before = self.contact.identify(patience.boot).await?;
        check_identity(&self.contact, &self.before, self.uid)?;
        if self.before.id != serial::HOST {
            // It may run still; then it would refuse.
            self.contact.write(&serial::encode(&STOP)).await?;
        }
        Ok(())
    }

    async fn stage(&mut self, config: &NodeConfig, patience: Patience) -> Result<(), HubError> {
        self.contact.stage(config, patience.answer).await
    }

    async fn commit(&mut self, config: &NodeConfig, patience: Patience) -> Result<Commissioned, HubError> {
        self.contact.write(&serial::encode(&COMMIT)).await?;
        // It answers when it has committed. A storage that has failed is told before: the checksum is that of
        // the configuration that the node goes on with, which may be the same one.
        let committed = |received| match received {
            Received::Message(Message::Fault { code: FaultCode::COMMIT, .. }) => Some(None),
            Received::Reply(Reply::Identity(identity)) => Some(Some(identity)),
            _ => None,
        };
        let after = self.contact.ask_who(patience.answer, committed).await?;
        let (node, expected) = (self.contact.id(), config.checksum());
        let after = after.ok_or(HubError::NotCommitted { node })?;
        if (after.id, after.checksum) != (config.id, expected) {
            return Err(HubError::Checksum { node, expected, found: after.checksum });
        }
        Ok(self.done(Some(after)))
    }

    /// Whether a node that was told to commit or to erase has what it had, for all that an error says.
    fn has_surely_not_changed(&self, error: &HubError) -> bool {
        match error {
            HubError::NotErased { .. } => true,
            HubError::Checksum { found, .. } => *found == self.before.checksum,
            _ => false,
        }
    }

    async fn erase(&mut self, patience: Patience) -> Result<Commissioned, HubError> {
        self.contact.request(&Request::Erase).await?;
        let erased = |received| match received {
            Received::Reply(Reply::Erased(answer)) => Some(answer),
            _ => None,
        };
        let answer = self.contact.wait_for(patience.answer, "erased", erased).await?;
        answer.map_err(|reason| HubError::NotErased { node: self.contact.id(), reason })?;
        Ok(self.done(None))
    }

    fn done(&self, after: Option<Identity>) -> Commissioned {
        Commissioned {
            node: self.contact.id(),
            place: self.contact.place().to_owned(),
            before: self.before,
            after,
        }
    }
}

/// Why nodes were not all commissioned.
#[derive(Debug)]
pub enum Failed {
    /// Nothing has changed on any of them.
    Before(HubError),
    /// Some have changed, or may have.
    After(HubError, Box<Known>),
}

impl Failed {
    /// The same with another error.
    pub(crate) fn map(self, other: impl FnOnce(HubError) -> HubError) -> Self {
        match self {
            Self::Before(error) => Self::Before(other(error)),
            Self::After(error, known) => Self::After(other(error), known),
        }
    }
}

/// What is known of the nodes after the first one was told to change for good, by id.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Known {
    /// They have changed.
    pub done: Vec<u8>,
    /// They were told to, and may have.
    pub unsure: Vec<u8>,
    /// They have what they had: they refused, or were not told.
    pub unchanged: Vec<u8>,
}
