//! One `main` for every board: a board hands over its [`Parts`], and [`node!`](crate::node) makes a virtual node of them.
//!
//! What is large (link, storage, session) is made where it stays, in statics of the binary: it does not go through the task's future.

use core::sync::atomic::AtomicU32;

use embedded_io_async::{Read, Write};
use funnelnet_app::Link;
use funnelnet_app::link::can::{CanNode, Controller};
use funnelnet_app::link::peers::Peers;
use funnelnet_app::link::serial::Serial;
use funnelnet_link::Forwarder;
use static_cell::{ConstStaticCell, StaticCell};

use crate::app::Chip;
use crate::storage::Medium;

#[cfg(feature = "_hardware")]
use defmt_rtt as _;
#[cfg(feature = "_mps2")]
use defmt_semihosting as _;

/// What a board gives its node.
pub struct Parts<L, M, W> {
    /// Its lines: [`OnLine`], [`OnCan`] or [`ToPeers`].
    pub lines: L,
    /// What its configuration is kept on.
    pub storage: M,
    /// Number, start and watchdog.
    pub chip: Chip<W>,
}

/// Names of a board's parts, by the name of all of them.
pub trait Board {
    /// Its lines.
    type Lines: Lines;
    /// What its configuration is kept on.
    type Medium: Medium;
    /// Its watchdog.
    type Watchdog;
}

impl<L: Lines, M: Medium, W> Board for Parts<L, M, W> {
    type Lines = L;
    type Medium = M;
    type Watchdog = W;
}

/// The link of a board.
pub type LinkOf<B> = <<B as Board>::Lines as Lines>::Link;
/// The storage of a board.
pub type StorageOf<B> = <<B as Board>::Medium as Medium>::Storage;

/// Drivers of lines.
pub trait Lines {
    /// What carries frames over them.
    type Link: Link + 'static;

    /// The link, made where it stays.
    ///
    /// # Panics
    /// `place` is taken.
    #[allow(clippy::mut_from_ref)] // A `StaticCell` gives its place once.
    fn link(self, place: &'static StaticCell<Self::Link>) -> &'static mut Self::Link;
}

/// One serial line for both planes.
pub struct OnLine<U>(pub U);

impl<U: Read + Write + 'static> Lines for OnLine<U> {
    type Link = Serial<U>;

    fn link(self, place: &'static StaticCell<Self::Link>) -> &'static mut Self::Link {
        place.init_with(|| Serial::new(self.0))
    }
}

/// CAN, and a serial line for the service plane.
pub struct OnCan<C, U> {
    /// The controller.
    pub can: C,
    /// The serial line.
    pub service: U,
    /// Errors that the driver of the line counts.
    pub errors: &'static AtomicU32,
}

impl<C: Controller + 'static, U: Read + Write + 'static> Lines for OnCan<C, U> {
    type Link = CanNode<C, U>;

    fn link(self, place: &'static StaticCell<Self::Link>) -> &'static mut Self::Link {
        let Self { can, service, errors } = self;
        place.init_with(|| CanNode::new(can, Serial::new(service).with_errors(errors)))
    }
}

/// A serial line to a host with both planes, and lines to `N` neighbours: of each the half that writes and the half that reads.
pub struct ToPeers<R: 'static, W: 'static, const N: usize> {
    /// The line to the host.
    pub host: (W, R),
    /// Lines to neighbours.
    pub peers: [(W, R); N],
    /// What passes frames on.
    pub forwarder: &'static mut Forwarder<N>,
    /// Errors that the drivers of all lines count, where they do.
    pub errors: Option<&'static AtomicU32>,
}

impl<R: Read + 'static, W: Write + 'static, const N: usize> Lines for ToPeers<R, W, N> {
    type Link = Peers<R, W, R, W, N>;

    fn link(self, place: &'static StaticCell<Self::Link>) -> &'static mut Self::Link {
        let link = Peers::make(place, self.host, self.peers, self.forwarder);
        if let Some(errors) = self.errors {
            link.count_errors(errors);
        }
        link
    }
}

/// Buffers of the line to the host, for what is sent and for what comes.
///
/// # Panics
/// They are taken.
pub fn host_buffers() -> (&'static mut [u8], &'static mut [u8]) {
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
    // May panic: at the start, where they are asked for twice.
    (TRANSMIT.take(), RECEIVE.take())
}

/// The program of a board with a virtual node: `node!(start, PARTS)`, where `start` is a function that gives the [`Parts`] of type `PARTS`; with a second task,
/// `node!(start, PARTS, task)`, it gives the parts and what the task takes.
///
/// It is a macro since a task, and the statics that hold what is large, cannot be generic.
#[macro_export]
macro_rules! node {
    ($start:ident, $parts:ty) => {
        $crate::node!(@program $parts, $start(););
    };
    ($start:ident, $parts:ty, $task:ident) => {
        $crate::node!(@program $parts, $start(); $task);
    };
    // The parts come alone, or with what a second task takes.
    (@split $given:expr;) => {
        ($given, ())
    };
    (@split $given:expr; $task:ident) => {{
        let (parts, taken) = $given;
        (parts, $task(taken).expect("the second task is spawned once"))
    }};
    (@spawn $spawner:ident, $second:ident;) => {
        let () = $second;
    };
    (@spawn $spawner:ident, $second:ident; $task:ident) => {
        $spawner.spawn($second)
    };
    (@program $parts:ty, $given:expr; $($task:ident)?) => {
        // One by one: what is together is moved within the task, by a memmove of 1.4 KiB that nothing else calls.
        #[embassy_executor::task]
        async fn node(
            lines: <$parts as $crate::board::Board>::Lines,
            storage: <$parts as $crate::board::Board>::Medium,
            uid: u64,
            start: $crate::reset::Start,
            watchdog: <$parts as $crate::board::Board>::Watchdog,
        ) {
            use $crate::app::{self, Chip, SessionOf};
            use $crate::board::{Lines, LinkOf, StorageOf};
            use $crate::storage::Medium;
            static SESSION: static_cell::StaticCell<SessionOf<funnelnet_plant::Virtual>> =
                static_cell::StaticCell::new();
            static LINK: static_cell::StaticCell<LinkOf<$parts>> = static_cell::StaticCell::new();
            static STORAGE: static_cell::StaticCell<StorageOf<$parts>> = static_cell::StaticCell::new();
            let link = lines.link(&LINK);
            let storage = storage.open(&STORAGE).await;
            let chip = Chip { uid, start, watchdog };
            core::pin::pin!(app::run(&SESSION, link, storage, funnelnet_plant::Virtual, chip)).await
        }

        #[cortex_m_rt::entry]
        #[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
        fn main() -> ! {
            static EXECUTOR: static_cell::StaticCell<$crate::executor::Executor> =
                static_cell::StaticCell::new();
            let ($crate::board::Parts { lines, storage, chip }, second) = $crate::node!(@split $given; $($task)?);
            let $crate::app::Chip { uid, start, watchdog } = chip;
            let node = node(lines, storage, uid, start, watchdog).expect("the task is spawned once");
            EXECUTOR.init($crate::executor::Executor::new()).run(|spawner| {
                spawner.spawn(node);
                $crate::node!(@spawn spawner, second; $($task)?);
            })
        }

        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo) -> ! {
            $crate::panic::report(info)
        }
    };
}
