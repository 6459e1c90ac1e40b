//! The app of every board: a session on a link. It moves bytes and time; the core decides.

use embassy_futures::select::{Either, select};
use embassy_time::{Instant, Timer};
use embedded_io_async::{Read, Write};
use funnel_core::{Output, Session};
use funnel_protocol::WIRE_VERSION;
use funnel_protocol::serial::{self, Deframer};
use funnel_protocol::service::{Identity, MAX_REPLY_BODY, Reply};

/// Longest reply before COBS: kind, source, body, CRC.
const MAX_RAW: usize = 2 + MAX_REPLY_BODY + 2;
/// Longest reply on the wire: COBS adds one byte in 254, and the final zero.
const MAX_REPLY: usize = MAX_RAW + 2;

/// Runs a node on `link` until the link fails. `uid` is the chip's unique number, 0 where it has none.
pub async fn run<L: Read + Write>(mut link: L, uid: u64) -> L::Error {
    defmt::info!("ready, wire version {=u8}", WIRE_VERSION);
    let mut session = Session::new(Identity { wire_version: WIRE_VERSION, firmware: VERSION, id: 0, uid });
    let mut deframer: Deframer = Deframer::new();
    loop {
        if let Err(error) = step(&mut session, &mut deframer, &mut link).await {
            return error;
        }
    }
}

/// Waits for bytes or for the next tick, and does what follows from them.
async fn step<L: Read + Write>(
    session: &mut Session,
    deframer: &mut Deframer,
    link: &mut L,
) -> Result<(), L::Error> {
    let mut bytes = [0; 64];
    let count = match session.poll_at() {
        None => link.read(&mut bytes).await?,
        // Dropping a pending read loses nothing (see the links).
        Some(at) => match select(link.read(&mut bytes), Timer::at(instant(at))).await {
            Either::First(count) => count?,
            Either::Second(()) => 0,
        },
    };
    for &byte in bytes.iter().take(count) {
        if let Some(frame) = deframer.push(byte) {
            session.on_frame(frame, now());
            drain(session, link).await?;
        }
    }
    drain(session, link).await
}

/// Puts everything that the session has to say on the link and into the log.
async fn drain<L: Read + Write>(session: &mut Session, link: &mut L) -> Result<(), L::Error> {
    while let Some(output) = session.poll(now()) {
        match output {
            Output::Send(message) => link.write_all(&serial::encode(&message)).await?,
            Output::Reply(reply) => send_reply(session.id(), &reply, link).await?,
            Output::Report(event) => defmt::info!("{}", event),
        }
    }
    Ok(())
}

async fn send_reply<L: Write>(id: u8, reply: &Reply, link: &mut L) -> Result<(), L::Error> {
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_REPLY]);
    match serial::encode_service(reply, id, &mut scratch, &mut frame) {
        Some(length) => link.write_all(frame.get(..length).unwrap_or(&frame)).await,
        None => {
            defmt::error!("a reply does not fit its frame; not sent");
            Ok(())
        }
    }
}

/// Time since the start, ns.
fn now() -> u64 {
    Instant::now().as_micros() * 1000
}

/// The clock's first instant at or after `at` (ns), or an earlier one where that is more than four seconds away: a
/// node that is polled early does nothing. So the division is one of 32 bits, which is an instruction.
fn instant(at: u64) -> Instant {
    let now = Instant::now();
    let wait_ns = at.saturating_sub(now.as_micros() * 1000);
    let wait_us = u32::try_from(wait_ns).unwrap_or(u32::MAX).div_ceil(1000);
    Instant::from_micros(now.as_micros() + u64::from(wait_us))
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
