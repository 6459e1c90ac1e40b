//! What must be so of every run.

use super::World;
use funnelnet_link::{Classic, Fd};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use sim_host::bus::{Medium, Power, Stamp, Traffic};
use sim_host::check::{self, Status};
use sim_host::configure::listeners;
use sim_host::engine::Engine;
use sim_host::judge::{Judge, Moment};
use sim_host::loopback::{self, can_bus, engine_on, ideal_bus, uart_bus};
use sim_host::presence::Presence;
use sim_host::scenario::{BusModel, EventKind, Scenario};
use std::fmt;

/// Time after the last event until all are to be inside, ns: a node that comes may wait for half a second before it speaks.
const RECOVERY_NS: u64 = 700_000_000;

/// What is not as it must be.
#[derive(Clone, Debug, PartialEq)]
pub enum Broken {
    /// A network cannot be made of what the reader takes.
    Refused(String),
    /// The run ends before its time.
    Short(u64),
    /// Something that a node that is on knows of itself is not a number.
    NotFinite(u64, usize),
    /// Frames are in no counter: so many were to arrive, so many did.
    Frames(u64, u64),
    /// Two runs differ.
    NotTheSame,
    /// `check` promised that the funnel is kept; the largest ratio.
    Promise(f64),
    /// Somebody is outside long after the last event; the tick and the node's index.
    Outside(u64, usize),
}

impl Broken {
    /// Whether it is the same kind.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(why) => write!(f, "no network: {why}"),
            Self::Short(tick) => write!(f, "the run ends at tick {tick}"),
            Self::NotFinite(tick, node) => write!(f, "tick {tick}: node {} is no number", node + 1),
            Self::Frames(due, came) => write!(f, "{due} frames were to arrive, {came} did"),
            Self::NotTheSame => f.write_str("two runs differ"),
            Self::Promise(ratio) => {
                write!(f, "check promised that the funnel is kept; the largest ratio is {ratio}")
            }
            Self::Outside(tick, node) => {
                write!(f, "node {} is outside at tick {tick}, long after the last event", node + 1)
            }
        }
    }
}

/// What was seen of a world that is as it must be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// `check` promised that its funnel is kept.
    pub promised: bool,
    /// Its recovery was judged.
    pub recovers: bool,
    /// Its frames were counted.
    pub counted: bool,
    /// The largest ratio.
    pub ratio: f64,
    /// Hash of all that nodes saw.
    pub hash: u64,
}

/// Looks at a world: two runs of it, and what `check` says.
///
/// # Errors
/// What is not as it must be.
pub fn look(world: &World) -> Result<Seen, Broken> {
    let scenario = world.scenario().map_err(Broken::Refused)?;
    let seen = run(&scenario)?;
    if run(&scenario)?.hash != seen.hash {
        return Err(Broken::NotTheSame);
    }
    let promised = is_promised(&scenario);
    if promised && seen.ratio >= 1.0 {
        return Err(Broken::Promise(seen.ratio));
    }
    Ok(Seen { promised, ..seen })
}

/// Whether `check` has nothing to warn of, and has looked at all.
fn is_promised(scenario: &Scenario) -> bool {
    let report = check::check(scenario);
    [Status::Warn, Status::Fail, Status::NotChecked].iter().all(|&status| report.count(status) == 0)
}

fn run(scenario: &Scenario) -> Result<Seen, Broken> {
    let refused = |refused: loopback::Refused| Broken::Refused(refused.to_string());
    match scenario.bus.model {
        BusModel::Ideal => on(scenario, ideal_bus(scenario)),
        BusModel::Can => on(scenario, can_bus::<Classic>(scenario).map_err(refused)?),
        BusModel::CanFd => on(scenario, can_bus::<Fd>(scenario).map_err(refused)?),
        BusModel::Uart => on(scenario, uart_bus(scenario)),
    }
}

fn on<M: Medium>(scenario: &Scenario, medium: M) -> Result<Seen, Broken> {
    let counting = Counting { medium, listeners: listeners(scenario), due: 0, came: 0 };
    let mut engine: Engine<Counting<M>> =
        engine_on(scenario, counting).map_err(|refused| Broken::Refused(refused.to_string()))?;
    engine.start();
    let mut judge = Judge::new(scenario);
    let judged_from = judged_from(scenario);
    let (mut hash, mut outside, mut stopped) = (FNV, None, false);
    let (mut x, mut u) = (Vec::new(), Vec::new());
    for k in 0..=scenario.time.ticks {
        let Some(seen) = engine.advance().map(<[_]>::to_vec) else {
            // Where all have stopped there is nothing left to do.
            if engine.presence(k).iter().all(|presence| *presence == Presence::Stopped) {
                stopped = true;
                break;
            }
            return Err(Broken::Short(k));
        };
        let presence = engine.presence(k);
        for (node, seen) in seen.iter().enumerate() {
            let is_on = presence.get(node / scenario.components()) != Some(&Presence::Off);
            if is_on && ![seen.x, seen.u, seen.psi, seen.nu].iter().all(|value| value.is_finite()) {
                return Err(Broken::NotFinite(k, node));
            }
            for value in [seen.x, seen.u, seen.psi, seen.nu] {
                hash = (hash ^ u64::from(value.to_bits())).wrapping_mul(PRIME);
            }
        }
        x.clear();
        x.extend(seen.iter().map(|seen| f64::from(seen.x)));
        u.clear();
        u.extend(seen.iter().map(|seen| f64::from(seen.u)));
        // A node that has stopped for a good reason holds its state, and others cannot follow it.
        stopped |= presence.contains(&Presence::Stopped);
        judge.tick(&Moment { k, part: 0, x: &x, u: &u, presence: &presence }, None);
        if judged_from.is_some_and(|from| k >= from) && outside.is_none() {
            let is_outside = |(&nu, &psi): (&f64, &f64)| nu.abs() >= psi;
            outside = judge.terms().iter().zip(judge.psi()).position(is_outside).map(|node| (k, node));
        }
    }
    if let Some((tick, node)) = outside.filter(|_| !stopped) {
        return Err(Broken::Outside(tick, node));
    }
    let counted = frames(scenario, &mut engine)?;
    let ratio = judge.finish().max_ratio;
    Ok(Seen { promised: false, recovers: judged_from.is_some() && !stopped, counted, ratio, hash })
}

const FNV: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// The tick from which all have to be inside: after the last event, where the network by itself is inside, says `check`, and nobody has stopped for good.
fn judged_from(scenario: &Scenario) -> Option<u64> {
    let last = scenario.events.iter().map(|event| event.end_ns()).max()?;
    // A node that comes waits for SYNC first, and the only time master for ever.
    let keeps_time = !scenario.clocks.is_empty();
    let lasting = |kind: EventKind| match kind {
        EventKind::Impostor | EventKind::Crash | EventKind::Leave | EventKind::Set => true,
        EventKind::Bounce | EventKind::Join => keeps_time,
        _ => false,
    };
    let calm = Scenario {
        links: Vec::new(),
        clocks: Vec::new(),
        sync: None,
        bus: Default::default(),
        ..scenario.without_events()
    };
    let may_stop =
        scenario.safety.lost_neighbours > 0 || format!("{:?}", scenario.on_breach).contains("Stop");
    let is_lossy = !scenario.bus.loss.is_none() || !scenario.links.is_empty();
    let is_left_alone = may_stop || is_lossy || scenario.events.iter().any(|event| lasting(event.kind));
    (!is_left_alone && is_promised(&calm)).then(|| scenario.time.first_tick(last.saturating_add(RECOVERY_NS)))
}

/// On the ideal bus without a node that goes, each frame is heard, refused, lost, or still under way; on others each that came is heard or refused.
fn frames<M: Medium>(scenario: &Scenario, engine: &mut Engine<Counting<M>>) -> Result<bool, Broken> {
    // SYNC of nodes with clocks are for their clocks, and in no counter. A commit comes by no frame.
    if !scenario.stays_whole() || !scenario.clocks.is_empty() || !scenario.staged.is_empty() {
        return Ok(false);
    }
    let counted = |report: &Option<_>| report.as_ref().map_or(0, told);
    let heard: u64 = engine.reports().iter().map(counted).sum();
    let &Counting { due, came, .. } = engine.bus();
    // Each is told to start.
    let heard = heard.saturating_sub(scenario.nodes.len() as u64);
    if heard != came {
        return Err(Broken::Frames(came, heard));
    }
    if scenario.bus.model == BusModel::Ideal {
        let traffic = engine.traffic();
        let accounted = came + traffic.lost;
        let wanted = due + traffic.duplicated;
        // What is under way, or waits to be overtaken.
        let late = wanted.saturating_sub(accounted);
        if accounted > wanted || late > 4 * scenario.graph.edges.len() as u64 {
            return Err(Broken::Frames(wanted, accounted));
        }
    }
    Ok(true)
}

/// Messages that a node has counted, taken or refused.
fn told(report: &funnelnet_protocol::report::Report) -> u64 {
    let counters = &report.counters;
    u64::from(counters.accepted) + counters.all_refused()
}

/// A medium that counts what is to arrive, and what does.
struct Counting<M> {
    medium: M,
    listeners: Vec<Vec<usize>>,
    due: u64,
    came: u64,
}

impl<M: Medium> Medium for Counting<M> {
    fn send(&mut self, now: u64, sender: usize, message: &Message) {
        self.due += self.listeners.get(sender).map_or(0, |list| list.len() as u64);
        self.medium.send(now, sender, message);
    }

    fn flush(&mut self, now: u64, sender: usize) {
        self.medium.flush(now, sender);
    }

    fn computes(&mut self, node: usize, until: u64) {
        self.medium.computes(node, until);
    }

    fn next_arrival(&self) -> Option<u64> {
        self.medium.next_arrival()
    }

    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        let came = &mut self.came;
        self.medium.deliver(|receiver, heard| {
            *came += 1;
            receive(receiver, heard);
        });
    }

    fn deliver_before(
        &mut self,
        before: u64,
        mut receive: impl FnMut(u64, usize, Result<Message, Refusal>),
    ) -> Option<u64> {
        let came = &mut self.came;
        self.medium.deliver_before(before, |at, receiver, heard| {
            *came += 1;
            receive(at, receiver, heard);
        })
    }

    fn has_off(&self) -> bool {
        self.medium.has_off()
    }

    fn take_off(&mut self) -> Vec<(usize, u16)> {
        self.medium.take_off()
    }

    fn set_listeners(&mut self, listeners: Vec<Vec<usize>>) {
        self.medium.set_listeners(listeners);
    }

    fn take_stamps(&mut self) -> Vec<Stamp> {
        self.medium.take_stamps()
    }

    fn switch(&mut self, now: u64, node: usize, power: Power) {
        self.medium.switch(now, node, power);
    }

    fn traffic(&self) -> Traffic {
        self.medium.traffic()
    }
}
