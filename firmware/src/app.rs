//! The app of every board: a session on a link, and a plant. It moves frames, time, samples and inputs; the core decides.

use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use funnelnet_link::Change;
use funnelnet_node::watchdog::FEED_EVERY_NS;
use funnelnet_node::{Model, Output, Session};
use funnelnet_plant::Plant;
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::message::FaultCode;
use funnelnet_protocol::service::{Identity, ResetCause};
use static_cell::StaticCell;

use crate::link::{Input, Link};
use crate::reset::Start;
use crate::storage::Storage;
use crate::watchdog::{Absent, Guard, Watchdog};

/// What a node's chip gives it.
pub struct Chip<W> {
    /// Its unique number, 0 where it has none.
    pub uid: u64,
    /// What is known of its start.
    pub start: Start,
    /// Its watchdog.
    pub watchdog: W,
}

impl Chip<Absent> {
    /// Nothing is known of it.
    pub const UNKNOWN: Self =
        Self { uid: 0, start: Start { reset: ResetCause::Unknown, starts: 0, place: 0 }, watchdog: Absent };
}

/// The session of a node with this plant.
pub type SessionOf<P> = Session<<P as Plant>::Model>;

/// Runs a node on `link` that measures and drives `plant`, with what `storage` keeps for it; its session is made in `session`.
///
/// What is large is passed by reference: a future that holds it is moved through the stack whenever another one awaits it.
///
/// # Panics
/// `session` is taken.
pub async fn run<P: Plant>(
    session: &'static StaticCell<SessionOf<P>>,
    link: &mut impl Link,
    storage: &mut impl Storage,
    mut plant: P,
    chip: Chip<impl Watchdog>,
) -> ! {
    let Chip { uid, start: Start { reset, starts, place }, watchdog } = chip;
    let identity =
        Identity { wire_version: WIRE_VERSION, firmware: VERSION, uid, reset, starts, ..Identity::default() };
    let session = session.init_with(|| Session::with_model(identity, plant.model()));
    // Before anything else: the session asks for a safe output.
    drain(session, link, storage, &mut plant).await;
    defmt::info!("ready, wire version {=u8}", WIRE_VERSION);
    defmt::info!("start {=u32}, last reset: {} at {=u32:#x}", starts, reset, place);
    restore(session, storage).await;
    let mut guard = Guard::start(watchdog);
    loop {
        step(session, link, storage, &mut plant, &mut guard).await;
    }
}

/// A node that has been commissioned is ready at once. One whose configuration cannot be used is blank, and can be commissioned anew.
async fn restore<M: Model>(session: &mut Session<M>, storage: &mut impl Storage) {
    session.note_key(storage.has_key().await);
    storage.load(session.config_buffer()).await;
    if session.config_buffer().is_none() {
        return;
    }
    match session.restore() {
        Ok(()) => defmt::info!("configured from storage: node {=u8}", session.id()),
        Err(_) => defmt::error!("the stored configuration is out of range"),
    }
}

/// Waits for the link or for the next tick, and does what follows.
async fn step<L: Link, S: Storage, P: Plant>(
    session: &mut Session<P::Model>,
    link: &mut L,
    storage: &mut S,
    plant: &mut P,
    guard: &mut Guard<impl Watchdog>,
) {
    // The watchdog wants to see the loop come round.
    let latest = now() + FEED_EVERY_NS;
    let at = session.poll_at().map_or(latest, |at| at.min(latest));
    select(link.wait(), Timer::at(instant(at))).await;
    while let Some(input) = link.next() {
        match input {
            Input::Frame(frame) => session.on_frame(frame, now()),
            Input::Change(change) => on_change(session, link, change),
        }
        drain(session, link, storage, plant).await;
        // Here, too: a line that never falls silent keeps the loop in here, and the ticks run.
        guard.look(session.progress(), now());
    }
    drain(session, link, storage, plant).await;
    guard.look(session.progress(), now());
}

/// A node that its bus has lost does not go on alone: it stops, with a safe output, until it is configured anew.
fn on_change<L: Link, M: Model>(session: &mut Session<M>, link: &L, change: Change) {
    defmt::warn!("link: {}, {}", change, link.health());
    if let Change::Off { count, .. } = change {
        session.fail(FaultCode::BUS_OFF, count);
    }
}

/// Puts everything that the session has to say on the link, into the log and into the storage, and does what it asks of the plant.
async fn drain<L: Link, S: Storage, P: Plant>(
    session: &mut Session<P::Model>,
    link: &mut L,
    storage: &mut S,
    plant: &mut P,
) {
    while let Some(output) = session.poll(now()) {
        match output {
            Output::Send(message) => link.send(&message).await,
            Output::Reply(reply) => link.reply(&reply, session.id()).await,
            Output::Report(event) => defmt::info!("{}", event),
            Output::StorageRequest => keep(session, storage).await,
            Output::Sample => sample(session, plant),
            Output::Actuate => actuate(session, plant),
            Output::Safe => make_safe(plant),
        }
    }
}

/// The session is told either way, and counts what fails.
fn sample<P: Plant>(session: &mut Session<P::Model>, plant: &mut P) {
    match plant.measure() {
        Ok(x) => session.measured(&x),
        Err(failure) => {
            defmt::warn!("sample: {}", failure);
            session.sample_failed();
        }
    }
}

/// A node that cannot drive its plant stops: its neighbours must not rely on it.
fn actuate<P: Plant>(session: &mut Session<P::Model>, plant: &mut P) {
    if let Err(failure) = plant.actuate(session.inputs()) {
        defmt::error!("input: {}", failure);
        session.fail(FaultCode::PLANT, 0);
    }
}

fn make_safe(plant: &mut impl Plant) {
    if let Err(failure) = plant.safe() {
        defmt::error!("safe output: {}", failure);
    }
}

async fn keep<M: Model>(session: &mut Session<M>, storage: &mut impl Storage) {
    if let Some(task) = session.task() {
        let outcome = storage.perform(task).await;
        session.performed(outcome);
    }
}

/// Time since the start, ns.
fn now() -> u64 {
    Instant::now().as_micros() * 1000
}

/// An instant of the clock at or after `at` (ns), or an earlier one where that is more than four seconds away: a
/// node that is polled early does nothing. So the division is one of 32 bits, which is an instruction.
fn instant(at: u64) -> Instant {
    let now = Instant::now();
    let wait_ns = at.saturating_sub(now.as_micros() * 1000);
    let wait_us = u32::try_from(wait_ns).unwrap_or(u32::MAX).div_ceil(1000);
    now + Duration::from_micros(wait_us.into())
}

/// The version of this package: major, minor, patch.
const VERSION: [u8; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

/// A decimal number, read at compile time.
#[allow(clippy::panic)]
const fn number(text: &str) -> u8 {
    match u8::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => panic!("a version has parts of 0 to 255"),
    }
}
