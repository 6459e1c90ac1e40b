//! Why the node has started, and how often: what the hardware tells, and a record in RAM that a reset does not clear.
//!
//! A defect leaves its cause and place in the record and resets; the next start reads it once. After power-on the record is noise,
//! which its check tells.
//!
//! An image that goes on behind a reset keeps some words of its own beside it ([`keep`]).

use core::sync::atomic::{AtomicU32, Ordering};

use funnelnet_protocol::service::ResetCause;

/// Words of the record: check, starts, cause, place.
const WORDS: usize = 4;
/// No RAM holds it by itself.
const MAGIC: u32 = 0x46_4E_4C_31;

#[allow(unsafe_code)] // Any content is a valid one.
#[unsafe(link_section = ".uninit.record")]
static RECORD: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

/// Words that an image can keep.
pub const KEPT: usize = 5;

#[allow(unsafe_code)] // Any content is a valid one.
#[unsafe(link_section = ".uninit.kept")]
static KEPT_WORDS: [AtomicU32; 1 + KEPT] = [const { AtomicU32::new(0) }; 1 + KEPT];

/// What a node knows of its own start.
#[derive(Clone, Copy, Debug, Default, defmt::Format)]
pub struct Start {
    /// Why it has started.
    pub reset: ResetCause,
    /// Which start since power-on it is, from 1.
    pub starts: u32,
    /// Where a panic (line) or a hard fault (pc) was, else 0.
    pub place: u32,
}

/// Reads the record and begins a new one. Call once, first of all; `hardware` is what the chip says the reset was.
pub fn begin(hardware: ResetCause) -> Start {
    let start = match read().filter(|_| hardware != ResetCause::PowerOn) {
        // RAM that has lost its content was without supply, whatever the chip says.
        None => Start { reset: ResetCause::PowerOn, starts: 1, place: 0 },
        Some(old) => Start {
            reset: if old.reset == ResetCause::Unknown { hardware } else { old.reset },
            starts: old.starts.saturating_add(1),
            place: old.place,
        },
    };
    write(Start { reset: ResetCause::Unknown, place: 0, ..start });
    start
}

/// Leaves `cause` and `place` for the next start.
pub fn leave(reset: ResetCause, place: u32) {
    let starts = read().map_or(0, |record| record.starts);
    write(Start { reset, starts, place });
}

/// Restarts the chip.
pub fn restart() -> ! {
    #[cfg(feature = "_rp2040")]
    restart_all();
    cortex_m::peripheral::SCB::sys_reset()
}

/// The RP2040's core can reset only itself; its watchdog resets the pins and what drives them, too.
#[cfg(feature = "_rp2040")]
fn restart_all() {
    use embassy_rp::pac;
    pac::PSM.wdsel().write(|all| {
        all.0 = 0x0001_FFFF;
        all.set_rosc(false);
        all.set_xosc(false);
    });
    pac::WATCHDOG.ctrl().write(|control| control.set_trigger(true));
}

/// Keeps these words over a reset, but not over a power cycle.
pub fn keep(words: [u32; KEPT]) {
    let [first, rest @ ..] = &KEPT_WORDS;
    first.store(check(words), Ordering::Relaxed);
    rest.iter().zip(words).for_each(|(word, value)| word.store(value, Ordering::Relaxed));
    cortex_m::asm::dsb();
}

/// What was kept; `None` where nothing was, or where it was being written as the reset came.
pub fn kept() -> Option<[u32; KEPT]> {
    let [first, rest @ ..] = &KEPT_WORDS;
    let words = rest.each_ref().map(|word| word.load(Ordering::Relaxed));
    (first.load(Ordering::Relaxed) == check(words)).then_some(words)
}

/// Nothing is kept any more.
pub fn forget() {
    let [first, ..] = &KEPT_WORDS;
    first.store(!first.load(Ordering::Relaxed), Ordering::Relaxed);
    cortex_m::asm::dsb();
}

/// The record; `None` where it is noise.
fn read() -> Option<Start> {
    let [found, starts, code, place] = RECORD.each_ref().map(|word| word.load(Ordering::Relaxed));
    let reset = match code {
        0 => ResetCause::Unknown,
        1 => ResetCause::Panic,
        2 => ResetCause::HardFault,
        3 => ResetCause::Watchdog,
        _ => return None,
    };
    (found == check([starts, code, place])).then_some(Start { reset, starts, place })
}

fn write(record: Start) {
    let code = match record.reset {
        ResetCause::Panic => 1,
        ResetCause::HardFault => 2,
        ResetCause::Watchdog => 3,
        _ => 0,
    };
    let words = [record.starts, code, record.place];
    let all = [check(words), record.starts, code, record.place];
    RECORD.iter().zip(all).for_each(|(word, value)| word.store(value, Ordering::Relaxed));
    cortex_m::asm::dsb();
}

/// Each word has its own part in it, so that no two can be exchanged (FNV-1a by words).
fn check<const N: usize>(words: [u32; N]) -> u32 {
    words.iter().fold(MAGIC, |sum, word| (sum ^ word).wrapping_mul(0x0100_0193))
}
