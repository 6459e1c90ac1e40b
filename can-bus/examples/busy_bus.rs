//! A load for counting instructions: nodes of degree 4 on a bus, a state of each in each tick.
//! `busy_bus TICKS [NODES [losses]]` prints what was carried; with `losses`, lost arbitrations are reported
//! too.

use funnelnet_can_bus::{BitRate, Bus, Event, Filter, Frame, Id, Order, Quiet, Timing, What};

const TICK_NS: u64 = 20_000_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let ticks: u64 = arguments.next().ok_or("usage: busy_bus TICKS [NODES [losses]]")?.parse()?;
    let nodes: usize = arguments.next().map_or(Ok(100), |nodes| nodes.parse())?;
    let mut bus = Bus::new(Timing::classic(BitRate::new(1_000_000, 875)?), Quiet);
    bus.report_losses(arguments.next().as_deref() == Some("losses"));
    let id = |node: usize| Id::Base(0x180 + (node % nodes) as u16);
    for node in 0..nodes {
        let neighbours = [nodes - 2, nodes - 1, 1, 2].map(|by| id(node + by));
        bus.add(Order::Priority, neighbours.into_iter().fold(Filter::nothing(), Filter::and));
    }
    let (mut sent, mut received) = (0_u64, 0_u64);
    let mut waiting = Vec::new();
    for tick in 0..ticks {
        for node in 0..nodes {
            let value = (tick as f32 + node as f32).to_le_bytes();
            let data = [value[0], value[1], value[2], value[3], tick as u8];
            if !bus.send(node, Frame::data(id(node), &data)?) {
                return Err("a transmit buffer is not free after a whole tick".into());
            }
        }
        let end = (tick + 1) * TICK_NS;
        while let Some(next) = bus.next_at().filter(|&next| next <= end) {
            bus.advance(next, &mut |event: Event| match event.what {
                What::Sent { .. } => sent += 1,
                What::Received { .. } => waiting.push(event.node),
                _ => {}
            });
            // Their drivers take what was received.
            for node in waiting.drain(..) {
                received += u64::from(bus.receive(node).is_some());
            }
        }
        bus.advance(end, &mut |_| ());
    }
    println!("{sent} frames sent, {received} received");
    Ok(())
}
