//! What nodes say that is not so: a false state, an old one once more, one in another node's name.
//!
//! Only states are false. The node itself goes on as it is, and its true state is judged as every other one.

use crate::scenario::{Detail, EventKind, EventSpec, Lie, Scenario, on_engine};
use funnelnet_protocol::message::{Component, Message, NodeId, TickStamp};
use std::collections::VecDeque;
use std::ops::Range;

/// What nodes say that is not so, by index.
#[derive(Clone, Debug)]
pub struct Lies {
    nodes: Vec<Vec<Tale>>,
    /// Where old states, and those in another name, go out: half a tick after the node's own, ns.
    later_ns: u64,
}

#[derive(Clone, Debug)]
struct Tale {
    /// Engine time, ns.
    during: Range<u64>,
    says: Says,
}

#[derive(Clone, Debug)]
enum Says {
    /// In place of its own states.
    False(Lie, Firsts),
    /// Beside them.
    As(NodeId, Lie, Firsts),
    /// Beside them: what it said so many ticks ago.
    Old(usize, VecDeque<Message>),
}

/// The states of a node when a lie begins, by component.
type Firsts = Vec<f32>;

impl Lies {
    /// Those of a scenario; none where all nodes are honest.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Option<Box<Self>> {
        if scenario.is_honest() {
            return None;
        }
        let tale = |event: &EventSpec| {
            let says = match event.detail {
                Detail::Lie(lie) => Says::False(lie, Firsts::new()),
                Detail::Impostor { name, lie } => {
                    Says::As(NodeId::new(u8::try_from(name + 1).ok()?)?, lie, Firsts::new())
                }
                Detail::Age(age) if event.kind == EventKind::Replayer => {
                    let ticks = usize::try_from(age / scenario.time.tick_ns).ok()?;
                    Says::Old(ticks * scenario.components(), VecDeque::new())
                }
                _ => return None,
            };
            Some(Tale { during: on_engine(&scenario.time, event.at_ns, event.end_ns()), says })
        };
        let of = |node: usize| {
            let events = scenario.events.iter().filter(|event| event.kind.is_of_lies());
            events.filter(|event| event.targets.nodes().contains(&node)).filter_map(tale).collect()
        };
        let nodes = (0..scenario.nodes.len()).map(of).collect();
        Some(Box::new(Self { nodes, later_ns: scenario.time.tick_ns / 2 }))
    }

    /// How much later than its own states a node says what is old or in another name, ns.
    #[must_use]
    pub fn later_ns(&self) -> u64 {
        self.later_ns
    }

    /// What node `index` says at `now` (ns) in place of `message`, and what it says later.
    pub fn tell(&mut self, index: usize, now: u64, message: Message) -> (Message, Vec<Message>) {
        let (mut said, mut later) = (message, Vec::new());
        let Message::State { source, component, tick, x } = message else { return (said, later) };
        for Tale { during, says } in self.nodes.get_mut(index).into_iter().flatten() {
            let t = now.saturating_sub(during.start) as f64 / 1e9;
            let is_now = during.contains(&now);
            match says {
                Says::False(lie, firsts) if is_now => {
                    let x = lie.of(first(firsts, component, x), x, t);
                    said = Message::State { source, component, tick, x };
                }
                // It comes before what the other one says at the next tick.
                Says::As(name, lie, firsts) if is_now => {
                    let x = lie.of(first(firsts, component, x), x, t);
                    let tick = TickStamp::full(tick.value().wrapping_add(1));
                    later.push(Message::State { source: *name, component, tick, x });
                }
                Says::Old(age, past) => {
                    if past.len() >= *age {
                        later.extend(past.pop_front().filter(|_| is_now));
                    }
                    past.push_back(message);
                }
                Says::False(..) | Says::As(..) => {}
            }
        }
        (said, later)
    }
}

/// The state of a component when a lie began: now, where it begins.
fn first(firsts: &mut Firsts, component: Component, x: f32) -> f32 {
    let at = usize::from(component.get());
    while firsts.len() <= at {
        firsts.push(x);
    }
    firsts.get(at).copied().unwrap_or(x)
}
