//! The loop of every node: it waits for the link or for the next tick, and does what the session asks for.

use embassy_futures::select::select;
use funnelnet_link::{Change, Filters};
use funnelnet_node::watchdog::FEED_EVERY_NS;
use funnelnet_node::{Output, Session};
use funnelnet_plant::Plant;
use funnelnet_protocol::message::FaultCode;

#[cfg(feature = "update")]
use funnelnet_node::Phase;
#[cfg(feature = "update")]
use funnelnet_protocol::{
    Reply, refusal::Refusal, serial::Frame, service::Body, update::Request, update::UPDATE,
};

use crate::clock::Clock;
use crate::link::{Input, Link};
use crate::log::Log;
use crate::storage::Storage;
use crate::watchdog::{Guard, Watchdog};

/// Longest time that a frame takes, ns: on an RP2040, from the driver's buffer on.
const FRAME_NS: u64 = 25_000;

/// Time that an answer has to leave before a restart, ns.
#[cfg(feature = "update")]
const FAREWELL_NS: u64 = 50_000_000;

/// The session of a node with this plant.
pub type SessionOf<P> = Session<<P as Plant>::Model>;

/// The rest of a platform, beside link, storage and plant.
pub struct Platform<W, C, G> {
    /// Its watchdog, not started yet.
    pub watchdog: W,
    /// Its clock.
    pub clock: C,
    /// Its log.
    pub log: G,
}

/// A node: a session on a link, with a storage and a plant, on a platform.
///
/// What is large is passed by reference: a future that holds it is moved through the stack whenever another
/// one awaits it.
pub struct App<'a, P: Plant, L, S, W, C, G> {
    session: &'a mut SessionOf<P>,
    link: &'a mut L,
    storage: &'a mut S,
    plant: P,
    guard: Guard<W>,
    clock: C,
    log: G,
    /// The [changes](Session::changes) of the configuration that the link listens for.
    listens_since: u8,
}

impl<'a, P: Plant, L: Link, S: Storage, W: Watchdog, C: Clock, G: Log> App<'a, P, L, S, W, C, G> {
    /// A node that has not begun. The session is a new one, with the model of this plant.
    pub fn new(
        session: &'a mut SessionOf<P>,
        link: &'a mut L,
        storage: &'a mut S,
        plant: P,
        platform: Platform<W, C, G>,
    ) -> Self {
        let Platform { watchdog, clock, log } = platform;
        Self { session, link, storage, plant, guard: Guard::new(watchdog), clock, log, listens_since: 0 }
    }

    /// Runs the node for ever.
    pub async fn run(&mut self) -> ! {
        self.begin().await;
        loop {
            self.step().await;
        }
    }

    /// Makes the output safe, then a node of what the storage keeps; starts the watchdog.
    async fn begin(&mut self) {
        // Before anything else: the session asks for a safe output.
        self.drain().await;
        self.log.ready();
        self.restore().await;
        self.guard.start();
    }

    /// A node that has been commissioned is ready at once. One whose configuration cannot be used is blank,
    /// and can be commissioned anew.
    async fn restore(&mut self) {
        self.session.note_key(self.storage.has_key().await);
        self.storage.load(self.session.config_buffer()).await;
        if self.session.config_buffer().is_none() {
            return;
        }
        match self.session.restore() {
            Ok(()) => self.log.restored(self.session.id()),
            Err(why) => self.log.unusable(why),
        }
    }

    /// Waits for the link or for the next tick, and does what follows.
    async fn step(&mut self) {
        // The watchdog wants to see the loop come round.
        let latest = self.clock.now() + FEED_EVERY_NS;
        let at = self.session.poll_at().map_or(latest, |at| at.min(latest));
        select(self.link.wait(self.clock), self.clock.wait_until(at)).await;
        self.session.note_losses(self.link.health().losses);
        loop {
            self.await_tick().await;
            let now = self.clock.now();
            match self.link.next(now) {
                #[cfg(feature = "update")]
                Some(Input::Frame(Ok(Frame::Service { kind: UPDATE, body, .. }))) => {
                    let request = Request::decode(UPDATE, body);
                    self.update(request, now).await;
                }
                Some(Input::Frame(frame)) => self.session.on_frame(frame, now),
                Some(Input::Sync(sync, at)) => self.session.on_sync(&sync, at, now),
                Some(Input::Change(change)) => self.on_change(change),
                None => break,
            }
            self.drain().await;
            // Here, too: a line that never falls silent keeps the loop in here, and the ticks run.
            self.look();
        }
        self.drain().await;
        self.look();
        #[cfg(feature = "update")]
        self.storage.note_ticks(self.session.progress().completed).await;
    }

    /// Lets a frame wait for a tick that is due sooner than it is read, or just now: ticks are nearly as even as on a silent line.
    async fn await_tick(&mut self) {
        let (now, due) = (self.clock.now(), self.session.poll_at().unwrap_or(u64::MAX));
        if now.abs_diff(due) < FRAME_NS {
            if due > now {
                self.clock.wait_until(due).await;
            }
            self.drain().await;
        }
    }

    /// A node that its bus has lost does not go on alone: it stops, with a safe output, until it is
    /// configured anew.
    fn on_change(&mut self, change: Change) {
        self.log.link(change, self.link.health());
        if let Change::Off { count, .. } = change {
            self.session.fail(FaultCode::BUS_OFF, count);
        }
    }

    /// Puts everything that the session has to say on the link, into the log and into the storage, and does
    /// what it asks of the plant.
    async fn drain(&mut self) {
        loop {
            let now = self.clock.now();
            let Some(output) = self.session.poll(now) else { return self.listen() };
            match output {
                Output::Send(message) => self.link.send(&message, now).await,
                Output::Sync(message) => {
                    self.link.send(&message, now).await;
                    let sent = self.link.sent_at().unwrap_or_else(|| self.clock.now());
                    self.session.sync_sent(sent);
                }
                Output::Reply(reply) => self.link.reply(&reply, self.session.id()).await,
                Output::Report(event) => self.log.event(&event),
                Output::StorageRequest => self.keep().await,
                Output::Sample => self.sample(),
                Output::Actuate => self.actuate(),
                Output::Safe => self.make_safe(),
            }
        }
    }

    /// Has the link let in what the configuration says that others say to this node.
    fn listen(&mut self) {
        if self.listens_since == self.session.changes() {
            return;
        }
        self.listens_since = self.session.changes();
        if let Some(config) = self.session.config() {
            self.link.listen(Filters::new(config.id, &config.neighbours));
        }
    }

    /// The session is told either way, and counts what fails.
    fn sample(&mut self) {
        match self.plant.measure() {
            Ok(x) => self.session.measured(&x),
            Err(failure) => {
                self.log.not_measured(failure);
                self.session.sample_failed();
            }
        }
    }

    /// A node that cannot drive its plant stops: its neighbours must not rely on it.
    fn actuate(&mut self) {
        if let Err(failure) = self.plant.actuate(self.session.inputs()) {
            self.log.not_driven(failure);
            self.session.fail(FaultCode::PLANT, 0);
        }
    }

    fn make_safe(&mut self) {
        if let Err(failure) = self.plant.safe() {
            self.log.not_safe(failure);
        }
    }

    async fn keep(&mut self) {
        if let Some(task) = self.session.task() {
            let outcome = self.storage.perform(task).await;
            self.session.performed(outcome);
        }
    }

    fn look(&mut self) {
        self.guard.look(self.session.progress(), self.clock.now());
    }

    /// Has the storage do what a host asks for the next program; restarts where that is to follow.
    #[cfg(feature = "update")]
    async fn update(&mut self, request: Result<Request, Refusal>, now: u64) {
        let request = match request {
            Ok(request) => request,
            Err(refusal) => return self.session.on_frame(Err(refusal), now),
        };
        let is_running = self.session.node().is_some_and(|node| node.phase() == Phase::Running);
        let reply = self.storage.update(&request, is_running).await;
        self.link.reply(&Reply::Update(reply), self.session.id()).await;
        if self.storage.wants_restart() {
            // The answer is on its way.
            self.clock.wait_until(self.clock.now() + FAREWELL_NS).await;
            self.make_safe();
            self.storage.restart();
        }
    }
}
