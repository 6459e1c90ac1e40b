//! One node that is talked to: what it is asked, and what it answers in time.

use super::deadline::Deadline;
use super::task::{Action, Outside, Source};
use super::{HubError, Line, Received};
use funnelnet_protocol::Refusal;
use funnelnet_protocol::config::NodeConfig;
use funnelnet_protocol::serial::{self, HOST, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Identity, Reply, Request};
use std::time::Duration;

/// How long a node that has said nothing is left alone before it is asked again who it is: it may have been
/// booting.
const ASK_AGAIN: Duration = Duration::from_secs(1);
/// How many times a request is sent within the time for its answer.
pub(super) const TIMES: u32 = 3;
/// How long a look at a line may take.
const LOOK: Duration = Duration::from_millis(50);

/// Who is to be where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seat {
    /// Id of the node.
    pub id: u8,
    /// What it is reached by, as messages call it: `the emulator`, for example.
    pub place: String,
    /// The unique number that its chip must have.
    pub uid: Option<u64>,
}

/// A node's line, and how it is talked to.
pub struct Contact {
    /// Of the node, as the outside knows it.
    index: usize,
    line: Line,
    place: String,
    /// Bytes that wait for [`Contact::flush`]: all frames of a tick go out in one write.
    queued: Vec<u8>,
    outside: Outside,
}

impl Contact {
    pub(crate) fn new(index: usize, id: u8, place: String, outside: &Outside) -> Self {
        Self { index, line: Line::new(id), place, queued: Vec::new(), outside: outside.clone() }
    }

    /// The node's id.
    pub fn id(&self) -> u8 {
        self.line.id()
    }

    /// What the node is reached by.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Frames from the node that could not be read so far, and why the last of them.
    pub fn refused(&self) -> (u64, Option<Refusal>) {
        self.line.refused()
    }

    /// What its line sounds like, where that is not a node.
    pub fn sound(&self) -> Option<String> {
        self.line.sound()
    }

    /// What the node has said whole and cannot mean, since the last call: what it did, and the value.
    pub(super) fn take_doubts(&mut self) -> Vec<(&'static str, String)> {
        self.line.take_doubts()
    }

    /// From now on the node has its id: what another one says of itself is not taken from its line.
    pub(super) fn expect_its_own(&mut self) {
        self.line.expect_its_own();
    }

    /// Keeps bytes for the next flush.
    pub(super) fn queue(&mut self, bytes: &[u8]) {
        self.queued.extend_from_slice(bytes);
    }

    /// Forgets what is queued.
    pub(super) fn drop_queued(&mut self) {
        self.queued.clear();
    }

    /// Writes everything that is queued.
    ///
    /// # Errors
    /// As [`Contact::write`].
    pub(super) async fn flush(&mut self) -> Result<(), HubError> {
        let queued = std::mem::take(&mut self.queued);
        if queued.is_empty() { Ok(()) } else { self.outside.act(self.writing(queued)).await }
    }

    /// Writes whole frames at once.
    ///
    /// # Errors
    /// The node is gone, or leaves its line unread, or an interrupt.
    pub(crate) async fn write(&mut self, frames: &[u8]) -> Result<(), HubError> {
        self.outside.act(self.writing(frames.to_vec())).await
    }

    fn writing(&self, bytes: Vec<u8>) -> Action {
        Action::Write { node: self.index, bytes }
    }

    /// Sends a request.
    ///
    /// # Errors
    /// As [`Contact::write`].
    pub(crate) async fn request(&mut self, request: &impl Body) -> Result<(), HubError> {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        let length = serial::encode_service(request, HOST, &mut scratch, &mut frame).unwrap_or(0);
        self.write(frame.get(..length).unwrap_or(&frame)).await
    }

    /// Waits until `pick` takes something that the node said; what it does not take is dropped.
    ///
    /// # Errors
    /// Nothing within `limit`, the node is gone, or an interrupt.
    pub(crate) async fn wait_for<T>(
        &mut self,
        limit: Duration,
        awaited: &'static str,
        pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, HubError> {
        let deadline = Deadline::after(limit, self.outside.now());
        self.wait_until(deadline, awaited, pick).await
    }

    /// The same until a deadline, of which an error says how long it was.
    ///
    /// # Errors
    /// As [`Contact::wait_for`].
    pub(super) async fn wait_until<T>(
        &mut self,
        deadline: Deadline,
        awaited: &'static str,
        mut pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, HubError> {
        loop {
            self.take();
            // What was read in time is not lost to a slow host.
            if let Some(picked) = self.line.pop_picked(&mut pick) {
                return Ok(picked);
            }
            if deadline.is_over(self.outside.now()) {
                return Err(HubError::NoAnswer { node: self.id(), awaited, waited: deadline.limit });
            }
            self.read(deadline.until()).await?;
        }
    }

    /// Reads for a moment, and gives the first thing that `pick` picks of what the node has said; all of it
    /// stays.
    ///
    /// # Errors
    /// The node is gone, or an interrupt.
    pub(super) async fn look<T>(
        &mut self,
        pick: impl Fn(&Received) -> Option<T>,
    ) -> Result<Option<T>, HubError> {
        self.read(Deadline::after(LOOK, self.outside.now()).until()).await?;
        self.take();
        Ok(self.line.peek(pick))
    }

    /// The oldest thing that the node has said and nobody has taken.
    pub(super) fn next_received(&mut self) -> Option<Received> {
        self.take();
        self.line.pop()
    }

    /// Fails once its time for a tick is over: it may have said what it wants.
    ///
    /// # Errors
    /// It is over.
    pub(super) fn check_patience(
        &self,
        deadline: Deadline,
        tick: u32,
        awaited: &'static str,
    ) -> Result<(), HubError> {
        if !deadline.is_over(self.outside.now()) {
            return Ok(());
        }
        Err(HubError::Babbles { node: self.id(), tick, awaited, waited: deadline.limit })
    }

    async fn read(&mut self, until: u64) -> Result<(), HubError> {
        self.outside.act(Action::Read { from: Source::Line(self.index), until }).await
    }

    /// Takes what has come from the line.
    fn take(&mut self) {
        self.line.on_bytes(&self.outside.take_bytes(self.index));
    }

    /// Closes the line of a node that is gone, and forgets what it has left.
    ///
    /// # Errors
    /// An interrupt.
    pub(super) async fn close(&mut self) -> Result<(), HubError> {
        self.outside.act(Action::Close { node: self.index }).await?;
        self.forget();
        Ok(())
    }

    /// Goes on with another line to the same node, if its device is back.
    ///
    /// # Errors
    /// An interrupt.
    pub(super) async fn reopen(&mut self) -> Result<(), HubError> {
        if self.outside.reopen(self.index).await? {
            self.forget();
        }
        Ok(())
    }

    /// Forgets what an old line to the same node has left.
    pub(super) fn forget(&mut self) {
        let _ = self.outside.take_bytes(self.index);
        self.line.replace();
        self.queued.clear();
    }

    /// Asks the node who it is, again and again, until it answers.
    ///
    /// # Errors
    /// No answer within `limit`, or the node is gone, or an interrupt.
    pub(crate) async fn identify(&mut self, limit: Duration) -> Result<Identity, HubError> {
        self.ask_who(limit, |received| match received {
            Received::Reply(Reply::Identity(identity)) => Some(identity),
            _ => None,
        })
        .await
    }

    /// The same, for whoever takes more for an answer.
    pub(super) async fn ask_who<T>(
        &mut self,
        limit: Duration,
        pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, HubError> {
        self.ask(&Request::Hello, (limit, ASK_AGAIN), "identity", pick).await
    }

    /// Has the node keep a configuration beside its own one, and compares the checksum of what it reads back.
    ///
    /// # Errors
    /// It cannot, or it keeps another one; no answer within `limit`, the node is gone, or an interrupt.
    pub(super) async fn stage(&mut self, config: &NodeConfig, limit: Duration) -> Result<(), HubError> {
        self.request(&Request::Stage(config.clone())).await?;
        let staged = |received| match received {
            Received::Reply(Reply::Staged(answer)) => Some(answer),
            _ => None,
        };
        let answer = self.wait_for(limit, "staged", staged).await?;
        let node = self.id();
        let found = answer.map_err(|reason| HubError::NotStaged { node, reason }.on_reading(config))?;
        let expected = config.checksum();
        if found == expected { Ok(()) } else { Err(HubError::Checksum { node, expected, found }) }
    }

    /// Sends a request that may be repeated, and sends it again where no answer comes: the line may have
    /// spoilt it, or the answer.
    ///
    /// # Errors
    /// No answer within `limit`, with a new request `every` so often; the node is gone, or an interrupt.
    pub(super) async fn ask<T>(
        &mut self,
        request: &impl Body,
        (limit, every): (Duration, Duration),
        awaited: &'static str,
        mut pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, HubError> {
        let whole = Deadline::after(limit, self.outside.now());
        loop {
            self.request(request).await?;
            let left = Duration::from_nanos(whole.end.saturating_sub(self.outside.now()));
            match self.wait_for(every.min(left), awaited, &mut pick).await {
                Err(HubError::NoAnswer { .. }) if self.outside.now() < whole.end => {}
                Err(HubError::NoAnswer { node, awaited, .. }) => {
                    return Err(HubError::NoAnswer { node, awaited, waited: limit });
                }
                answer => return answer,
            }
        }
    }
}
