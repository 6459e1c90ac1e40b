//! A CAN controller that hears itself, by its own loop-back inside the chip.

use embassy_futures::select::{Either, select};
use funnelnet_app::Clock;
use funnelnet_app::link::can::{Controller, Exchange};
use funnelnet_link::Classic;
use funnelnet_protocol::can::{CanFrame, MAX_DATA};

use crate::app::BoardClock;

/// How many.
pub const FRAMES: u32 = 100;
/// Nanoseconds for one: a frame takes 0.13 ms at 1 Mbit/s.
const LONGEST: u64 = 10_000_000;

/// What a board has of CAN.
#[allow(async_fn_in_trait)] // One executor, one task: nobody needs the futures to be `Send`.
pub trait Can {
    /// How many of [`FRAMES`] frames came back as they were sent; `None` without a controller.
    async fn looped(&mut self) -> Option<u32>;
}

/// No controller.
pub struct NoCan;

impl Can for NoCan {
    async fn looped(&mut self) -> Option<u32> {
        None
    }
}

/// A controller that is looped back: [`Controller`] as a node has it.
pub struct Looped<C>(pub C);

impl<C: Controller<Format = Classic>> Can for Looped<C> {
    async fn looped(&mut self) -> Option<u32> {
        let mut good = 0;
        for number in 0..FRAMES {
            good += u32::from(self.comes_back(number).await);
        }
        Some(good)
    }
}

impl<C: Controller<Format = Classic>> Looped<C> {
    async fn comes_back(&mut self, number: u32) -> bool {
        let id = ((number * 0x4D5) & 0x7FF) as u16;
        let data = u64::from(number).wrapping_mul(0x9E37_79B9_7F4A_7C15).to_le_bytes();
        let length = number as usize % (MAX_DATA + 1);
        let Some(frame) = data.get(..length).and_then(|bytes| CanFrame::new(id, bytes)) else { return false };
        if !self.0.offer(&frame) {
            return false;
        }
        let end = BoardClock.now() + LONGEST;
        // What is late from before is not this one.
        while let Either::First(exchange) = select(self.0.exchange(None), BoardClock.wait_until(end)).await {
            if let Exchange::Received(Some(came)) = exchange
                && came.id == id
                && usize::from(came.length) == length
                && came.data.get(..length) == data.get(..length)
            {
                return true;
            }
        }
        false
    }
}
