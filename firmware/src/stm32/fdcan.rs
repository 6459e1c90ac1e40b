//! The FDCAN controller of the STM32G4, with the traps of embassy-stm32 0.6 worked round.

use core::num::NonZeroU16;

use embassy_futures::poll_once;
use embassy_futures::select::{Either, select};
use embassy_stm32::can::config::{
    DataBitTiming, FrameTransmissionConfig, GlobalFilter, NominalBitTiming, TxBufferMode,
};
use embassy_stm32::can::frame::{FdFrame, Header};
use embassy_stm32::can::{CanConfigurator, CanTx, OperatingMode};
use embassy_stm32::interrupt::typelevel::{FDCAN1_IT0, Handler};
use embassy_stm32::pac;
use embedded_can::StandardId;
use funnelnet_link::{BusState, Filter, Filters, Frame};
use funnelnet_protocol::report::Losses;

use super::received::{self, LONGEST};
use super::width;
use funnelnet_app::link::can::{Controller, Exchange, FrameOf};

/// What it is built for: all nodes of a bus have the same format.
#[cfg(feature = "can-fd")]
type Format = funnelnet_link::Fd;
#[cfg(not(feature = "can-fd"))]
type Format = funnelnet_link::Classic;

/// Words of message RAM per place of a receive FIFO (RM0440, message RAM): identifier, kind and length, 64
/// bytes.
const PLACE_WORDS: usize = 18;
/// Places of the FIFO.
const PLACES: usize = 3;
/// What a SYNC takes in frames of CAN FD at 1 and 2 Mbit/s, us.
const SYNC_FD_US: u32 = 70;
/// Filters for identifiers of 11 bits. The first one lets everything in while the others change.
const FILTERS: usize = 28;

/// Bit timings of CAN FD.
#[derive(Clone, Copy)]
pub struct FdTiming {
    /// Timing of the data phase.
    pub data: DataBitTiming,
    /// Offset of the secondary sample point, clock periods: that of the sample point from the start of the
    /// bit.
    pub delay_offset: u8,
}

/// A bit of `prescaler * (1 + seg1 + seg2)` clock periods, sampled after `seg1`; edges move it by up to
/// `seg2`.
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

/// FDCAN 1.
pub struct FdCan {
    transmit: CanTx<'static>,
    fd: bool,
}

impl FdCan {
    /// Starts the controller. Without timings of CAN FD it sends classic frames, and takes those of CAN FD
    /// for errors.
    pub fn start(
        configurator: CanConfigurator<'static>,
        nominal: NominalBitTiming,
        fd: Option<FdTiming>,
    ) -> Self {
        Self::start_as(OperatingMode::NormalOperationMode, configurator, nominal, fd)
    }

    /// As [`FdCan::start`], but it hears itself alone, and nothing of it is on the bus.
    pub fn start_looped(configurator: CanConfigurator<'static>, nominal: NominalBitTiming) -> Self {
        Self::start_as(OperatingMode::InternalLoopbackMode, configurator, nominal, None)
    }

    fn start_as(
        mode: OperatingMode,
        mut configurator: CanConfigurator<'static>,
        nominal: NominalBitTiming,
        fd: Option<FdTiming>,
    ) -> Self {
        let mut config = configurator.config().set_nominal_bit_timing(nominal);
        config.global_filter = GlobalFilter::reject_all();
        set_filter(0, Some(Filter::ALL));
        config.tx_buffer_mode = TxBufferMode::Fifo;
        config.automatic_bus_off_recovery = false;
        if let Some(timing) = fd {
            config = config.set_data_bit_timing(timing.data);
            config.frame_transmit = FrameTransmissionConfig::AllowFdCanAndBRS;
        }
        configurator.set_config(config);
        let can = configurator.start(mode);
        if let Some(timing) = fd {
            compensate_delay(timing.delay_offset);
        }
        // Its receiving half would leave frames in the controller until the task has time; [`TakeFrames`]
        // does not.
        let (transmit, _, _) = can.split();
        Self { transmit, fd: fd.is_some() }
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

/// Takes frames out of the controller. It goes after embassy's handler, which clears the flag.
pub struct TakeFrames;

#[allow(unsafe_code)] // Handlers of interrupts are unsafe to call.
impl Handler<FDCAN1_IT0> for TakeFrames {
    unsafe fn on_interrupt() {
        let can = pac::FDCAN1;
        loop {
            let fifo = can.rxfs(0).read();
            if fifo.ffl() == 0 {
                break;
            }
            take(fifo.fgi());
            can.rxfa(0).write(|reg| reg.set_fai(fifo.fgi()));
        }
        if can.ir().read().rfl(0) {
            can.ir().write(|reg| reg.set_rfl(0, true));
            received::note_lost();
        }
    }
}

/// Takes the frame at this place of the FIFO, unless it is none of the plane: one with a 29-bit identifier, a
/// remote frame.
fn take(place: u8) {
    let at = usize::from(place) * PLACE_WORDS;
    let [head, kind] = [at, at + 1].map(fifo_word);
    let (is_extended, is_remote) = (head >> 30 & 1 == 1, head >> 29 & 1 == 1);
    let Some(id) = StandardId::new((head >> 18 & 0x7FF) as u16).filter(|_| !is_extended && !is_remote) else {
        return;
    };
    let mut data = [0; LONGEST];
    for (word, bytes) in data.chunks_exact_mut(4).enumerate() {
        bytes.copy_from_slice(&fifo_word(at + 2 + word).to_le_bytes());
    }
    received::put(id, length(kind), data, began_ago(kind));
}

/// How long ago a frame of this kind has begun on the bus, us: by the controller's counter of bits, which embassy starts,
/// at 1 Mbit/s. With two bit rates that counts no time, and the frame has ended just now.
fn began_ago(kind: u32) -> u32 {
    if cfg!(feature = "can-fd") {
        return SYNC_FD_US;
    }
    let now = pac::FDCAN1.tscv().read().tsc();
    now.wrapping_sub(kind as u16).into()
}

/// A word of FIFO 0; no place is behind its end.
fn fifo_word(word: usize) -> u32 {
    if word < PLACES * PLACE_WORDS { pac::FDCANRAM1.rxfifo0(word).read() } else { 0 }
}

/// Data bytes of a frame of this kind. A DLC of 9 to 15 means eight bytes in a classic frame (ISO 11898-1).
fn length(kind: u32) -> u8 {
    let (code, is_fd) = ((kind >> 16 & 15) as u8, kind >> 21 & 1 == 1);
    match code {
        0..=8 => code,
        _ if !is_fd => 8,
        9..=12 => 4 * code - 24,
        13 => 32,
        14 => 48,
        _ => 64,
    }
}

/// Sets a filter: identifier and mask, into FIFO 0 (RM0440, message RAM, standard message ID filter element).
fn set_filter(place: usize, filter: Option<Filter>) {
    let word =
        filter.map_or(0, |Filter { id, mask }| 2 << 30 | 1 << 27 | u32::from(id) << 16 | u32::from(mask));
    if place < FILTERS {
        pac::FDCANRAM1.flssa(place).write_value(word);
    }
}

/// The error counters; the errors since the last reading are added to those counted. Whoever reads the
/// register takes them.
fn error_counters() -> (u8, u8) {
    let counters = pac::FDCAN1.ecr().read();
    received::note_errors(counters.cel().into());
    (counters.tec(), counters.rec())
}

impl Controller for FdCan {
    type Format = Format;

    async fn exchange(&mut self, next: Option<&FrameOf<Self>>) -> Exchange {
        let Some(frame) = next.and_then(|next| self.frame(next)) else { return received::next().await };
        match select(received::next(), self.transmit.write_fd(&frame)).await {
            Either::First(exchange) => exchange,
            Either::Second(_) => Exchange::Taken,
        }
    }

    fn offer(&mut self, frame: &FrameOf<Self>) -> bool {
        self.frame(frame).is_some_and(|frame| poll_once(self.transmit.write_fd(&frame)).is_ready())
    }

    fn received(&mut self) -> Option<Exchange> {
        received::next_now()
    }

    fn cancel(&mut self) {
        pac::FDCAN1.txbcr().write(|reg| (0..3).for_each(|buffer| reg.set_cr(buffer, true)));
    }

    fn state(&self) -> BusState {
        let state = pac::FDCAN1.psr().read();
        match (state.bo(), state.ep()) {
            (true, _) => BusState::Off,
            (false, true) => BusState::Passive,
            (false, false) => BusState::Active,
        }
    }

    fn counters(&self) -> (u8, u8) {
        error_counters()
    }

    fn restart(&mut self) {
        // Going bus-off has set INIT; clearing it is what starts the recovery (RM0440, bus-off recovery).
        pac::FDCAN1.cccr().modify(|reg| reg.set_init(false));
    }

    fn losses(&self) -> Losses {
        let _ = error_counters();
        received::losses()
    }

    fn listen(&mut self, filters: Filters<'_>) {
        set_filter(0, Some(Filter::ALL));
        let mut filters = filters.within(FILTERS - 1).fuse();
        (1..FILTERS).for_each(|place| set_filter(place, filters.next()));
        set_filter(0, None);
    }
}
