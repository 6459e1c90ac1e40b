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
}

static WAITING: Channel<CriticalSectionRawMutex, Waiting, ROOM> = Channel::new();
/// When the last SYNC began on the bus, us, by the low 32 bits of embassy's clock; 0: none has come.
static SYNC_AT: AtomicU32 = AtomicU32::new(0);
static LOST: AtomicU32 = AtomicU32::new(0);
static ERRORS: AtomicU32 = AtomicU32::new(0);

/// Takes a data frame of `length` bytes from the controller, which began on the bus `ago` (us).
pub fn put(id: StandardId, length: u8, data: [u8; LONGEST], ago: u32) {
    if id.as_raw() >> NODE_BITS == u16::from(function::SYNC) {
        let began = (Instant::now().as_micros() as u32).wrapping_sub(ago);
        SYNC_AT.store(began.max(1), Ordering::Relaxed);
    }
    if WAITING.try_send(Waiting { id: id.as_raw(), length, data }).is_err() {
        note_lost();
    }
}

/// When the last SYNC began on the bus, by the clock that shows `now` (ns); none where none has come.
pub fn sync_at(now: u64) -> Option<u64> {
    let at = SYNC_AT.load(Ordering::Relaxed);
    // It may have come since `now` was read.
    let ago = ((now / NS_PER_US) as u32).wrapping_sub(at) as i32;
    (at != 0).then(|| now.saturating_add_signed(-i64::from(ago) * NS_PER_US as i64))
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
    Exchange::Received(Some(Received::new(waiting.id, waiting.length, &waiting.data)))
}

/// Interrupts do not interrupt each other, and the task adds nothing that an interrupt adds.
fn add(counter: &AtomicU32, count: u32) {
    counter.store(counter.load(Ordering::Relaxed).saturating_add(count), Ordering::Relaxed);
}
