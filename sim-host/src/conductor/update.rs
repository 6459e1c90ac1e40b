//! Gives nodes a new program: all of them, or none.
//!
//! Every node takes the whole program beside the one that it runs, and reads it back. Only when all have it are
//! they told to swap (protocol/README.md, "Update"). From then on each is on trial: what has not completed its
//! ticks is gone at its next start. So whatever goes wrong, those on trial are restarted, and go back.

use super::commission::Known;
use super::contact::{Contact, Seat, TIMES};
use super::deadline::Deadline;
use super::member::check_identity;
use super::task::{Outside, Task};
use super::{HubError, Patience, Received, STOP};
use funnelnet_protocol::serial;
use funnelnet_protocol::service::{Identity, Reply};
use funnelnet_protocol::update::{Block, Checksum, Image, MAX_BLOCK, Reply as Answer};
use funnelnet_protocol::update::{Request, Status, UpdateError};
use std::fmt;
use std::time::Duration;

/// How often a block is sent until a node has it.
const BLOCK_TIMES: u32 = 10;
/// A node that says that its trial takes more ticks than this is not believed.
const MOST_TICKS: u32 = 10_000;
/// The least time that is left for a node, after others have used up theirs.
const LEAST: Duration = Duration::from_secs(1);

/// Which program a node has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Has {
    /// The one that it had.
    Old,
    /// Another one than the new one, on trial.
    Another,
    /// It was told to swap, or says on trial that it is on trial no more: only a look tells which one it has.
    Told,
    /// The new one, on trial.
    OnTrial,
    /// The new one, for good.
    New,
}

/// A node that has the new program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Updated {
    /// Its id in the bench file.
    pub node: u8,
    /// What it was reached by.
    pub place: String,
    /// Who it said it was, before.
    pub before: Identity,
    /// Who it says it is now.
    pub after: Identity,
    /// It had the new program before.
    pub had_it: bool,
    /// Blocks that had to be sent again.
    pub repeated: u32,
}

impl fmt::Display for Updated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, place, before, after, had_it, repeated } = self;
        let version = |identity: &Identity| identity.firmware.map(|part| part.to_string()).join(".");
        write!(f, "node {node}: {place}, uid = \"{:016x}\": ", after.uid)?;
        match had_it {
            true => write!(f, "had it already, firmware {}", version(after))?,
            false => {
                write!(f, "has the new program, firmware {} (before: {})", version(after), version(before))?
            }
        }
        match repeated {
            0 => Ok(()),
            times => write!(f, "; blocks that were sent again: {times}"),
        }
    }
}

/// Nodes that are being updated.
pub struct Update {
    outside: Outside,
    nodes: Vec<Candidate>,
    patience: Patience,
    /// For the way from the answer to a swap to the first answer of what runs then.
    swap: Duration,
    image: Image,
}

struct Candidate {
    contact: Contact,
    uid: Option<u64>,
    before: Identity,
    after: Identity,
    has: Has,
    had_it: bool,
    /// Ticks that its trial still takes.
    ticks_left: u32,
    repeated: u32,
}

impl Update {
    /// Of nodes in these seats, to this program.
    pub fn new(seats: Vec<Seat>, patience: Patience, swap: Duration, image: Image) -> Self {
        let outside = Outside::default();
        let candidate = |(index, Seat { id, place, uid }): (usize, Seat)| Candidate {
            contact: Contact::new(index, id, place, &outside),
            uid,
            before: Identity::default(),
            after: Identity::default(),
            has: Has::Old,
            had_it: false,
            ticks_left: 0,
            repeated: 0,
        };
        let nodes = seats.into_iter().enumerate().map(candidate).collect();
        Self { outside, nodes, patience, swap, image }
    }

    /// Asks each node who it is and which program it has, and stops it if it runs. Nothing else has changed then.
    ///
    /// Its error: a node that does not answer in time, another wire version, another chip, an interrupt; or all
    /// nodes that cannot take this program.
    pub fn meet(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let mut unable = Vec::new();
            for node in &mut self.nodes {
                if let Some(why) = node.meet(self.patience, &self.image).await? {
                    unable.push((node.contact.id(), why));
                }
            }
            if !unable.is_empty() {
                return Err(HubError::CannotUpdate { nodes: unable });
            }
            if !self.trials_are_even() {
                let on_trial = self.nodes.iter_mut().filter(|node| node.has == Has::OnTrial);
                on_trial.for_each(|node| node.has = Has::Another);
            }
            Ok(())
        })
    }

    /// Whether those on trial with the new program can go on with it: all complete their last tick together. One
    /// that is ahead would stay before the others have shown that they can.
    fn trials_are_even(&self) -> bool {
        let left = || self.nodes.iter().filter(|node| node.has == Has::OnTrial).map(|node| node.ticks_left);
        let (least, most) = (left().min().unwrap_or(0), left().max().unwrap_or(0));
        let is_alone = self.nodes.iter().all(|node| matches!(node.has, Has::OnTrial | Has::New));
        is_alone && most - least <= 1
    }

    /// Restarts those that are on trial with another program, or are ahead of others, which is the end of that.
    ///
    /// `ended` gets the ids of those that have gone back. Its error: a node that does not, or an interrupt; what is known of each is in
    /// [`Self::known`] then.
    pub fn end_other_trials<'a>(&'a mut self, ended: &'a mut Vec<u8>) -> Task<'a, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::Another) {
                node.has = Has::Told;
                let restarted = node.restart(self.patience).await;
                if let Err(HubError::NotTaken { .. }) = restarted {
                    // Who refuses has not restarted.
                    node.has = Has::Another;
                }
                restarted?;
                let status = node.look(self.swap, self.patience, self.image.length).await?;
                node.note(&status, &self.image);
                match node.has {
                    Has::Old => {}
                    // The new program is what it had before that trial.
                    Has::New => node.had_it = true,
                    Has::Told | Has::OnTrial | Has::Another => {
                        return Err(HubError::StaysOnTrial { node: node.contact.id() });
                    }
                }
                ended.push(node.contact.id());
            }
            Ok(())
        })
    }

    /// What is known of each before any is told to swap: one that was told to end an earlier trial may be back or not.
    pub fn known(&self) -> Known {
        Known {
            done: Vec::new(),
            unsure: self.ids(|node| node.has == Has::Told),
            unchanged: self.ids(|node| node.has != Has::Told),
        }
    }

    /// Announces the program to those that need it.
    ///
    /// Its error: nothing has changed on any node.
    pub fn begin(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::Old) {
                let begun = |answer| if let Answer::Begun(outcome) = answer { Some(outcome) } else { None };
                node.ask(&Request::Begin(self.image), "announcement", self.patience, begun).await?;
            }
            Ok(())
        })
    }

    /// Sends the bytes of the program from `offset` on to those that need it, and waits until each has written them.
    ///
    /// Its error: nothing has changed on any node.
    pub fn send<'a>(&'a mut self, offset: u32, bytes: &'a [u8]) -> Task<'a, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let crc = Checksum::of(bytes);
            let block = Block { offset, crc, bytes: bytes.iter().copied().take(MAX_BLOCK).collect() };
            let block = Request::Block(block);
            // To all of them before the first answer: their lines are busy at the same time.
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::Old) {
                node.contact.request(&block).await?;
            }
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::Old) {
                node.await_written(&block, self.patience).await?;
            }
            Ok(())
        })
    }

    /// Has each node read back what it has written.
    ///
    /// Its error: nothing has changed on any node.
    pub fn check(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::Old) {
                let checked =
                    |answer| if let Answer::Checked(outcome) = answer { Some(outcome) } else { None };
                node.ask(&Request::Check, "check", self.patience, checked).await?;
            }
            Ok(())
        })
    }

    /// Tells each to swap. One whose answer is lost may have done it.
    ///
    /// Its error: some may have swapped.
    pub fn swap(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::Old) {
                node.swap(self.patience).await?;
            }
            Ok(())
        })
    }

    /// Waits until each of those is back with the new program.
    ///
    /// Its error: the first one that is not.
    pub fn await_new(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let deadline = Deadline::after(self.swap, self.outside.now());
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::Told) {
                let limit = left(&deadline, &self.outside);
                node.await_new(limit, self.patience, &self.image).await?;
            }
            Ok(())
        })
    }

    /// Asks those on trial, which may be running, how many ticks it still takes; the most.
    ///
    /// Its error: a node that does not answer, or is not what it was.
    pub fn ticks_left(&mut self) -> Task<'_, Result<u32, HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let mut most = 0;
            for node in self.nodes.iter_mut().filter(|node| node.has == Has::OnTrial) {
                let status = node.status(0, self.patience).await?;
                if !status.on_trial {
                    // It has completed its trial, or was reset and has gone back.
                    node.has = Has::Told;
                }
                node.ticks_left = status.ticks_left;
                if status.ticks_left > MOST_TICKS {
                    return Err(HubError::NotConfirmed { node: node.contact.id(), left: status.ticks_left });
                }
                most = most.max(status.ticks_left);
            }
            Ok(most)
        })
    }

    /// Whether each that was given the program is on trial still, with at most so many ticks left, as it said last.
    ///
    /// Its error: the first one that is not.
    pub fn check_trials(&self, most: u32) -> Result<(), HubError> {
        self.nodes.iter().filter(|node| !node.had_it).try_for_each(|node| {
            let (id, left) = (node.contact.id(), node.ticks_left);
            match node.has {
                Has::OnTrial if left > most => Err(HubError::NotConfirmed { node: id, left }),
                Has::OnTrial | Has::New => Ok(()),
                Has::Old | Has::Another | Has::Told => Err(HubError::OldProgram { node: id }),
            }
        })
    }

    /// Restarts all, once the trial is completed, so that they have the configurations that they keep, and looks
    /// whether the program stays. Those that had it before have run the trial, too.
    ///
    /// Its error: a node that does not, or does not come back.
    pub fn restart(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            for node in &mut self.nodes {
                // Stopped, and asked for the last time: else it would go back.
                let status = node.look(self.swap, self.patience, self.image.length).await?;
                node.note(&status, &self.image);
                let id = node.contact.id();
                match node.has {
                    Has::New => {}
                    Has::Old | Has::Told => return Err(HubError::OldProgram { node: id }),
                    Has::OnTrial | Has::Another => {
                        return Err(HubError::NotConfirmed { node: id, left: node.ticks_left });
                    }
                }
                node.restart(self.patience).await?;
            }
            let deadline = Deadline::after(self.swap, self.outside.now());
            for node in &mut self.nodes {
                let status =
                    node.look(left(&deadline, &self.outside), self.patience, self.image.length).await?;
                node.note(&status, &self.image);
                if node.has != Has::New {
                    return Err(HubError::OldProgram { node: node.contact.id() });
                }
            }
            Ok(())
        })
    }

    /// Restarts all that are on trial, and waits until they are back with what they had; what is known of each
    /// node then. Where the trial has been `configured`, those that have the program for good are restarted, too.
    pub fn go_back(&mut self, configured: bool) -> Task<'_, Known> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let deadline = Deadline::after(self.swap, self.outside.now());
            // All are told before the first one is waited for.
            for node in self.nodes.iter_mut().filter(|node| node.may_go_back()) {
                let limit = left(&deadline, &self.outside);
                let _ = node.end_trial(limit, self.patience, &self.image).await;
            }
            let deadline = Deadline::after(self.swap, self.outside.now());
            let mut known = Known::default();
            for node in &mut self.nodes {
                let id = node.contact.id();
                if node.may_go_back() {
                    let mut looks = 0;
                    let limit = |outside| left(&deadline, outside);
                    while node.may_go_back() && looks < TIMES {
                        looks += 1;
                        let limit = limit(&self.outside);
                        if node.end_trial(limit, self.patience, &self.image).await.is_err() {
                            break;
                        }
                    }
                }
                match node.has {
                    _ if node.had_it => known.unchanged.push(id),
                    Has::Old => known.unchanged.push(id),
                    Has::New => known.done.push(id),
                    Has::Told | Has::OnTrial | Has::Another => known.unsure.push(id),
                }
            }
            // They have the configuration of the trial still.
            let stays = |node: &&mut Candidate| configured && node.has == Has::New;
            for node in self.nodes.iter_mut().filter(stays) {
                let limit = left(&deadline, &self.outside);
                if node.look(limit, self.patience, self.image.length).await.is_ok() {
                    let _ = node.restart(self.patience).await;
                }
            }
            for node in self.nodes.iter_mut().filter(stays) {
                let limit = left(&deadline, &self.outside);
                let _ = node.look(limit, self.patience, self.image.length).await;
            }
            known
        })
    }

    /// Bytes that each node that needs the program has to be sent; 0 where none does.
    pub fn bytes_to_send(&self) -> u32 {
        if self.nodes.iter().any(|node| node.has == Has::Old) { self.image.length } else { 0 }
    }

    /// Whether all have the new program for good.
    pub fn is_done(&self) -> bool {
        self.nodes.iter().all(|node| node.has == Has::New)
    }

    /// Ids of those that are on trial.
    pub fn on_trial(&self) -> Vec<u8> {
        self.ids(|node| node.has == Has::OnTrial)
    }

    /// Ids of those that need the program.
    pub fn in_need(&self) -> Vec<u8> {
        self.ids(|node| node.has == Has::Old)
    }

    fn ids(&self, which: impl Fn(&Candidate) -> bool) -> Vec<u8> {
        self.nodes.iter().filter(|node| which(node)).map(|node| node.contact.id()).collect()
    }

    /// What came of each node, once all have the program.
    pub fn updated(&self) -> Vec<Updated> {
        let updated = |node: &Candidate| Updated {
            node: node.contact.id(),
            place: node.contact.place().to_owned(),
            before: node.before,
            after: node.after,
            had_it: node.had_it,
            repeated: node.repeated,
        };
        self.nodes.iter().map(updated).collect()
    }
}

impl Candidate {
    /// Why it cannot take the program, where it cannot.
    async fn meet(&mut self, patience: Patience, image: &Image) -> Result<Option<String>, HubError> {
        self.before = self.contact.identify(patience.boot).await?;
        self.after = self.before;
        check_identity(&self.contact, &self.before, self.uid)?;
        if self.before.id != serial::HOST {
            // It may run still; then it would refuse.
            self.contact.write(&serial::encode(&STOP)).await?;
        }
        let status = match self.look(patience.boot, patience, image.length).await {
            // It does say who it is: these frames alone are unknown to it.
            Err(HubError::NoAnswer { awaited: STATUS, .. }) => {
                return Ok(Some(
                    "its image takes no updates: it was built without the feature `update`".to_owned(),
                ));
            }
            status => status?,
        };
        if status.room == 0 {
            return Ok(Some("it has no boot loader that could swap programs".to_owned()));
        }
        if status.board != image.board {
            return Ok(Some(format!("it is another board, {:08x}, than the program is for", status.board)));
        }
        if status.room < image.length {
            let (length, room) = (image.length, status.room);
            return Ok(Some(format!("it has room for {room} bytes, and the program has {length}")));
        }
        self.note(&status, image);
        self.had_it = self.has == Has::New;
        Ok(None)
    }

    fn note(&mut self, status: &Status, image: &Image) {
        self.ticks_left = status.ticks_left;
        self.has = match (status.crc == image.crc, status.on_trial) {
            (true, true) => Has::OnTrial,
            (true, false) => Has::New,
            (false, true) => Has::Another,
            (false, false) => Has::Old,
        };
    }

    /// Whether it may have the new program, and lose it again.
    fn may_go_back(&self) -> bool {
        matches!(self.has, Has::Told | Has::OnTrial)
    }

    /// Waits until it says who it is, and then how it is; one that runs is stopped, since it does not say which
    /// program it has.
    async fn look(&mut self, limit: Duration, patience: Patience, length: u32) -> Result<Status, HubError> {
        self.after = self.contact.identify(limit).await?;
        let mut status = self.status(length, patience).await?;
        for _ in 0..TIMES {
            if status.crc != 0 || status.room == 0 {
                return Ok(status);
            }
            self.contact.write(&serial::encode(&STOP)).await?;
            status = self.status(length, patience).await?;
        }
        let node = self.contact.id();
        Err(HubError::NotTaken { node, what: "stop", reason: UpdateError::Running })
    }

    async fn status(&mut self, length: u32, patience: Patience) -> Result<Status, HubError> {
        let request = Request::Status { length };
        let pick = |answer| if let Answer::Status(status) = answer { Some(Ok(status)) } else { None };
        self.ask(&request, STATUS, patience, pick).await
    }

    /// Sends a request that may be repeated, and waits for its answer.
    async fn ask<T>(
        &mut self,
        request: &Request,
        what: &'static str,
        patience: Patience,
        mut pick: impl FnMut(Answer) -> Option<Result<T, UpdateError>>,
    ) -> Result<T, HubError> {
        let limits = (patience.answer, patience.answer / TIMES);
        let outcome = self.contact.ask(request, limits, what, |received| pick(answer(received)?)).await?;
        outcome.map_err(|reason| HubError::NotTaken { node: self.contact.id(), what, reason })
    }

    /// Waits until a block that was sent is written, and sends it again where it, or its answer, was lost or spoilt.
    async fn await_written(&mut self, block: &Request, patience: Patience) -> Result<(), HubError> {
        let Request::Block(Block { offset, bytes, .. }) = block else { return Ok(()) };
        let (node, offset, next) = (self.contact.id(), *offset, *offset + bytes.len() as u32);
        // An answer that says less belongs to a block before, which was sent twice.
        let pick = |received| match answer(received)? {
            Answer::Written(Ok(at)) if at < next => None,
            Answer::Written(outcome) => Some(outcome),
            _ => None,
        };
        let every = patience.answer / TIMES;
        for _ in 1..BLOCK_TIMES {
            match self.contact.wait_for(every, BLOCK, pick).await {
                Ok(Ok(_)) => return Ok(()),
                Ok(Err(UpdateError::Order { next: found })) if found == next => return Ok(()),
                // Spoilt on its way.
                Ok(Err(UpdateError::Block)) | Err(HubError::NoAnswer { .. }) => {}
                Ok(Err(UpdateError::Order { next: found })) if found == offset => {}
                Ok(Err(reason)) => return Err(HubError::NotTaken { node, what: BLOCK, reason }),
                Err(error) => return Err(error),
            }
            self.repeated = self.repeated.saturating_add(1);
            self.contact.request(block).await?;
        }
        match self.contact.wait_for(every, BLOCK, pick).await? {
            Ok(_) => Ok(()),
            Err(reason) => Err(HubError::NotTaken { node, what: BLOCK, reason }),
        }
    }

    async fn swap(&mut self, patience: Patience) -> Result<(), HubError> {
        self.has = Has::Told;
        self.contact.request(&Request::Swap).await?;
        let pick = |received| match answer(received)? {
            Answer::Restarts(outcome) => Some(outcome),
            _ => None,
        };
        match self.contact.wait_for(patience.answer / TIMES, "swap", pick).await {
            // Whether it was heard shows when it is back.
            Ok(Ok(())) | Err(HubError::NoAnswer { .. }) => Ok(()),
            Ok(Err(reason)) => Err(HubError::NotTaken { node: self.contact.id(), what: "swap", reason }),
            Err(error) => Err(error),
        }
    }

    async fn await_new(
        &mut self,
        limit: Duration,
        patience: Patience,
        image: &Image,
    ) -> Result<(), HubError> {
        for _ in 0..TIMES {
            let status = self.look(limit, patience, image.length).await?;
            // What has come is forgotten in a restart: it has not heard that it was to swap.
            if status.is_checked && status.crc != image.crc {
                self.swap(patience).await?;
                continue;
            }
            self.note(&status, image);
            break;
        }
        match self.has {
            Has::OnTrial | Has::New => Ok(()),
            _ => Err(HubError::OldProgram { node: self.contact.id() }),
        }
    }

    async fn restart(&mut self, patience: Patience) -> Result<(), HubError> {
        let pick = |answer| if let Answer::Restarts(outcome) = answer { Some(outcome) } else { None };
        self.ask(&Request::Restart, "restart", patience, pick).await
    }

    /// Looks at it, and restarts it if it is on trial.
    async fn end_trial(
        &mut self,
        limit: Duration,
        patience: Patience,
        image: &Image,
    ) -> Result<(), HubError> {
        let status = self.look(limit, patience, image.length).await?;
        self.note(&status, image);
        match self.has {
            Has::OnTrial | Has::Another => {
                self.has = Has::Told;
                self.restart(patience).await
            }
            _ => Ok(()),
        }
    }
}

/// What is awaited, as an error calls it.
const STATUS: &str = "answer about its programs";
const BLOCK: &str = "block";

fn answer(received: Received) -> Option<Answer> {
    match received {
        Received::Reply(Reply::Update(answer)) => Some(answer),
        _ => None,
    }
}

/// What others have left of a time.
fn left(deadline: &Deadline, outside: &Outside) -> Duration {
    Duration::from_nanos(deadline.end.saturating_sub(outside.now())).max(LEAST)
}
