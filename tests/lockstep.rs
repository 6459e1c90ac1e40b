//! Scenarios in lockstep on boards in memory, beside loopback: the real conductor drives sessions behind serial lines and
//! on CAN in virtual time.

use crate::run;
use crate::world::{Fate, Peace, World, conductor};
use funnelnet_node::Event;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::report::Report;
use sim_host::conductor::{HubError, Patience};
use sim_host::configure::Drive;
use sim_host::engine::NodeEvent;
use sim_host::judge::missed;
use sim_host::presence::Presence;
use sim_host::record::TraceHash;
use sim_host::run::{Fidelity, Outcome};
use sim_host::scenario::Scenario;
use std::time::Duration;

/// They tick by SYNC, and tell all they see.
pub const LOCKSTEP: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
/// For nodes that answer at once.
pub const PATIENCE: Patience = Patience { boot: Duration::from_secs(1), answer: Duration::from_secs(1) };
/// Time that a frame takes, ns.
pub const TRAVEL: u64 = 100_000;
/// What the hash takes for a state that is not there.
const NO_STATE: f32 = f32::from_bits(0x7fc0_0000);

/// What came of a scenario on boards in memory.
pub struct Ran {
    /// Of all states.
    pub hash: TraceHash,
    /// By tick and node.
    pub presence: Vec<Vec<Presence>>,
    /// The same with components, state units.
    pub x: Vec<Vec<f32>>,
    /// The same of the funnels.
    pub psi: Vec<Vec<f32>>,
    /// Frames that were lost.
    pub lost: u64,
    /// What nodes have said that cannot be so, and who has missed what was set.
    pub contradictions: Vec<String>,
    /// Index and tick of those who have adopted what was set.
    pub adopted: Vec<(usize, u32)>,
    /// Ids of nodes that nobody has heard, or that all have lost.
    pub unheard: (Vec<u16>, Vec<u16>),
    /// What nodes report at the end, by index.
    pub reports: Vec<Option<Report>>,
}

/// Runs a scenario, where the host has the power of the boards or not.
#[must_use]
pub fn on_boards(scenario: &Scenario, has_power: bool) -> Ran {
    on_buses(scenario, has_power, &[], false)
}

/// The same with nodes on these buses, of CAN FD if `fd`; the others are on lines.
#[must_use]
pub fn on_buses(scenario: &Scenario, has_power: bool, buses: &[&[usize]], fd: bool) -> Ran {
    let world = World::new(scenario.nodes.len(), TRAVEL, Peace);
    let mut world = buses.iter().fold(world, |world, nodes| world.with_bus(nodes, fd));
    world.has_power = has_power;
    in_world(scenario, &mut world, buses, fd).unwrap()
}

/// The same in a world with these buses.
///
/// # Errors
/// What ends the run.
pub fn in_world<F: Fate>(
    scenario: &Scenario,
    world: &mut World<F>,
    buses: &[&[usize]],
    fd: bool,
) -> Result<Ran, HubError> {
    let interfaces = (0..buses.len()).map(|bus| (format!("can{bus}"), fd)).collect();
    let bus_of = |node| buses.iter().position(|bus| bus.contains(&node));
    let mut conductor = conductor(scenario, LOCKSTEP, PATIENCE).with_can(interfaces, bus_of);
    world.run(conductor.meet())?;
    world.run(conductor.stage())?;
    world.run(conductor.start())?;
    let (mut hash, mut all, mut x, mut psi) = (TraceHash::new(), Vec::new(), Vec::new(), Vec::new());
    let components = scenario.components();
    for _ in 0..=scenario.time.ticks {
        world.run(conductor.advance())?;
        for (seen, presence) in conductor.observations().chunks(components).zip(conductor.presence()) {
            hash.extend(seen.iter().map(|seen| if presence.is_known() { seen.x } else { NO_STATE }));
        }
        all.push(conductor.presence().to_vec());
        x.push(conductor.observations().iter().map(|seen| seen.x).collect());
        psi.push(conductor.observations().iter().map(|seen| seen.psi).collect());
    }
    let reports = world.run(conductor.finish())?;
    let mut contradictions = conductor.contradictions();
    contradictions.extend(missed(scenario, conductor.missed_commits()));
    Ok(Ran {
        hash,
        presence: all,
        x,
        psi,
        lost: conductor.traffic().lost,
        contradictions,
        adopted: adopted(conductor.events()),
        unheard: (conductor.unheard(&reports), conductor.silent(&reports)),
        reports,
    })
}

/// Index and tick of those who have adopted what was set.
#[must_use]
pub fn adopted(events: &[NodeEvent]) -> Vec<(usize, u32)> {
    let of = |said: &NodeEvent| match said.event {
        Event::Adopted { tick } => Some((said.node, tick)),
        _ => None,
    };
    events.iter().filter_map(of).collect()
}

/// Compares a scenario on boards with loopback, and gives both.
pub fn compared(scenario: &Scenario, has_power: bool) -> (Outcome, Ran) {
    let boards = on_boards(scenario, has_power);
    as_loopback(scenario, boards)
}

/// Compares what came of a scenario with loopback, and gives both.
pub fn as_loopback(scenario: &Scenario, boards: Ran) -> (Outcome, Ran) {
    let loopback = run(scenario, Fidelity::Loopback);
    let events: Vec<_> = scenario.events.iter().map(ToString::to_string).collect();
    assert_eq!(boards.contradictions, loopback.contradictions, "{events:?}");
    for (k, row) in loopback.rows.iter().enumerate() {
        let known: Vec<bool> = row.x.chunks(scenario.components()).map(|x| !x[0].is_nan()).collect();
        let here: Vec<bool> = boards.presence[k].iter().map(|presence| presence.is_known()).collect();
        assert_eq!(here, known, "tick {k}: {events:?}");
        for (node, (there, here)) in row.x.iter().zip(&boards.x[k]).enumerate() {
            assert!(
                there.to_bits() == f64::from(*here).to_bits() || there.is_nan(),
                "state {node} at tick {k}: {there} and {here}: {:?}",
                scenario.events
            );
        }
        for (node, (there, here)) in row.psi.iter().zip(&boards.psi[k]).enumerate() {
            assert!(
                there.to_bits() == f64::from(*here).to_bits() || there.is_nan(),
                "funnel {node} at tick {k}: {there} and {here}: {events:?}"
            );
        }
    }
    assert_eq!(loopback.hash, Some(boards.hash), "{events:?}");
    assert_eq!(adopted(&loopback.events), boards.adopted, "{events:?}");
    assert_eq!(boards.lost, loopback.bus.as_ref().unwrap().lost);
    assert_eq!(boards.unheard, (loopback.unheard.clone(), loopback.silent.clone()), "{events:?}");
    for (here, there) in boards.reports.iter().zip(&loopback.counters) {
        let Some(Report { counters: here, .. }) = here else { continue };
        assert_eq!(here.breaches, there.breaches, "{events:?}");
    }
    (loopback, boards)
}
