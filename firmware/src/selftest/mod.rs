//! Does the platform keep its promises? Run by `./ci.sh selftest` in the emulator, and at the bring-up of a
//! new board.
//!
//! The first byte that comes chooses a test; everything after it belongs to that test.

mod can;
mod hour;
mod stuck;

use core::hint::black_box;
use core::pin::pin;

use embassy_time::{Duration, Instant, Ticker, Timer};
use embedded_io_async::{Read, Write};
use funnelnet_link::{Classic, Fd, Format};
use funnelnet_plant::Virtual;
use static_cell::StaticCell;

use crate::app::{self, Chip, SessionOf};
use crate::{panic, priority};
use funnelnet_app::link::can::CanNode;
use funnelnet_app::link::serial::Serial;
use funnelnet_app::storage::{Absent, Storage};
use funnelnet_app::watchdog::Watchdog;

/// Ticks of the timing test.
pub const TICKS: u32 = 1000;
/// Period of the timing test.
pub const PERIOD: Duration = Duration::from_millis(1);
/// Length of the long wait: longer than any hardware timer here, so that it has to be put together.
pub const LONG_WAIT: Duration = Duration::from_secs(1000);
/// Bytes of the bulk test: more than the sockets between the emulator and the host hold.
pub const BULK: u32 = 1_000_000;

/// Of the test that is a node.
static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
static STUCK: StaticCell<SessionOf<stuck::Plant>> = StaticCell::new();

/// Runs the chosen test: `e` echo for ever, `t` ticker, `w` long wait, `b` bulk transmission, `o` overflow
/// of the receive buffer, `p` panic, `f` hard fault, `c` a node on a CAN bus that fails, `d` the same in frames of CAN FD, `s` a node with
/// storage, `h` a network for an hour; `P`, `F` a panic and a hard fault that restart the board as hardware does, `x` a node whose watchdog runs and
/// whose plant gets stuck at its fifth tick, `O` a stack that overflows, restarted as after `F`; `i` equal priorities. `chip` is the board's, `lost` tells how many bytes the link has dropped for want of room, `counts` is the clock that
/// embassy-time is made from.
pub async fn run<L: Read + Write>(
    mut link: L,
    storage: &mut impl Storage,
    chip: Chip<impl Watchdog>,
    lost: impl Fn() -> u32,
    counts: impl Fn() -> u32,
) -> Result<(), L::Error> {
    defmt::info!("selftest ready");
    let mut choice = [0];
    link.read(&mut choice).await?;
    match choice[0] {
        b'e' => loop {
            echo(&mut link).await?;
        },
        b't' => ticker(&mut link).await,
        b'w' => long_wait(&mut link).await,
        b'b' => bulk(&mut link).await,
        b'o' => overflow(&mut link, lost).await,
        b'p' => deliberate_panic(),
        b'c' => on_can::<Classic>(link).await,
        b'd' => on_can::<Fd>(link).await,
        b's' => pin!(app::run(&SESSION, &mut Serial::new(link), storage, Virtual, chip)).await,
        b'x' => pin!(app::run(&STUCK, &mut Serial::new(link), storage, stuck::Plant::default(), chip)).await,
        b'P' => {
            restart_with_safe_output();
            deliberate_panic()
        }
        b'F' => {
            restart_with_safe_output();
            cortex_m::asm::udf()
        }
        b'O' => {
            restart_with_safe_output();
            overflow_stack(Again(overflow_stack));
            Ok(())
        }
        b'i' => link.write_all(&[u8::from(priority::is_level())]).await,
        b'h' => hour::run(&mut link, counts).await,
        b'f' => cortex_m::asm::udf(),
        other => {
            defmt::error!("no test is called {=u8:#04x}", other);
            Ok(())
        }
    }
}

/// A node on a bus in one of the formats.
async fn on_can<F: Format>(link: impl Read + Write) -> ! {
    let mut node = CanNode::new(can::Scripted::<F>::default(), Serial::new(link));
    pin!(app::run(&SESSION, &mut node, &mut Absent, Virtual, Chip::UNKNOWN)).await
}

fn restart_with_safe_output() {
    panic::on_defect(|| defmt::info!("the output is safe"));
    #[cfg(feature = "_mps2")]
    panic::restart_after_defects();
}

/// A function to call again: recursion that is plain to see is refused by checks/stack.py.
#[derive(Clone, Copy)]
struct Again(fn(Again) -> u32);

/// Until there is no stack left.
fn overflow_stack(again: Again) -> u32 {
    let room = black_box([1; 64]);
    black_box(again.0)(again) + black_box(room)[0]
}

#[allow(clippy::panic)] // That is the test.
fn deliberate_panic() -> ! {
    panic!("deliberate, as asked for")
}

/// Sends, as two little-endian u32 in microseconds, how long [`TICKS`] periods took and how late the latest
/// tick was.
async fn ticker<L: Write>(link: &mut L) -> Result<(), L::Error> {
    let start = Instant::now();
    let mut ticker = Ticker::every(PERIOD);
    let mut latest = 0;
    for tick in 1..=TICKS {
        ticker.next().await;
        let due = start + PERIOD * tick;
        latest = Instant::now().saturating_duration_since(due).as_micros().max(latest);
    }
    let took = start.elapsed().as_micros();
    defmt::info!("{=u32} ticks took {=u64} us, the latest was {=u64} us late", TICKS, took, latest);
    link.write_all(&(took as u32).to_le_bytes()).await?;
    link.write_all(&(latest as u32).to_le_bytes()).await
}

/// Sends, as a little-endian u64 in microseconds, how long [`LONG_WAIT`] was.
async fn long_wait<L: Write>(link: &mut L) -> Result<(), L::Error> {
    let start = Instant::now();
    Timer::after(LONG_WAIT).await;
    link.write_all(&start.elapsed().as_micros().to_le_bytes()).await
}

/// Sends [`BULK`] bytes as fast as the link takes them, each the low byte of its number.
async fn bulk<L: Write>(link: &mut L) -> Result<(), L::Error> {
    let piece: [u8; 256] = core::array::from_fn(|i| i as u8);
    let mut left = BULK as usize;
    while left > 0 {
        let count = left.min(piece.len());
        link.write_all(&piece[..count]).await?;
        left -= count;
    }
    link.flush().await
}

/// Leaves what comes lying until it has overflowed and stopped; then sends, as a little-endian u32, how many
/// bytes were lost, and what was kept.
async fn overflow<L: Read + Write>(link: &mut L, lost: impl Fn() -> u32) -> Result<(), L::Error> {
    let mut before = 0;
    loop {
        Timer::after(Duration::from_millis(300)).await;
        let now = lost();
        if now != 0 && now == before {
            break;
        }
        before = now;
    }
    link.write_all(&before.to_le_bytes()).await?;
    loop {
        echo(link).await?;
    }
}

/// Sends back the bytes that are there.
async fn echo<L: Read + Write>(link: &mut L) -> Result<(), L::Error> {
    let mut buffer = [0; 256];
    let count = link.read(&mut buffer).await?;
    link.write_all(&buffer[..count]).await
}
