//! What a classic CAN frame decodes to encodes to the same frame (of an id the low 11 bits count).
#![no_main]

use funnelnet_protocol::can;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|frame: (u16, Vec<u8>)| {
    let (id, data) = frame;
    if let Ok(message) = can::decode(id, &data) {
        let again = can::encode(&message);
        assert_eq!((again.id(), again.data()), (id & 0x7FF, &data[..]), "{message:?}");
    }
});
