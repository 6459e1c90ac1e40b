//! A saturated bus against the analysis of fixed-priority scheduling without preemption (Davis, Burns, Bril,
//! Lukkien: Controller Area Network schedulability analysis, Real-Time Systems 35, 2007), and the times of
//! single frames.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{
    BitRate, Bus, Filter, Frame, Id, Length, Noise, Order, Quiet, Timing, What, response,
};

const BIT: u64 = 2000;

fn rate(rate: u32, sample: u32) -> BitRate {
    BitRate::new(rate, sample).unwrap()
}

/// A frame that comes again and again.
struct Stream {
    frame: Frame,
    period: u64,
    /// Time on the bus, ns.
    time: u64,
}

/// One stream for each node, the most urgent ones with the shortest period: `period`, twice and four times
/// that.
fn streams(nodes: usize, period: u64, timing: Timing) -> Vec<Stream> {
    let stream = |node: usize| {
        let data: Vec<u8> = (0..8).map(|byte| (node * 37 + byte * 11) as u8).collect();
        let frame = Frame::data(Id::Base(0x180 + node as u16), &data).unwrap();
        Stream { frame, period: period << (3 * node / nodes), time: Length::of(&frame, false).ns(timing) }
    };
    (0..nodes).map(stream).collect()
}

fn utilisation(streams: &[Stream]) -> f64 {
    streams.iter().map(|stream| stream.time as f64 / stream.period as f64).sum()
}

/// The streams with the shortest period, to a percent, with which the analysis still says that each frame is
/// sent before the next one comes.
fn saturating(nodes: usize, timing: Timing) -> Vec<Stream> {
    let unit = 1_000_000;
    let full = utilisation(&streams(nodes, unit, timing)) * unit as f64;
    let period = |percent: u64| (full as u64 * percent / 100).div_ceil(BIT) * BIT;
    let fits = |streams: &Vec<Stream>| {
        analytic(streams).iter().zip(streams).all(|(&time, stream)| time <= stream.period)
    };
    (100..).map(|percent| streams(nodes, period(percent), timing)).find(fits).unwrap()
}

/// Longest response time of each stream, most urgent first: equations (3) to (5) of Davis et al., with the
/// arbitrary-deadline extension left out, since no response is longer than its period here.
fn analytic(streams: &[Stream]) -> Vec<u64> {
    let response = |at: usize| {
        // A frame that is less urgent may have just begun.
        let blocking = streams[at + 1..].iter().map(|other| other.time).max().unwrap_or(0);
        let mut queueing = blocking;
        loop {
            let interference =
                streams[..at].iter().map(|other| (queueing + BIT).div_ceil(other.period) * other.time);
            let next = blocking + interference.sum::<u64>();
            if next == queueing {
                return queueing + streams[at].time;
            }
            queueing = next;
        }
    };
    (0..streams.len()).map(response).collect()
}

/// Response time of the first frame of a stream, to the end of the intermission, in the worst case: the
/// longest less urgent frame has just begun when all frames that are at least as urgent come at once, and
/// come again with their periods.
fn worst(streams: &[Stream], of: usize, timing: Timing) -> u64 {
    let mut bus = Bus::new(timing, Quiet);
    for _ in 0..=streams.len() {
        bus.add(Order::Priority, Filter::nothing());
    }
    if let Some(longest) = streams[of + 1..].iter().max_by_key(|stream| stream.time) {
        assert!(bus.send(streams.len(), longest.frame));
    }
    // Too late to take part in its arbitration.
    let begun = timing.nominal().sample_ns() + 1;
    let mut next = vec![begun; of + 1];
    let mut response = None;
    while response.is_none() {
        let now = *next.iter().min().unwrap();
        bus.advance(now, &mut |event| {
            if let What::Sent { ready, started, .. } = event.what
                && event.node == of
            {
                response = response.or(Some(started + streams[of].time - ready));
            }
        });
        for node in (0..=of).filter(|&node| next[node] == now).collect::<Vec<_>>() {
            assert!(bus.send(node, streams[node].frame), "node {node} has not sent what it had at {now}");
            next[node] += streams[node].period;
        }
    }
    response.unwrap()
}

/// Part of the time for which the bus is busy with the streams.
fn busy(streams: &[Stream], timing: Timing, until: u64) -> f64 {
    let mut bus = Bus::new(timing, Quiet);
    for _ in 0..=streams.len() {
        bus.add(Order::Priority, Filter::nothing());
    }
    let mut next = vec![0; streams.len()];
    loop {
        let now = *next.iter().min().unwrap();
        bus.advance(now.min(until), &mut |_| ());
        if now >= until {
            return bus.busy_ns() as f64 / until as f64;
        }
        for node in (0..streams.len()).filter(|&node| next[node] == now).collect::<Vec<_>>() {
            assert!(bus.send(node, streams[node].frame), "node {node} has not sent what it had at {now}");
            next[node] += streams[node].period;
        }
    }
}

#[test]
fn worst_latencies_of_a_saturated_bus_are_those_of_the_analysis() {
    let timing = Timing::classic(rate(500_000, 875));
    for nodes in [5, 10, 20, 40, 64, 100, 120] {
        let streams = saturating(nodes, timing);
        let longest_frame = streams.iter().map(|stream| stream.time).max().unwrap();
        let bound = analytic(&streams);
        let of_crate: Vec<response::Stream> =
            streams.iter().map(|&Stream { period, time, .. }| response::Stream { time, period }).collect();
        let of_crate: Option<Vec<u64>> = response::longest(&of_crate, timing).into_iter().collect();
        assert_eq!(of_crate.as_ref(), Some(&bound), "{nodes}");
        let worst: Vec<u64> = (0..nodes).map(|node| worst(&streams, node, timing)).collect();
        let apart = |node: usize| bound[node].abs_diff(worst[node]);
        let most = (0..nodes).map(apart).max().unwrap();
        // Within a frame was asked for; the sample point, one nanosecond after which the frames come, is all
        // that is between them.
        assert!(most < BIT, "{nodes}: {worst:?} {bound:?}");
        // Whole hyperperiods, so that the load is exact but for what is on the way at the end.
        let until = 40 * 4 * streams[0].period;
        let (expected, busy) = (utilisation(&streams), busy(&streams, timing, until));
        println!(
            "{nodes} nodes: load {expected:.4}, busy {busy:.4}; latencies {most} ns from the analysis at most"
        );
        assert!(expected > 1.0 - 1.5 / nodes as f64, "{nodes}: {expected}");
        assert!((busy - expected).abs() * until as f64 <= longest_frame as f64, "{nodes}: {busy} {expected}");
    }
}

/// A queue that sends what came first has longer waits than the analysis of priorities says, so the agreement
/// above is not by itself.
#[test]
fn a_transmit_fifo_breaks_the_analysis() {
    let timing = Timing::classic(rate(500_000, 875));
    let wait = |order: Order| {
        let mut bus = Bus::new(timing, Quiet);
        (0..3).map(|_| bus.add(order, Filter::nothing())).for_each(drop);
        let frame = |id: u16| Frame::data(Id::Base(id), &[0xAA; 8]).unwrap();
        // Node 0 has an urgent frame behind one that is not; node 1 sends in between without end.
        assert!(bus.send(0, frame(0x700)) && bus.send(0, frame(0x001)));
        let mut urgent = None;
        while urgent.is_none() && bus.now() < 1_000_000_000 {
            while bus.free_buffers(1) > 0 {
                assert!(bus.send(1, frame(0x100)));
            }
            let next = bus.next_at().unwrap();
            bus.advance(next, &mut |event| {
                if event.node == 0
                    && matches!(event.what, What::Sent { frame, .. } if frame.id() == Id::Base(1))
                {
                    urgent = Some(event.at);
                }
            });
        }
        urgent
    };
    assert!(wait(Order::Priority).is_some_and(|at| at < 2 * 135 * BIT));
    assert_eq!(wait(Order::Fifo), None);
}

fn sent_at<N: Noise>(bus: &mut Bus<N>, frame: Frame) -> u64 {
    let mut at = None;
    assert!(bus.send(0, frame));
    bus.advance(1_000_000_000, &mut |event| {
        if let What::Sent { started, .. } = event.what {
            at = Some(event.at - started);
        }
    });
    at.unwrap()
}

/// 64 bytes at 500 kbit/s and 2 Mbit/s: by hand from the length, and slower without the switch by the ratio
/// of the rates.
#[test]
fn a_switch_of_rates_shortens_the_data() {
    let timing = Timing::fd(rate(500_000, 875), rate(2_000_000, 800)).unwrap();
    let time = |switch| {
        let mut bus = Bus::new(timing, Quiet);
        (0..2).map(|_| bus.add(Order::Priority, Filter::everything())).for_each(drop);
        let frame = Frame::fd(Id::Base(0x555), &[0x55; 64], switch).unwrap();
        let length = Length::of(&frame, false);
        let time = sent_at(&mut bus, frame);
        // To the sample point of the last bit, before the intermission.
        assert_eq!(time, length.ns(timing) - 4 * BIT + 1750);
        (time, length)
    };
    let ((slow, all), (fast, length)) = (time(false), time(true));
    assert_eq!(slow - fast, u64::from(length.fast) * (2000 - 500));
    assert_eq!(all.bits(), length.bits());
}
