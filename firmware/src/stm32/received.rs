//! CAN frames between the interrupt handler that takes them out of the controller and the node, and what is
//! lost on the way.
//!
//! embassy's own queues drop what they have no room for and tell nobody, so its drivers run without one here.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::Instant;
use embedded_can::StandardId;
use funnelnet_app::link::can::{Exchange, Received};
use funnelnet_protocol::can::function;
use funnelnet_protocol::report::Losses;

/// Bits of an identifier that name the node.
const NODE_BITS: u16 = 7;
const NS_PER_US: u64 = 1_000;
/// Frames that wait for the task: 1.5 ms of the shortest ones at 1 Mbit/s.
const ROOM: usize = 32;
/// Data bytes of the longest frame of the format that this is built for.
pub const LONGEST: usize = if cfg!(feature = "can-fd") { funnelnet_protocol::can_fd::MAX_DATA } else { 8 };

struct Waiting {
    id: u16,
    length: u8,
    data: [u8; LONGEST],
    /// When it began on the bus, us, by the low 32 bits of embassy's clock; 0 where nobody asks for it.
    began: u32,
}

static WAITING: Channel<CriticalSectionRawMutex, Waiting, ROOM> = Channel::new();
static LOST: AtomicU32 = AtomicU32::new(0);
static ERRORS: AtomicU32 = AtomicU32::new(0);

/// Takes a data frame of `length` bytes from the controller, which began on the bus `ago` (us).
pub fn put(id: StandardId, length: u8, data: [u8; LONGEST], ago: u32) {
    let began = match id.as_raw() >> NODE_BITS == u16::from(function::SYNC) {
        true => (Instant::now().as_micros() as u32).wrapping_sub(ago).max(1),
        false => 0,
    };
    if WAITING.try_send(Waiting { id: id.as_raw(), length, data, began }).is_err() {
        note_lost();
    }
}

/// The whole time, ns, of what began at `at`, as [`Waiting`] has it.
fn whole(at: u32) -> Option<u64> {
    let now = Instant::now().as_micros();
    let ago = (now as u32).wrapping_sub(at);
    (at != 0).then(|| now.saturating_sub(ago.into()).saturating_mul(NS_PER_US))
}

/// Counts that a frame was lost, or several at once, of which nobody knows how many.
pub fn note_lost() {
    add(&LOST, 1);
}

/// Counts errors on the bus.
pub fn note_errors(count: u32) {
    add(&ERRORS, count);
}

/// Waits for a frame.
pub async fn next() -> Exchange {
    exchange(&WAITING.receive().await)
}

/// A frame that waits.
pub fn next_now() -> Option<Exchange> {
    WAITING.try_receive().ok().map(|waiting| exchange(&waiting))
}

/// What was lost and found wrong so far.
pub fn losses() -> Losses {
    let [frames, bus_errors] = [&LOST, &ERRORS].map(|count| count.load(Ordering::Relaxed));
    Losses { frames, bus_errors, ..Losses::default() }
}

fn exchange(waiting: &Waiting) -> Exchange {
    let frame = Received::new(waiting.id, waiting.length, &waiting.data);
    Exchange::Received(Some(frame.that_began(whole(waiting.began))))
}

/// Interrupts do not interrupt each other, and the task adds nothing that an interrupt adds.
fn add(counter: &AtomicU32, count: u32) {
    counter.store(counter.load(Ordering::Relaxed).saturating_add(count), Ordering::Relaxed);
}
