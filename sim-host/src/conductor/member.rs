//! One node of the network.

use super::absence::Away;
use super::commits::Commit;
use super::contact::{Contact, Seat, TIMES};
use super::shadow::Shadow;
use super::task::Outside;
use super::{HubError, Received};
use crate::presence::Presence;
use funnelnet_protocol::config::{Coupling, NodeConfig};
use funnelnet_protocol::message::FaultCode;
use funnelnet_protocol::service::{Identity, Reply, Request};
use funnelnet_protocol::{WIRE_VERSION, serial};
use std::time::Duration;

/// What is known of it.
pub(super) struct Member {
    pub(super) contact: Contact,
    uid: Option<u64>,
    pub(super) identity: Option<Identity>,
    /// What it is told before the run; once it has adopted another one, that.
    pub(super) config: NodeConfig,
    /// What it adopts while it runs, if anything.
    pub(super) commit: Option<Commit>,
    /// Set while it is lost and the others go on.
    pub(super) away: Option<Away>,
    /// An event keeps it off.
    pub(super) off: bool,
    /// One has kept it off, so that what it reports is not of the whole run.
    pub(super) was_off: bool,
    /// It has come to a network that runs, and has not said a state yet.
    pub(super) listens: bool,
    /// What it should be like meanwhile, where this program can know.
    pub(super) shadow: Option<Shadow>,
    /// The bus that its states travel on, by index; `None` for one that is on its line only.
    pub(super) on_can: Option<usize>,
    /// State at the tick that comes next, by component.
    pub(super) next_state: Vec<f32>,
    /// It has said that it stopped, and is not waited for any more.
    pub(super) stopped: bool,
    /// What it said last is the outcome of a tick, so that its telemetry follows.
    pub(super) ticked: bool,
    /// Components of its state that have come in this tick, a bit each.
    pub(super) states: u8,
    /// Components of its telemetry that have.
    pub(super) telemetries: usize,
    /// A telemetry of this tick was refused.
    pub(super) refused: bool,
    /// The last warning that it has said: on CAN it comes by two ways.
    pub(super) warned: Option<(FaultCode, u16, u32)>,
}

impl Member {
    pub(super) fn new(
        index: usize,
        Seat { id, place, uid }: Seat,
        config: &NodeConfig,
        outside: &Outside,
    ) -> Self {
        Self {
            contact: Contact::new(index, id, place, outside),
            uid,
            identity: None,
            config: config.clone(),
            commit: None,
            away: None,
            off: false,
            was_off: false,
            listens: false,
            shadow: None,
            on_can: None,
            next_state: config.initial_state.to_vec(),
            stopped: false,
            ticked: false,
            states: 0,
            telemetries: 0,
            refused: false,
            warned: None,
        }
    }

    /// Whether all components of its state have come in this tick.
    pub(super) fn has_told_its_state(&self) -> bool {
        self.states.count_ones() as usize >= self.next_state.len()
    }

    /// Whether it is there: neither lost nor kept off by an event.
    pub(super) fn is_here(&self) -> bool {
        self.away.is_none() && !self.off
    }

    /// Whether it listens before it speaks where it comes to a network that runs.
    pub(super) fn listens_first(&self) -> bool {
        self.config.coupling != Coupling::None && !self.config.neighbours.is_empty()
    }

    /// Whether it is not expected to say a state in this tick.
    pub(super) fn says_nothing(&self) -> bool {
        self.listens && !self.shadow.as_ref().is_some_and(Shadow::speaks)
    }

    /// Takes it that it is as its configuration makes it.
    pub(super) fn begin_anew(&mut self) {
        (self.off, self.stopped, self.warned) = (false, false, None);
        self.next_state = self.config.initial_state.to_vec();
    }

    /// Whether it had a configuration when it was asked who it is.
    pub(super) fn is_configured(&self) -> bool {
        self.identity.is_some_and(|identity| identity.id != serial::HOST)
    }

    /// The unique number that its chip must have.
    pub(super) fn uid(&self) -> Option<u64> {
        self.uid
    }

    /// Takes note that it is off or lost, and with it what was staged in it.
    pub(super) fn lose_staged(&mut self) {
        if let Some(commit) = &mut self.commit {
            commit.lose();
        }
    }

    /// What is known of it at a tick of which it has said nothing.
    pub(super) fn presence(&self) -> Presence {
        match self {
            Self { off: true, .. } => Presence::Off,
            Self { away: Some(_), .. } => Presence::Absent,
            Self { stopped: true, .. } => Presence::Stopped,
            Self { .. } => Presence::Unrecorded,
        }
    }

    /// Asks it who it is, and takes note of that, if it is who it should be.
    pub(super) async fn identify(&mut self, patience: Duration) -> Result<(), HubError> {
        let identity = self.contact.identify(patience).await?;
        self.identity = Some(identity);
        check_identity(&self.contact, &identity, self.uid)
    }

    /// The same of one that is known to listen: what was sent to it before, it has done then.
    pub(super) async fn ask_again_who_it_is(&mut self, patience: Duration) -> Result<(), HubError> {
        let identity = |received| match received {
            Received::Reply(Reply::Identity(identity)) => Some(identity),
            _ => None,
        };
        let every = (patience, patience / TIMES);
        self.contact.ask(&Request::Hello, every, "identity", identity).await.map(|_| ())
    }

    pub(super) async fn configure(
        &mut self,
        config: &NodeConfig,
        patience: Duration,
    ) -> Result<(), HubError> {
        let request = Request::Configure(config.clone());
        let configured = |received| match received {
            Received::Reply(Reply::Configured(answer)) => Some(answer),
            _ => None,
        };
        let answer =
            self.contact.ask(&request, (patience, patience / TIMES), "configured", configured).await?;
        answer.map_err(|reason| HubError::Refused { node: config.id, reason }.on_reading(config))?;
        // What it said before belongs to another run.
        self.contact.expect_its_own();
        Ok(())
    }
}

/// Whether the node that was met speaks this wire, and has the unique number `uid` if one is expected.
pub(super) fn check_identity(
    contact: &Contact,
    identity: &Identity,
    uid: Option<u64>,
) -> Result<(), HubError> {
    let node = contact.id();
    if identity.wire_version != WIRE_VERSION {
        return Err(HubError::WireVersion { node, found: identity.wire_version });
    }
    match uid.filter(|&uid| uid != identity.uid) {
        Some(expected) => {
            let place = contact.place().to_owned();
            Err(HubError::Uid { node, place, expected, found: identity.uid })
        }
        None => Ok(()),
    }
}
