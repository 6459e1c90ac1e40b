//! The bxCAN controller of the STM32F4, with the traps of embassy-stm32 0.6 worked round.

use core::num::NonZeroU16;

use embassy_futures::poll_once;
use embassy_futures::select::{Either, select};
use embassy_stm32::can::frame::Frame;
use embassy_stm32::can::util::NominalBitTiming;
use embassy_stm32::can::{Can, CanTx};
use embassy_stm32::interrupt::typelevel::{CAN1_RX0, CAN1_SCE, Handler};
use embassy_stm32::pac;
use embassy_stm32::pac::can::vals::{Ide, Lec, Rtr};
use embedded_can::StandardId;
use funnelnet_link::{BusState, Filter, Filters};
use funnelnet_protocol::can::CanFrame;
use funnelnet_protocol::report::Losses;

use super::{received, width};
use funnelnet_app::link::can::{Controller, Exchange};

/// Data bytes of a classic frame at most.
const LONGEST: u8 = 8;
/// Places of a receive FIFO.
const PLACES: usize = 3;
/// What a SYNC takes from its beginning to the interrupt at its end at 1 Mbit/s, us: 84 bits and those that are stuffed, of
/// which there are up to 18. embassy's stamp is the time of its interrupt, too; the controller's own, of 16 bits, is
/// for its time-triggered mode.
const SYNC_US: u32 = 90;
/// Banks of CAN 1, with two filters each, beside the last one, which lets everything in while the others
/// change.
const BANKS: usize = 13;
/// Readings of a register to wait for the initialization mode at most, some 50 us.
const LONGEST_WAIT: u32 = 1000;

/// A bit of `prescaler * (1 + seg1 + seg2)` clock periods, sampled after `seg1`; edges move it by up to
/// `seg2`, and by four quanta at most.
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
}

impl BxCan {
    /// Starts the controller with this bit timing. It takes part after 11 recessive bits, for which this does
    /// not wait.
    pub fn start(can: Can<'static>, timing: NominalBitTiming) -> Self {
        Self::start_as(can, timing, false)
    }

    /// As [`BxCan::start`], but it hears itself alone, and nothing of it is on the bus.
    pub fn start_looped(can: Can<'static>, timing: NominalBitTiming) -> Self {
        Self::start_as(can, timing, true)
    }

    fn start_as(mut can: Can<'static>, timing: NominalBitTiming, is_looped: bool) -> Self {
        begin_filters();
        // Frames of one identifier leave in order. Retransmission stays as it is, on: embassy's setter for it
        // is inverted.
        can.set_tx_fifo_scheduling(true);
        let config = can.modify_config().set_bit_timing(timing);
        drop(if is_looped { config.set_loopback(true).set_silent(true) } else { config });
        // Its receiving half would leave frames in the controller until the task has time; [`TakeFrames`]
        // does not.
        let (transmit, _) = can.split();
        // What `enable` does, but for automatic recovery from bus-off, which the node must decide.
        pac::CAN1.mcr().modify(|reg| reg.set_sleep(false));
        Self { _can: can, transmit }
    }
}

impl Controller for BxCan {
    type Format = funnelnet_link::Classic;

    async fn exchange(&mut self, next: Option<&CanFrame>) -> Exchange {
        let Some(frame) = next.and_then(frame) else { return received::next().await };
        match select(received::next(), self.transmit.write(&frame)).await {
            Either::First(exchange) => exchange,
            Either::Second(_) => Exchange::Taken,
        }
    }

    fn offer(&mut self, next: &CanFrame) -> bool {
        frame(next).is_some_and(|frame| poll_once(self.transmit.write(&frame)).is_ready())
    }

    fn received(&mut self) -> Option<Exchange> {
        received::next_now()
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
        // Entering and leaving the initialization mode is what starts the recovery (RM0390, bus-off
        // recovery).
        pac::CAN1.mcr().modify(|reg| reg.set_inrq(true));
        // Without traffic of its own it enters at once. If it does not, this restart fails, and another
        // follows.
        let entered = |_: &u32| pac::CAN1.msr().read().inak();
        let _ = (0..LONGEST_WAIT).find(entered);
        pac::CAN1.mcr().modify(|reg| reg.set_inrq(false));
    }
    fn losses(&self) -> Losses {
        received::losses()
    }

    fn listen(&mut self, filters: Filters<'_>) {
        let mut filters = filters.within(2 * BANKS).fuse();
        activate(BANKS, true);
        for bank in 0..BANKS {
            // A bank can be written while it is not active.
            activate(bank, false);
            if let Some(first) = filters.next() {
                set_bank(bank, first, filters.next().unwrap_or(first));
                activate(bank, true);
            }
        }
        activate(BANKS, false);
    }
}

/// Makes all banks pairs of identifiers of 11 bits with their masks, for FIFO 0, and lets everything in.
fn begin_filters() {
    let can = pac::CAN1;
    can.fmr().modify(|reg| reg.set_finit(true));
    can.fa1r().write(|_| {});
    can.fm1r().write(|_| {});
    can.fs1r().write(|_| {});
    can.ffa1r().write(|_| {});
    set_bank(BANKS, Filter::ALL, Filter::ALL);
    activate(BANKS, true);
    can.fmr().modify(|reg| reg.set_finit(false));
}

fn activate(bank: usize, is_active: bool) {
    pac::CAN1.fa1r().modify(|reg| reg.set_fact(bank, is_active));
}

fn set_bank(bank: usize, first: Filter, second: Filter) {
    let bank = pac::CAN1.fb(bank);
    bank.fr1().write(|reg| reg.0 = halves(first));
    bank.fr2().write(|reg| reg.0 = halves(second));
}

/// Identifier and mask as a filter of 16 bits has them (RM0390, filter bank scale and mode): data frames with
/// identifiers of 11 bits.
fn halves(Filter { id, mask }: Filter) -> u32 {
    const DATA_AND_SHORT: u32 = 0b11 << 3;
    u32::from(id) << 5 | (u32::from(mask) << 5 | DATA_AND_SHORT) << 16
}

/// Takes frames out of the controller. It goes after embassy's handler, which masks the interrupt until
/// somebody has.
pub struct TakeFrames;

#[allow(unsafe_code)] // Handlers of interrupts are unsafe to call.
impl Handler<CAN1_RX0> for TakeFrames {
    unsafe fn on_interrupt() {
        let can = pac::CAN1;
        // What comes meanwhile raises the interrupt again.
        for _ in 0..PLACES {
            if can.rfr(0).read().fmp() == 0 {
                break;
            }
            take();
            can.rfr(0).write(|reg| reg.set_rfom(true));
            let released = |_: &u32| !can.rfr(0).read().rfom();
            let _ = (0..LONGEST_WAIT).find(released);
        }
        if can.rfr(0).read().fovr() {
            can.rfr(0).write(|reg| reg.set_fovr(true));
            received::note_lost();
        }
        can.ier().modify(|reg| reg.set_fmpie(0, true));
    }
}

/// Takes the oldest frame, unless it is none of the plane: one with a 29-bit identifier, a remote frame.
fn take() {
    let place = pac::CAN1.rx(0);
    let head = place.rir().read();
    let is_of_plane = head.ide() == Ide::STANDARD && head.rtr() == Rtr::DATA;
    let Some(id) = StandardId::new(head.stid()).filter(|_| is_of_plane) else { return };
    let mut data = [0; received::LONGEST];
    let words = [place.rdlr().read().0, place.rdhr().read().0];
    data.chunks_exact_mut(4).zip(words).for_each(|(to, word)| to.copy_from_slice(&word.to_le_bytes()));
    // A DLC of 9 to 15 is legal and means eight bytes (ISO 11898-1). The controller passes it on as it is.
    received::put(id, place.rdtr().read().dlc().min(LONGEST), data, SYNC_US);
}

/// Counts errors on the bus. It goes before embassy's handler, which would mask the interrupt at the first
/// one.
pub struct CountErrors;

#[allow(unsafe_code)] // Handlers of interrupts are unsafe to call.
impl Handler<CAN1_SCE> for CountErrors {
    unsafe fn on_interrupt() {
        let can = pac::CAN1;
        let error = can.esr().read().lec();
        if error != Lec::NO_ERROR && error != Lec::CUSTOM {
            received::note_errors(1);
        }
        // So that the next one of the same kind is one, too.
        can.esr().write(|reg| reg.set_lec(Lec::CUSTOM));
        can.msr().write(|reg| reg.set_erri(true));
    }
}

fn frame(frame: &CanFrame) -> Option<Frame> {
    Frame::new_data(StandardId::new(frame.id())?, frame.data()).ok()
}
