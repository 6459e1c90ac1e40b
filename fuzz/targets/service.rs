//! Requests and replies: what decodes encodes to the same body; a configuration that is read over another is
//! the one that was sent.
#![no_main]

use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::{Body, Reply, Request};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|frame: (u8, Vec<u8>)| {
    let (kind, body) = frame;
    let mut room = [0; 2048];
    if let Ok(request) = Request::<NodeConfig>::decode(kind, &body) {
        let length = request.encode(&mut room).expect("what was read has room");
        let again = Request::<NodeConfig>::decode(kind, &room[..length]);
        assert_eq!(format!("{again:?}"), format!("{:?}", Ok::<_, ()>(&request)));
    }
    if let Ok(reply) = Reply::decode(kind, &body) {
        let length = reply.encode(&mut room).expect("what was read has room");
        let again = Reply::decode(kind, &room[..length]);
        assert_eq!(format!("{again:?}"), format!("{:?}", Ok::<_, ()>(&reply)));
    }
    let mut config = NodeConfig::empty();
    let _ = config.read(&body);
});
