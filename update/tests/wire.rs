//! Frames of an update: total decoders, and bytes that stay.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail so")]

use funnelnet_protocol::service::{Body, MAX_REPLY_BODY, Reply};
use funnelnet_protocol::update::{
    self, Block, Checksum, Image, MAX_BLOCK, Request, Status, UPDATE, UPDATED, UpdateError, board_number,
};
use proptest::prelude::*;

fn bytes(body: &impl Body) -> Vec<u8> {
    let mut out = [0; 600];
    let length = body.encode(&mut out).unwrap();
    out[..length].to_vec()
}

fn reply(reply: update::Reply) -> Vec<u8> {
    bytes(&Reply::Update(reply))
}

#[test]
fn the_bytes_of_requests_and_replies_stay() {
    let crc = Checksum::of(b"123456789");
    assert_eq!(crc, 0xCBF4_3926, "the check value of CRC-32/ISO-HDLC");
    assert_eq!(board_number("rp2040-pico"), Checksum::of(b"rp2040-pico"));
    assert_eq!(bytes(&Request::Status { length: 300 }), [0, 0xAC, 0x02]);
    assert_eq!(bytes(&Request::Begin(Image { board: 1, length: 256, crc: 127 })), [1, 1, 0x80, 0x02, 127]);
    let block = Block { offset: 512, crc: 5, bytes: [9, 8].into_iter().collect() };
    assert_eq!(bytes(&Request::Block(block)), [2, 0x80, 0x04, 5, 2, 9, 8]);
    for (number, request) in [(3, Request::Check), (4, Request::Swap), (5, Request::Restart)] {
        assert_eq!(bytes(&request), [number]);
    }
    assert_eq!(reply(update::Reply::Begun(Ok(()))), [1, 0]);
    assert_eq!(reply(update::Reply::Written(Ok(256))), [2, 0, 0x80, 0x02]);
    assert_eq!(reply(update::Reply::Written(Err(UpdateError::Order { next: 7 }))), [2, 1, 5, 7]);
    assert_eq!(reply(update::Reply::Checked(Err(UpdateError::NotBegun))), [3, 1, 4]);
    assert_eq!(reply(update::Reply::Restarts(Err(UpdateError::Flash))), [4, 1, 11]);
}

#[test]
fn the_longest_of_each_fits_its_frame() {
    let all = u32::MAX;
    let status = Status {
        board: all,
        room: all,
        crc: all,
        on_trial: true,
        ticks_left: all,
        received: all,
        is_checked: true,
        refused: all,
        repeated: all,
    };
    assert!(reply(update::Reply::Status(status)).len() <= MAX_REPLY_BODY);
    let block = Block { offset: all, crc: all, bytes: [0xFF; MAX_BLOCK].into_iter().collect() };
    assert!(bytes(&Request::Block(block)).len() <= funnelnet_protocol::serial::MAX_BODY);
}

proptest! {
    #[test]
    fn any_bytes_are_a_request_or_refused(body in prop::collection::vec(any::<u8>(), 0..600), kind in any::<u8>()) {
        if let Ok(request) = Request::decode(kind, &body) {
            prop_assert_eq!(kind, UPDATE);
            prop_assert_eq!(Request::decode(UPDATE, &bytes(&request)), Ok(request));
        }
    }

    #[test]
    fn any_bytes_are_a_reply_or_refused(body in prop::collection::vec(0..12_u8, 0..60)) {
        if let Ok(reply) = Reply::decode(UPDATED, &body) {
            prop_assert_eq!(Reply::decode(UPDATED, &bytes(&reply)), Ok(reply));
        }
    }

    /// The kinds that there were are what they were.
    #[test]
    fn a_request_of_another_kind_is_none_of_an_update(kind in any::<u8>(), body in prop::collection::vec(any::<u8>(), 0..20)) {
        prop_assert!(kind == UPDATE || Request::decode(kind, &body).is_err());
    }
}
