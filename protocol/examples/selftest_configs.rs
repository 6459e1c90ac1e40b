//! Configurations that `firmware/checks/selftest.py` sends, by the real encoder: a line each, name and body
//! of CONFIGURE in hexadecimal digits.
#![allow(clippy::expect_used, clippy::panic)]

use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{Field, Shape, scalar};
use funnelnet_protocol::serial::{self, Deframer, Frame, HOST, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::Request;

const MILLISECOND_NS: u32 = 1_000_000;

fn main() {
    print("plain", node(MILLISECOND_NS, 10.0));
    print("two-components", NodeConfig { initial_state: [1.0, -1.0].into_iter().collect(), ..two_fields() });
    for (name, tick_ns) in [("told", MILLISECOND_NS), ("slow", 10 * MILLISECOND_NS)] {
        for width in [10.0, 20.0] {
            print(&format!("{name}-{width}"), NodeConfig { telemetry_every: 1, ..node(tick_ns, width) });
        }
    }
}

/// Node 3 at 1 with the timer as tick source, `f(x) = -x`, one edge of weight 1 to node 2, and a constant
/// funnel.
fn node(tick_ns: u32, width: f32) -> NodeConfig {
    let field = Field { slope: [-1.0].into_iter().collect(), offset: scalar(0.0), sines: Default::default() };
    let builder = NodeConfig::builder(3, tick_ns).state([1.0]).state_limit(1e6).field(field);
    builder.funnel(Shape::Constant { width }).edge(2, 1.0).extrapolate_ticks(3).build().expect("a sound node")
}

/// The same with a field of two components.
fn two_fields() -> NodeConfig {
    let mut config = node(MILLISECOND_NS, 10.0);
    config.field = Field { offset: [0.0, 0.0].into_iter().collect(), ..config.field };
    config
}

fn print(name: &str, config: NodeConfig) {
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length = serial::encode_service(&Request::Configure(config), HOST, &mut scratch, &mut frame)
        .expect("room for every frame");
    let mut deframer: Deframer = Deframer::new();
    for &byte in &frame[..length - 1] {
        let _ = deframer.push(byte);
    }
    let Some(Ok(Frame::Service { body, .. })) = deframer.push(0) else { panic!("a frame of its own") };
    let digits: String = body.iter().map(|byte| format!("{byte:02x}")).collect();
    println!("{name} {digits}");
}
