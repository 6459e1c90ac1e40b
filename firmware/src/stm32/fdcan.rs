//! The FDCAN controller of the STM32G4, with the traps of embassy-stm32 0.6 worked round.

use core::num::NonZeroU16;

use embassy_futures::select::{Either, select};
use embassy_stm32::can::config::{
    DataBitTiming, FrameTransmissionConfig, GlobalFilter, NominalBitTiming, NonMatchingFilter, TxBufferMode,
};
use embassy_stm32::can::enums::BusErrorMode;
use embassy_stm32::can::frame::{FdFrame, Header};
use embassy_stm32::can::{
    BufferedCanFd, BufferedFdCanReceiver, BufferedFdCanSender, CanConfigurator, OperatingMode, RxFdBuf,
    TxFdBuf,
};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::typelevel::Interrupt as _;
use embassy_stm32::pac;
use embedded_can::StandardId;
use funnelnet_link::{BusState, Frame};

use super::{received, width};
use funnelnet_app::link::can::{Controller, Exchange, FrameOf};

/// What it is built for: all nodes of a bus have the same format.
#[cfg(feature = "can-fd")]
type Format = funnelnet_link::Fd;
#[cfg(not(feature = "can-fd"))]
type Format = funnelnet_link::Classic;

/// Frames that wait for the interrupt handler: one, since newer values follow.
pub const TRANSMIT_BUFFER: usize = 1;
/// Received frames that wait for the task: the controller itself holds three. 16 are 1 ms of a full bus at 1 Mbit/s.
pub const RECEIVE_BUFFER: usize = 16;

/// Bit timings of CAN FD.
#[derive(Clone, Copy)]
pub struct FdTiming {
    /// Timing of the data phase.
    pub data: DataBitTiming,
    /// Offset of the secondary sample point, clock periods: that of the sample point from the start of the bit.
    pub delay_offset: u8,
}

/// A bit of `prescaler * (1 + seg1 + seg2)` clock periods, sampled after `seg1`; edges move it by up to `seg2`.
#[allow(clippy::expect_used)] // at compile time
pub const fn timing(prescaler: u8, seg1: u8, seg2: u8) -> NominalBitTiming {
    let prescaler = NonZeroU16::new(prescaler as u16);
    NominalBitTiming {
        prescaler: prescaler.expect("a quantum is a clock period or more"),
        seg1: width(seg1),
        seg2: width(seg2),
        sync_jump_width: width(seg2),
    }
}

/// As [`timing`] for the data phase, with the secondary sample point at the same place of the bit.
pub const fn fd_timing(prescaler: u8, seg1: u8, seg2: u8) -> FdTiming {
    let nominal = timing(prescaler, seg1, seg2);
    let data = DataBitTiming {
        transceiver_delay_compensation: true,
        prescaler: nominal.prescaler,
        seg1: nominal.seg1,
        seg2: nominal.seg2,
        sync_jump_width: nominal.sync_jump_width,
    };
    FdTiming { data, delay_offset: prescaler * (1 + seg1) }
}

/// Memory of the driver.
pub struct Buffers {
    /// To send.
    pub transmit: TxFdBuf<TRANSMIT_BUFFER>,
    /// Received.
    pub receive: RxFdBuf<RECEIVE_BUFFER>,
}

impl Buffers {
    /// Empty ones.
    pub const fn new() -> Self {
        Self { transmit: TxFdBuf::new(), receive: RxFdBuf::new() }
    }
}

impl Default for Buffers {
    fn default() -> Self {
        Self::new()
    }
}

/// FDCAN 1.
pub struct FdCan {
    can: BufferedCanFd<'static, TRANSMIT_BUFFER, RECEIVE_BUFFER>,
    transmit: BufferedFdCanSender,
    receive: BufferedFdCanReceiver,
    fd: bool,
}

impl FdCan {
    /// Starts the controller. Without timings of CAN FD it sends classic frames, and takes those of CAN FD for errors.
    pub fn start(
        mut configurator: CanConfigurator<'static>,
        nominal: NominalBitTiming,
        fd: Option<FdTiming>,
        buffers: &'static mut Buffers,
    ) -> Self {
        let mut config = configurator.config().set_nominal_bit_timing(nominal);
        // Not by a range filter, whose ends embassy puts the wrong way round: what matches no filter is accepted.
        config.global_filter =
            GlobalFilter::reject_all().set_handle_standard_frames(NonMatchingFilter::IntoRxFifo0);
        config.tx_buffer_mode = TxBufferMode::Fifo;
        config.automatic_bus_off_recovery = false;
        if let Some(timing) = fd {
            config = config.set_data_bit_timing(timing.data);
            config.frame_transmit = FrameTransmissionConfig::AllowFdCanAndBRS;
        }
        configurator.set_config(config);
        let can = configurator.start(OperatingMode::NormalOperationMode);
        if let Some(timing) = fd {
            compensate_delay(timing.delay_offset);
        }
        let can = can.buffered_fd(&mut buffers.transmit, &mut buffers.receive);
        let (transmit, receive) = (can.writer(), can.reader());
        Self { can, transmit, receive, fd: fd.is_some() }
    }

    /// With the header of its kind: `FdFrame::new_standard` makes classic ones.
    fn frame(&self, frame: &impl Frame) -> Option<FdFrame> {
        let id = StandardId::new(frame.id())?.into();
        let length = frame.data().len() as u8;
        let header =
            if self.fd { Header::new_fd(id, length, false, true) } else { Header::new(id, length, false) };
        FdFrame::new(header, frame.data()).ok()
    }
}

/// Measures the transceiver's delay and samples that much later: embassy has a setting for it and ignores it.
fn compensate_delay(offset: u8) {
    let can = pac::FDCAN1;
    can.cccr().modify(|reg| reg.set_init(true));
    while !can.cccr().read().init() {}
    can.cccr().modify(|reg| reg.set_cce(true));
    can.dbtp().modify(|reg| reg.set_tdc(true));
    can.tdcr().write(|reg| reg.set_tdco(offset));
    can.cccr().modify(|reg| reg.set_init(false));
}

impl Controller for FdCan {
    type Format = Format;

    async fn exchange(&mut self, next: Option<&FrameOf<Self>>) -> Exchange {
        let Some(frame) = next.and_then(|next| self.frame(next)) else { return read(&self.receive).await };
        match select(read(&self.receive), self.transmit.write(frame)).await {
            Either::First(exchange) => exchange,
            Either::Second(()) => Exchange::Taken,
        }
    }

    fn cancel(&mut self) {
        let drop_all = || pac::FDCAN1.txbcr().write(|reg| (0..3).for_each(|buffer| reg.set_cr(buffer, true)));
        drop_all();
        // The frame in the driver's own buffer: its interrupt handler gives it to the controller.
        interrupt::typelevel::FDCAN1_IT0::pend();
        drop_all();
    }

    fn state(&self) -> BusState {
        match self.can.properties().bus_error_mode() {
            BusErrorMode::ErrorActive => BusState::Active,
            BusErrorMode::ErrorPassive => BusState::Passive,
            BusErrorMode::BusOff => BusState::Off,
        }
    }

    fn counters(&self) -> (u8, u8) {
        let properties = self.can.properties();
        (properties.tx_error_count(), properties.rx_error_count())
    }

    fn restart(&mut self) {
        // Going bus-off has set INIT; clearing it is what starts the recovery (RM0440, bus-off recovery).
        pac::FDCAN1.cccr().modify(|reg| reg.set_init(false));
    }
}

async fn read(receive: &BufferedFdCanReceiver) -> Exchange {
    match receive.receive().await {
        Ok(envelope) => {
            let header = envelope.frame.header();
            Exchange::Received(received(header, header.len(), envelope.frame.data()))
        }
        Err(_) => Exchange::Error,
    }
}
