//! Talk with one node on a real line, answer by answer.

use super::outlets::Outlets;
use super::{Attached, Device, HubError, Link, Received};
use crate::conductor::{Contact, Outside, Task};
use funnelnet_protocol::service::{Identity, Request};
use std::io::Read;
use std::time::Duration;

/// A node that is talked to alone.
pub struct Talk {
    outside: Outside,
    contact: Contact,
    outlets: Outlets,
}

impl Talk {
    /// With the node behind `link`.
    pub fn new(link: Link) -> Self {
        let outside = Outside::default();
        let contact = Contact::new(0, link.id(), link.place().to_owned(), &outside);
        let (_, outlets) = Outlets::of(vec![Attached { link, device: Box::new(Unknown), uid: None }]);
        Self { outside, contact, outlets }
    }

    /// The node's id.
    pub fn id(&self) -> u8 {
        self.contact.id()
    }

    /// Writes whole frames at once.
    ///
    /// # Errors
    /// The node is gone, or leaves its line unread, or an interrupt.
    pub fn write(&mut self, frames: &[u8]) -> Result<(), HubError> {
        self.outlets.run(Task::new(&self.outside, self.contact.write(frames)))
    }

    /// Sends a request.
    ///
    /// # Errors
    /// As [`Talk::write`].
    pub fn request(&mut self, request: &Request) -> Result<(), HubError> {
        self.outlets.run(Task::new(&self.outside, self.contact.request(request)))
    }

    /// Waits until `pick` takes something that the node said; what it does not take is dropped.
    ///
    /// # Errors
    /// Nothing within `limit`, the node is gone, or an interrupt.
    pub fn wait_for<T>(
        &mut self,
        limit: Duration,
        awaited: &'static str,
        pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, HubError> {
        self.outlets.run(Task::new(&self.outside, self.contact.wait_for(limit, awaited, pick)))
    }

    /// A second handle of its line, for who reads past this one.
    ///
    /// # Errors
    /// The operating system's.
    pub fn reader(&self) -> Result<Box<dyn Read + Send>, HubError> {
        self.outlets.reader_of(0)
    }

    /// What its line sounds like, where that is not a node.
    pub fn sound(&self) -> Option<String> {
        self.contact.sound()
    }

    /// Asks the node who it is, again and again, until it answers.
    ///
    /// # Errors
    /// No answer within `limit`, or the node is gone, or an interrupt.
    pub fn identify(&mut self, limit: Duration) -> Result<Identity, HubError> {
        self.outlets.run(Task::new(&self.outside, self.contact.identify(limit)))
    }
}

/// A device of which nothing is known.
struct Unknown;

impl Device for Unknown {
    fn last_words(&mut self, _: bool) -> Vec<String> {
        Vec::new()
    }

    fn into_log(self: Box<Self>) -> Option<String> {
        None
    }
}
