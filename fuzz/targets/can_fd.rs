//! What a CAN FD frame decodes to encodes to the same frame.
#![no_main]

use funnelnet_protocol::can_fd::{self, Content};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|frame: (u16, Vec<u8>)| {
    let (id, data) = frame;
    let again = match can_fd::decode(id, &data) {
        Ok(Content::Message(message)) => can_fd::encode(&message),
        Ok(Content::States(states)) => can_fd::encode_states(&states),
        Err(_) => return,
    };
    assert_eq!((again.id(), again.data()), (id & 0x7FF, &data[..]));
});
