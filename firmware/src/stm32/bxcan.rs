//! The bxCAN controller of the STM32F4, with the traps of embassy-stm32 0.6 worked round.

use core::num::NonZeroU16;

use embassy_futures::select::{Either, select};
use embassy_stm32::can::filter::Mask32;
use embassy_stm32::can::frame::Frame;
use embassy_stm32::can::util::NominalBitTiming;
use embassy_stm32::can::{BufferedCanRx, Can, CanTx, Fifo, RxBuf};
use embassy_stm32::pac;
use embedded_can::StandardId;
use funnelnet_link::BusState;
use funnelnet_protocol::can::CanFrame;

use super::{received, width};
use funnelnet_app::link::can::{Controller, Exchange, Received};

/// Received frames that wait for the task: the controller itself holds three. 16 are 1 ms of a full bus at 1 Mbit/s.
pub const RECEIVE_BUFFER: usize = 16;

/// Data bytes of a classic frame at most.
const LONGEST: u8 = 8;
/// Readings of a register to wait for the initialization mode at most, some 50 us.
const LONGEST_WAIT: u32 = 1000;

/// A bit of `prescaler * (1 + seg1 + seg2)` clock periods, sampled after `seg1`; edges move it by up to `seg2`, and by four quanta at
/// most.
#[allow(clippy::expect_used)] // at compile time
pub const fn timing(prescaler: u8, seg1: u8, seg2: u8) -> NominalBitTiming {
    let prescaler = NonZeroU16::new(prescaler as u16);
    NominalBitTiming {
        prescaler: prescaler.expect("a quantum is a clock period or more"),
        seg1: width(seg1),
        seg2: width(seg2),
        sync_jump_width: width(if seg2 < 4 { seg2 } else { 4 }),
    }
}

/// CAN 1.
pub struct BxCan {
    /// Its drop would reset the controller.
    _can: Can<'static>,
    transmit: CanTx<'static>,
    receive: BufferedCanRx<'static, RECEIVE_BUFFER>,
}

impl BxCan {
    /// Starts the controller with this bit timing. It takes part after 11 recessive bits, for which this does not wait.
    pub fn start(
        mut can: Can<'static>,
        timing: NominalBitTiming,
        buffer: &'static mut RxBuf<RECEIVE_BUFFER>,
    ) -> Self {
        can.modify_filters().enable_bank(0, Fifo::Fifo0, of_this_plane());
        // Frames of one identifier leave in order. Retransmission stays as it is, on: embassy's setter for it is inverted.
        can.set_tx_fifo_scheduling(true);
        drop(can.modify_config().set_bit_timing(timing));
        let (transmit, receive) = can.split();
        let receive = receive.buffered(buffer);
        // What `enable` does, but for automatic recovery from bus-off, which the node must decide.
        pac::CAN1.mcr().modify(|reg| reg.set_sleep(false));
        Self { _can: can, transmit, receive }
    }
}

impl Controller for BxCan {
    type Format = funnelnet_link::Classic;

    async fn exchange(&mut self, next: Option<&CanFrame>) -> Exchange {
        let Some(frame) = next.and_then(frame) else { return read(&mut self.receive).await };
        match select(read(&mut self.receive), self.transmit.write(&frame)).await {
            Either::First(exchange) => exchange,
            Either::Second(_) => Exchange::Taken,
        }
    }

    fn cancel(&mut self) {
        // Only the requests: embassy's `abort` would wait for a frame that is being sent.
        pac::CAN1.tsr().write(|reg| (0..3).for_each(|mailbox| reg.set_abrq(mailbox, true)));
    }

    fn state(&self) -> BusState {
        let errors = pac::CAN1.esr().read();
        match (errors.boff(), errors.epvf()) {
            (true, _) => BusState::Off,
            (false, true) => BusState::Passive,
            (false, false) => BusState::Active,
        }
    }

    fn counters(&self) -> (u8, u8) {
        let errors = pac::CAN1.esr().read();
        (errors.tec(), errors.rec())
    }

    fn restart(&mut self) {
        // Entering and leaving the initialization mode is what starts the recovery (RM0390, bus-off recovery).
        pac::CAN1.mcr().modify(|reg| reg.set_inrq(true));
        // Without traffic of its own it enters at once. If it does not, this restart fails, and another follows.
        let entered = |_: &u32| pac::CAN1.msr().read().inak();
        let _ = (0..LONGEST_WAIT).find(entered);
        pac::CAN1.mcr().modify(|reg| reg.set_inrq(false));
    }
}

async fn read(receive: &mut BufferedCanRx<'static, RECEIVE_BUFFER>) -> Exchange {
    match receive.read().await {
        Ok(envelope) => Exchange::Received(frame_of(&envelope.frame)),
        Err(_) => Exchange::Error,
    }
}

/// A DLC of 9 to 15 is legal and means eight bytes (ISO 11898-1). The controller passes it on as it is, and the driver's `data` would cut its
/// eight bytes by it.
fn frame_of(frame: &Frame) -> Option<Received> {
    let header = frame.header();
    received(header, header.len().min(LONGEST), frame.raw_data())
}

/// Data frames with an identifier of 11 bits: nothing else is of the real-time plane.
fn of_this_plane() -> Mask32 {
    let mut mask = Mask32::frames_with_std_id(StandardId::ZERO, StandardId::ZERO);
    mask.data_frames_only();
    mask
}

fn frame(frame: &CanFrame) -> Option<Frame> {
    Frame::new_data(StandardId::new(frame.id())?, frame.data()).ok()
}
