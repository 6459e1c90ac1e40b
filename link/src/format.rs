//! The two formats of CAN frames: how what a node says becomes frames, and frames what it hears.
//!
//! In the classic format a message is a frame. In that of CAN FD the components of a state travel together:
//! they are collected while the node says them, one right after the other, and the frame is complete when it
//! says something else or nothing more.

use funnelnet_protocol::can::{self, CanFrame};
use funnelnet_protocol::can_fd::{self, Content, FdFrame, States};
use funnelnet_protocol::message::{Component, Message};
use funnelnet_protocol::refusal::Refusal;

/// A frame with an 11-bit identifier.
pub trait Frame {
    /// Identifier.
    fn id(&self) -> u16;

    /// Data field.
    fn data(&self) -> &[u8];
}

impl Frame for CanFrame {
    fn id(&self) -> u16 {
        self.id()
    }

    fn data(&self) -> &[u8] {
        self.data()
    }
}

impl Frame for FdFrame {
    fn id(&self) -> u16 {
        self.id()
    }

    fn data(&self) -> &[u8] {
        self.data()
    }
}

/// A format: what is collected to be sent, and what was received and not handed over yet.
pub trait Format: Default {
    /// Its frames.
    type Frame: Frame;

    /// Takes a message to send; gives the frames that are complete with it, at most two, in order.
    fn pack(&mut self, message: &Message) -> [Option<Self::Frame>; 2];

    /// The node has nothing more to say: the frame that was collected.
    fn flush(&mut self) -> Option<Self::Frame>;

    /// Takes a received data frame. What is left of the one before is lost.
    fn receive(&mut self, id: u16, data: &[u8]);

    /// The next thing that the received frame says, or the reason for refusing it.
    fn unpack(&mut self) -> Option<Result<Message, Refusal>>;
}

/// The classic format.
#[derive(Debug, Default)]
pub struct Classic {
    received: Option<Result<Message, Refusal>>,
}

impl Format for Classic {
    type Frame = CanFrame;

    fn pack(&mut self, message: &Message) -> [Option<CanFrame>; 2] {
        [Some(can::encode(message)), None]
    }

    fn flush(&mut self) -> Option<CanFrame> {
        None
    }

    // Inlined because what was received then need not go through memory (`./ci.sh cost`).
    #[inline]
    fn receive(&mut self, id: u16, data: &[u8]) {
        self.received = Some(can::decode(id, data));
    }

    #[inline]
    fn unpack(&mut self) -> Option<Result<Message, Refusal>> {
        self.received.take()
    }
}

/// The format of CAN FD.
#[derive(Debug, Default)]
pub struct Fd {
    collected: Option<States>,
    received: Option<Result<Content, Refusal>>,
    /// Components of the received state that were handed over.
    unpacked: usize,
}

impl Format for Fd {
    type Frame = FdFrame;

    fn pack(&mut self, message: &Message) -> [Option<FdFrame>; 2] {
        if self.collected.as_mut().is_some_and(|states| states.add(message)) {
            return [None, None];
        }
        let before = self.flush();
        match *message {
            Message::State { source, component: Component::FIRST, tick, x } => {
                self.collected = Some(States::new(source, tick, x));
                [before, None]
            }
            // The core begins with the first component; a frame cannot say another one without it.
            Message::State { .. } => [before, None],
            _ => [before, Some(can_fd::encode(message))],
        }
    }

    fn flush(&mut self) -> Option<FdFrame> {
        self.collected.take().as_ref().map(can_fd::encode_states)
    }

    fn receive(&mut self, id: u16, data: &[u8]) {
        (self.received, self.unpacked) = (Some(can_fd::decode(id, data)), 0);
    }

    fn unpack(&mut self) -> Option<Result<Message, Refusal>> {
        let Some(Ok(Content::States(states))) = &self.received else {
            return self.received.take().map(|content| match content {
                Ok(Content::Message(message)) => Ok(message),
                Ok(Content::States(_)) => Err(Refusal::Value),
                Err(reason) => Err(reason),
            });
        };
        let message = states.message(self.unpacked);
        self.unpacked += 1;
        if message.is_none() {
            self.received = None;
        }
        message.map(Ok)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use funnelnet_protocol::message::{NodeId, TickStamp};
    use std::vec::Vec;

    fn state(component: u8, tick: TickStamp) -> Message {
        let (source, component) = (NodeId::new(5).unwrap(), Component::new(component).unwrap());
        Message::State { source, component, tick, x: f32::from(component.get()) + 0.5 }
    }

    fn edge() -> Message {
        Message::Edge { source: NodeId::new(5).unwrap(), neighbour: NodeId::new(6).unwrap(), weight: 1.5 }
    }

    /// What a receiver hears of the frames of these messages.
    fn heard<F: Format>(messages: &[Message]) -> Vec<Vec<Message>> {
        let (mut sender, mut receiver) = (F::default(), F::default());
        let mut frames: Vec<_> = messages.iter().flat_map(|message| sender.pack(message)).flatten().collect();
        frames.extend(sender.flush());
        assert!(sender.flush().is_none());
        let hear = |frame: F::Frame| {
            receiver.receive(frame.id(), frame.data());
            core::iter::from_fn(|| receiver.unpack()).map(Result::unwrap).collect()
        };
        frames.into_iter().map(hear).collect()
    }

    #[test]
    fn components_travel_together_and_everything_else_alone() {
        let of = |tick: u32, bits| (0..3).map(move |component| state(component, TickStamp::low(tick, bits)));
        let said: Vec<_> = of(7, 32).chain([edge()]).chain(of(8, 32)).chain(of(9, 32)).collect();
        let [seven, eight, nine] = [7, 8, 9].map(|tick| of(tick, 16).collect::<Vec<_>>());
        assert_eq!(heard::<Fd>(&said), [seven, std::vec![edge()], eight, nine]);
        assert_eq!(heard::<Classic>(&said).len(), 10);
    }

    #[test]
    fn a_state_that_is_overtaken_by_the_next_tick_goes_with_the_components_that_were_said() {
        let full = TickStamp::full;
        let said = [state(0, full(7)), state(1, full(7)), state(0, full(8)), state(2, full(8))];
        let low = |tick| TickStamp::low(tick, 16);
        // The last one has no place without the one before it.
        let expected = [std::vec![state(0, low(7)), state(1, low(7))], std::vec![state(0, low(8))]];
        assert_eq!(heard::<Fd>(&said), expected);
    }

    #[test]
    fn what_cannot_be_read_is_refused_once() {
        let mut format = Fd::default();
        format.receive(0x185, &[0; 5]);
        assert_eq!((format.unpack(), format.unpack()), (Some(Err(Refusal::Kind)), None));
    }
}
