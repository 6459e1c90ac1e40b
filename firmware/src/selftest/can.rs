//! A CAN controller that plays its part, so that a node on CAN can be tested where there is none.

use core::future::pending;
use core::marker::PhantomData;

use funnelnet_link::{BusState, Format, Frame};
use funnelnet_protocol::can::function;

use funnelnet_app::link::can::{Controller, Exchange, Received};

/// States after which the controller goes off the bus, once.
const STATES: u32 = 50;
/// The neighbour that it plays.
const NEIGHBOUR: u16 = 2;

/// Takes every frame at once, answers each state with the same one from a neighbour, goes off the bus after
/// [`STATES`], and comes back when it is restarted. It logs what is not a state, and the length of the first
/// state.
pub struct Scripted<F> {
    answer: Option<Received>,
    states: u32,
    off: bool,
    format: PhantomData<F>,
}

impl<F> Default for Scripted<F> {
    fn default() -> Self {
        Self { answer: None, states: 0, off: false, format: PhantomData }
    }
}

impl<F> Scripted<F> {
    fn take(&mut self, frame: &impl Frame) {
        let (function, length) = ((frame.id() >> 7) as u8, frame.data().len() as u8);
        if function != function::STATE && function != function::STATE_FD {
            defmt::info!("CAN takes {=u16:#x}", frame.id());
            return;
        }
        if self.states == 0 {
            defmt::info!("CAN takes a state of {=u8} bytes, {=u16:#x}", length, frame.id());
        }
        self.states += 1;
        self.off |= self.states == STATES;
        let id = frame.id() & !0x7F | NEIGHBOUR;
        self.answer = Some(Received::new(id, length, frame.data()));
    }
}

impl<F: Format> Controller for Scripted<F> {
    type Format = F;

    async fn exchange(&mut self, next: Option<&F::Frame>) -> Exchange {
        if let Some(answer) = self.answer.take() {
            return Exchange::Received(Some(answer));
        }
        let Some(frame) = next else { return pending().await };
        self.take(frame);
        Exchange::Taken
    }

    fn cancel(&mut self) {
        defmt::info!("CAN drops what it holds");
    }

    fn state(&self) -> BusState {
        if self.off { BusState::Off } else { BusState::Active }
    }

    fn counters(&self) -> (u8, u8) {
        if self.off { (248, 0) } else { (0, 0) }
    }

    fn restart(&mut self) {
        defmt::info!("CAN restarts");
        self.off = false;
    }
}
