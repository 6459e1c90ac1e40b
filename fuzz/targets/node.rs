//! A node with any configuration that is accepted, and any messages: no panic, no state or input that is not finite, a bounded number of actions.
#![no_main]

use funnelnet_node::{Action, Node, Params, Phase};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::can;
use funnelnet_protocol::message::{Command, Message, Target};
use libfuzzer_sys::fuzz_target;

/// More actions at one time than a node of 8 components and 126 neighbours can have.
const MOST_ACTIONS: usize = 2_000;

fuzz_target!(|input: (Vec<u8>, Vec<(u16, [u8; 8], u8, u32)>)| {
    let (bytes, script) = input;
    let mut config = NodeConfig::empty();
    if config.read(&bytes).is_err() {
        return;
    }
    let Ok(params) = Params::<f32>::new(&config) else { return };
    let mut node = Node::new(params, &config.neighbours);
    let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
    let _ = node.on_message(&start, 0);
    let mut now = 0;
    for (id, data, length, later) in script {
        if let Ok(message) = can::decode(id, &data[..usize::from(length % 9)]) {
            let _ = node.on_message(&message, now);
        }
        let mut actions = 0;
        while let Some(action) = node.poll(now) {
            actions += 1;
            assert!(actions < MOST_ACTIONS);
            if let Action::Send(Message::State { x, .. }) = action {
                assert!(x.is_finite());
            }
        }
        if node.phase() == Phase::Running {
            assert!(node.state().all(f32::is_finite));
            assert!(node.observations().iter().all(|seen| seen.u.is_finite()));
        }
        now += u64::from(later);
    }
});
