//! A CAN controller that plays its part, so that a node on CAN can be tested where there is none.

use core::future::pending;

use funnel_link::BusState;
use funnel_protocol::can::{CanFrame, function};

use crate::link::can::{Controller, Exchange, Received};

/// States after which the controller goes off the bus, once.
const STATES: u32 = 50;
/// The neighbour that it plays.
const NEIGHBOUR: u16 = 2;

/// Takes every frame at once, answers each state with the same one from a neighbour, goes off the bus after [`STATES`], and comes
/// back when it is restarted. It logs what is not a state.
#[derive(Default)]
pub struct Scripted {
    answer: Option<Received>,
    states: u32,
    off: bool,
}

impl Scripted {
    fn take(&mut self, frame: &CanFrame) {
        if frame.id() >> 7 != u16::from(function::STATE) {
            defmt::info!("CAN takes {=u16:#x}", frame.id());
            return;
        }
        self.states += 1;
        self.off |= self.states == STATES;
        let mut data = [0; 8];
        data.iter_mut().zip(frame.data()).for_each(|(to, from)| *to = *from);
        let id = frame.id() & !0x7F | NEIGHBOUR;
        self.answer = Some(Received { id, length: frame.data().len() as u8, data });
    }
}

impl Controller for Scripted {
    async fn exchange(&mut self, next: Option<&CanFrame>) -> Exchange {
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
