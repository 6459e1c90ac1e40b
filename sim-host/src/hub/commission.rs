//! Gives nodes a configuration that survives a restart, or takes it from them: all of them, or none.
//!
//! Every node stages its configuration beside the one that it has. Only when all have, with the checksum that this program expects, are they
//! told to commit (protocol/README.md, "Commit"). A node can still fail then: what is known of each of them is told.

use super::{Attached, HubError, Link, Received, STOP, ask_who, check_identity, identify};
use super::{Device, Patience};
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

/// Nodes that are being commissioned.
pub struct Commissioning {
    nodes: Vec<Candidate>,
    patience: Patience,
}

struct Candidate {
    link: Link,
    device: Box<dyn Device>,
    before: Identity,
}

impl Commissioning {
    /// Asks each node who it is, and stops it if it runs.
    ///
    /// # Errors
    /// A node that does not answer in time, another wire version, another chip, an interrupt. Nothing has changed then.
    pub fn new(attached: Vec<Attached>, patience: Patience) -> Result<Self, HubError> {
        let candidate = |Attached { mut link, mut device, uid }: Attached| {
            let met = meet(&mut link, uid, patience);
            let before = met.map_err(|error| explain(error, device.as_mut()))?;
            Ok(Candidate { link, device, before })
        };
        Ok(Self { nodes: attached.into_iter().map(candidate).collect::<Result<_, _>>()?, patience })
    }

    /// Stages one configuration per node, compares all checksums, and commits.
    ///
    /// # Errors
    /// [`Failed::Before`] the first commit: every node has what it had. [`Failed::After`] it: some may have the new one.
    pub fn commission(mut self, configs: &[NodeConfig]) -> Result<Vec<Commissioned>, Failed> {
        for (node, config) in self.nodes.iter_mut().zip(configs) {
            let staged = node.stage(config, self.patience);
            staged.map_err(|error| Failed::Before(explain(error, node.device.as_mut())))?;
        }
        self.go_through_with_it()?;
        let patience = self.patience;
        let commit = |(node, config): (&mut Candidate, &NodeConfig)| node.commit(config, patience);
        let done = collect(self.nodes.iter_mut().zip(configs).map(commit));
        done.map_err(|(error, done)| self.fail(error, &done))
    }

    /// Makes all nodes blank at their next start, one after the other.
    ///
    /// # Errors
    /// [`Failed::Before`] where the first one refuses; [`Failed::After`] where a later one does, or where one does not answer.
    pub fn erase(mut self) -> Result<Vec<Commissioned>, Failed> {
        self.go_through_with_it()?;
        let patience = self.patience;
        let done = collect(self.nodes.iter_mut().map(|node| node.erase(patience)));
        done.map_err(|(error, done)| self.fail(error, &done))
    }

    /// The last moment at which the user's wish to stop is heard: nodes of which some have changed are worse than either.
    fn go_through_with_it(&mut self) -> Result<(), Failed> {
        self.nodes.iter().try_for_each(|node| node.link.check_interrupt()).map_err(Failed::Before)?;
        self.nodes.iter_mut().for_each(|node| node.link.hurry(self.patience.answer));
        Ok(())
    }

    /// Sorts the nodes by what is known of them, where all before the failed one were `done`.
    fn fail(&mut self, error: HubError, done: &[Commissioned]) -> Failed {
        let mut known = Known { done: done.iter().map(|node| node.node).collect(), ..Known::default() };
        let mut rest = self.nodes.iter_mut().skip(done.len());
        let Some(failed) = rest.next() else { return Failed::Before(error) };
        let unchanged = failed.has_surely_not_changed(&error);
        let group = if unchanged { &mut known.unchanged } else { &mut known.unsure };
        group.push(failed.link.id());
        known.unchanged.extend(rest.map(|node| node.link.id()));
        let error = explain(error, failed.device.as_mut());
        if done.is_empty() && unchanged {
            Failed::Before(error)
        } else {
            Failed::After(error, Box::new(known))
        }
    }
}

impl Candidate {
    fn stage(&mut self, config: &NodeConfig, patience: Patience) -> Result<(), HubError> {
        self.link.request(&Request::Stage(config.clone()))?;
        let answer = self.link.wait_for(patience.answer, "staged", |received| match received {
            Received::Reply(Reply::Staged(answer)) => Some(answer),
            _ => None,
        })?;
        let node = self.link.id();
        let found = answer.map_err(|reason| HubError::NotStaged { node, reason })?;
        let expected = config.checksum();
        if found == expected { Ok(()) } else { Err(HubError::Checksum { node, expected, found }) }
    }

    fn commit(&mut self, config: &NodeConfig, patience: Patience) -> Result<Commissioned, HubError> {
        self.link.write(&serial::encode(&COMMIT))?;
        // It answers when it has committed. A storage that has failed is told before: the checksum is that of the configuration that the
        // node goes on with, which may be the same one.
        let after = ask_who(&mut self.link, patience.answer, |received| match received {
            Received::Message(Message::Fault { code: FaultCode::COMMIT, .. }) => Some(None),
            Received::Reply(Reply::Identity(identity)) => Some(Some(identity)),
            _ => None,
        })?;
        let (node, expected) = (self.link.id(), config.checksum());
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

    fn erase(&mut self, patience: Patience) -> Result<Commissioned, HubError> {
        self.link.request(&Request::Erase)?;
        let answer = self.link.wait_for(patience.answer, "erased", |received| match received {
            Received::Reply(Reply::Erased(answer)) => Some(answer),
            _ => None,
        })?;
        answer.map_err(|reason| HubError::NotErased { node: self.link.id(), reason })?;
        Ok(self.done(None))
    }

    fn done(&self, after: Option<Identity>) -> Commissioned {
        Commissioned { node: self.link.id(), place: self.link.place().to_owned(), before: self.before, after }
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

/// All of them, or the first error and those before it.
fn collect(
    done: impl Iterator<Item = Result<Commissioned, HubError>>,
) -> Result<Vec<Commissioned>, (HubError, Vec<Commissioned>)> {
    let mut nodes = Vec::new();
    for one in done {
        match one {
            Ok(node) => nodes.push(node),
            Err(error) => return Err((error, nodes)),
        }
    }
    Ok(nodes)
}

fn meet(link: &mut Link, uid: Option<u64>, patience: Patience) -> Result<Identity, HubError> {
    let identity = identify(link, patience.boot)?;
    check_identity(link, &identity, uid)?;
    if identity.id != serial::HOST {
        // It may run still; then it would refuse.
        link.write(&serial::encode(&STOP))?;
    }
    Ok(identity)
}

fn explain(error: HubError, device: &mut dyn Device) -> HubError {
    let words = device.last_words(matches!(error, HubError::Died { .. }));
    error.with_words(words.join("\n"))
}
