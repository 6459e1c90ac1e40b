//! The app of every board: `funnelnet_app` on a chip, with the board's clock and defmt's log.

use funnelnet_app::link::Health;
use funnelnet_app::storage::Storage;
use funnelnet_app::watchdog::{Absent, Watchdog};
use funnelnet_app::{App, Link, Log, Platform};
use funnelnet_link::Change;
use funnelnet_node::{Event, Model, Session};
use funnelnet_plant::{Failure, Plant};
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::config::ConfigError;
use funnelnet_protocol::service::{Identity, ResetCause};
use static_cell::StaticCell;

#[cfg(not(feature = "_nrf52840"))]
pub(crate) use crate::clock::Embassy as BoardClock;
#[cfg(feature = "_nrf52840")]
pub(crate) use crate::nrf::clock::Micros as BoardClock;
use crate::reset::Start;

pub use funnelnet_app::SessionOf;

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

/// Runs a node on `link` that measures and drives `plant`, with what `storage` keeps for it; its session is
/// made in `session`.
///
/// Pin it where it is made, `pin!(app::run(..)).await`: else some images move it through the stack and keep
/// room for that as long as it runs.
///
/// # Panics
/// `session` is taken.
pub async fn run<P: Plant>(
    session: &'static StaticCell<SessionOf<P>>,
    link: &mut impl Link,
    storage: &mut impl Storage,
    plant: P,
    chip: Chip<impl Watchdog>,
) -> ! {
    let Chip { uid, start, watchdog } = chip;
    let Start { reset, starts, .. } = start;
    let identity =
        Identity { wire_version: WIRE_VERSION, firmware: VERSION, uid, reset, starts, ..Identity::default() };
    let session = make(session, identity, plant.model());
    let platform = Platform { watchdog, clock: BoardClock, log: Defmt { start } };
    let mut app = App::new(session, link, storage, plant, platform);
    app.run().await
}

/// A session in its place.
// Not into its caller, whose frame would keep room for moving it as long as the node runs.
#[inline(never)]
fn make<M: Model>(
    place: &'static StaticCell<Session<M>>,
    identity: Identity,
    model: M,
) -> &'static mut Session<M> {
    place.init_with(|| Session::with_model(identity, model))
}

/// The log of defmt.
struct Defmt {
    start: Start,
}

impl Log for Defmt {
    fn ready(&mut self) {
        let Start { reset, starts, place } = self.start;
        defmt::info!("ready, wire version {=u8}", WIRE_VERSION);
        defmt::info!("start {=u32}, last reset: {} at {=u32:#x}", starts, reset, place);
    }

    fn restored(&mut self, id: u8) {
        defmt::info!("configured from storage: node {=u8}", id);
    }

    fn unusable(&mut self, _: ConfigError) {
        defmt::error!("the stored configuration is out of range");
    }

    fn event(&mut self, event: &Event) {
        defmt::info!("{}", event);
    }

    fn link(&mut self, change: Change, health: Health) {
        defmt::warn!("link: {}, {}", change, health);
    }

    fn not_measured(&mut self, why: Failure) {
        defmt::warn!("sample: {}", why);
    }

    fn not_driven(&mut self, why: Failure) {
        defmt::error!("input: {}", why);
    }

    fn not_safe(&mut self, why: Failure) {
        defmt::error!("safe output: {}", why);
    }
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
