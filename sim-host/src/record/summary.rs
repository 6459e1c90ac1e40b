//! `summary.json`, with the names and the order of the contract.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Serialize, Serializer};

use super::atomic::{RecordError, write_atomic};
use crate::bus::table::BusTables;
use crate::emergent::Contraction;
use crate::engine::Skew;
use crate::judge::{AbsenceSummary, Check, CounterSummary, ReferenceSummary};
use crate::scenario::Scenario;

/// What a run came to. A part that the run does not have is `null`, and so is a number that is not finite.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Summary {
    /// The scenario's title.
    pub scenario: String,
    /// The root of every random stream.
    pub seed: u64,
    /// The fidelity: `loopback`, `reference`, `emulator` or `bench`; `none` for a run without a bus.
    pub on: String,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of network ticks.
    pub ticks: u64,
    /// Tick period, in seconds.
    pub tick_s: f64,
    /// See [`TraceHash`](super::TraceHash); `null` where no `f32` node ran.
    pub trace_hash: Option<String>,
    /// How the funnels held.
    pub funnel: Option<FunnelSummary>,
    /// What each event did; left out where none happened.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<EventSummary>,
    /// How far apart the nodes ended.
    pub sync: Option<SyncSummary>,
    /// How far from the emergent dynamics.
    pub emergent: Option<EmergentSummary>,
    /// How far from the continuous-time reference.
    pub reference: Option<ReferenceSummary>,
    /// What the bus carried.
    pub bus: Option<BusSummary>,
    /// How far the nodes' clocks were apart; left out where they share one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clocks: Option<ClockSummary>,
    /// The nodes of a bench; left out where none ran.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bench: Option<BenchSummary>,
    /// What nodes have counted, over all of them; `null` where no `f32` node ran.
    pub counters: Option<CounterSummary>,
    /// The largest `|u|` over all nodes and ticks, in state units per second.
    pub max_input: f64,
    /// The scenario's expectations, in its order.
    pub expect: Vec<Expectation>,
    /// What every run must do, whether or not anything is expected.
    pub checks: Vec<Check>,
    /// Whether all expectations and checks hold (exit code 0).
    pub passed: bool,
    /// After how many ticks the run ended, and why, where it did so before its last one; else `null`.
    pub ended_early: Option<String>,
    /// Ids of the nodes that stopped by themselves, ascending; what they ended with is what they stopped at.
    pub stopped: Vec<u16>,
    /// Ticks that came a whole period late or more, over all nodes; only nodes with timers of their own have
    /// any.
    pub overruns: u64,
    /// Ids of nodes whose fields the program around the simulation computes, ascending: the result is not the
    /// firmware's. Left out where there is none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub own_fields: Vec<u16>,
    /// What such a run leaves out; left out itself where that is nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<&'static str>,
    /// Version of this program.
    pub version: &'static str,
    /// The command as typed, quoted for a shell.
    pub command: String,
    /// Wall time of the run, in seconds.
    pub wall_s: f64,
}

/// How the funnels held: the scenario's, by the true states of all nodes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct FunnelSummary {
    /// The largest `|nu| / psi` over all nodes and ticks.
    pub max_ratio: f64,
    /// Node-ticks with `|nu| >= psi`.
    pub breaches: u64,
    /// The same at ticks that events disturb, which do not count above; left out where nothing is expected of
    /// the recovery.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub during_events: Option<DuringEventsSummary>,
    /// Node-ticks of which the term is not known, since a state in it was not recorded.
    pub unknown: u64,
    /// Node-ticks of nodes without a neighbour that was there: they have no term.
    pub uncoupled: u64,
    /// Where a node has reopened its funnel, the largest ratio by its own; else `null`.
    pub reopened_ratio: Option<f64>,
    /// The same as nodes believe it; `null` where no `f32` node ran.
    pub believed: Option<BelievedSummary>,
}

/// How the funnels held from the begin of each event to `expect.recovered_within` after its end.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct DuringEventsSummary {
    /// The largest `|nu| / psi`.
    pub max_ratio: f64,
    /// Node-ticks with `|nu| >= psi`.
    pub breaches: u64,
    /// Node-ticks that were judged.
    pub node_ticks: u64,
}

/// What one event did: how the funnels held from its begin to the first event that begins after its end.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct EventSummary {
    /// What happened, as `events.txt` has it.
    pub event: String,
    /// Its begin, s.
    pub from_s: f64,
    /// Its end, s; `null` where links stay cut.
    pub to_s: Option<f64>,
    /// The largest `|nu| / psi`.
    pub max_ratio: f64,
    /// Node-ticks with `|nu| >= psi`.
    pub breaches: u64,
    /// Node-ticks that were judged.
    pub node_ticks: u64,
    /// Time from its end to the last tick outside, s; else `null`.
    pub recovered_s: Option<f64>,
    /// `inside`: all came back; `outside`: not before the next event began, or the run ended; `not seen`: there was no tick between.
    pub recovery: &'static str,
}

/// How the funnels held as nodes believe it: by what they have heard, in the funnels that they have made of
/// the scenario's.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct BelievedSummary {
    /// The largest `|nu| / psi` over all nodes and ticks.
    pub max_ratio: f64,
    /// Node-ticks with `|nu| >= psi`.
    pub breaches: u64,
}

/// How far apart the nodes ended.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct SyncSummary {
    /// `max x - min x` at the end, in state units.
    pub final_spread: f64,
    /// The largest over all ticks, the start included, in state units.
    pub max_spread: f64,
    /// `2 sqrt(N) / lambda2 * max psi` at the end, in state units.
    pub bound: f64,
    /// Algebraic connectivity of the graph.
    pub lambda2: f64,
}

/// How far from the emergent dynamics, and what they promise. A part that the scenario does not have is
/// `null`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct EmergentSummary {
    /// Why the steps of the prediction do not resolve the fields: nothing else here is then a prediction, and
    /// no distance to it is given. Left out where they do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unresolved: Option<String>,
    /// `max |x_i - xi|` at the end, in state units.
    pub final_error: Option<f64>,
    /// `xi` at the end, in state units.
    pub xi_final: Option<PerComponent>,
    /// `max |x_i - blended|` at the end, in state units: the distance to the average of the fields.
    pub blended_error: Option<f64>,
    /// The blended dynamics at the end, in state units.
    pub blended_final: Option<PerComponent>,
    /// How fast the emergent dynamics contract.
    pub contraction: Option<Contraction>,
    /// `mu_i^-1(f_em - f_i)` at the end, by id: what `nu_i / psi_i` settles to under a narrow funnel.
    pub steady_ratio: Vec<f64>,
    /// The largest of their sizes over all steps of the prediction, by id: one minus it is the margin of a
    /// node.
    pub steady_ratio_max: Vec<f64>,
}

/// One value per component of a state: a number for scalar states, an array for vectors.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PerComponent(pub Vec<f64>);

impl Serialize for PerComponent {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.as_slice() {
            [value] => value.serialize(serializer),
            values => values.serialize(serializer),
        }
    }
}

/// What the bus carried.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct BusSummary {
    /// Share of the time that the bus was busy, 0 to 1; 0 on a bus without a bit rate.
    pub utilisation: f64,
    /// Frames sent.
    pub sent: u64,
    /// Frames lost on the way, counted per receiver.
    pub lost: u64,
    /// Frames for which a receiver had no room, in its controller or in the queue of its driver.
    pub no_room: u64,
    /// Frames that never went out: a newer one took their place.
    pub replaced: u64,
    /// Frames that a link has disturbed; on CAN such a frame is sent again.
    pub corrupted: u64,
    /// Frames that a link has brought twice.
    pub duplicated: u64,
    /// Frames that a link has brought after the next one.
    pub reordered: u64,
    /// Frames that a decoder refused, by reason.
    pub refused: BTreeMap<String, u64>,
    /// The CAN buses, by identifier; left out where there was none.
    #[serde(skip_serializing_if = "BusTables::is_empty")]
    pub can: BusTables,
}

/// Clocks of simulated nodes, and the time that they kept.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ClockSummary {
    /// Whether a time master kept them together.
    pub sync: bool,
    /// Difference between the fastest and the slowest running node that 99 of 100 ticks do not exceed, s; up
    /// to a sixteenth too long.
    pub skew_p99_s: f64,
    /// The largest, s.
    pub skew_max_s: f64,
    /// SYNC that were given to the bus.
    pub syncs: u64,
    /// How often a node became time master.
    pub masters: u64,
}

impl ClockSummary {
    /// Of what came of the clocks in a run of `scenario`.
    pub fn of(skew: &Skew, scenario: &Scenario) -> Self {
        let seconds = |ns: u64| ns as f64 / 1e9;
        Self {
            sync: scenario.sync.is_some(),
            skew_p99_s: skew.p99_ns.map_or(f64::NAN, seconds),
            skew_max_s: seconds(skew.worst_ns),
            syncs: skew.syncs,
            masters: skew.masters,
        }
    }
}

/// The nodes of a bench, beside the same run in loopback.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct BenchSummary {
    /// Whether all nodes showed the bits of loopback at every tick of the scenario: tick number, state,
    /// diffusive term, funnel and input.
    pub bit_for_bit: bool,
    /// Node-ticks of which nothing was recorded, or not all.
    pub unrecorded: u64,
    /// Nodes that were away for a time, in the order in which they were lost.
    pub absences: Vec<AbsenceSummary>,
    /// Keys of the scenario that this bench did not do: what a real bus does not lose or delay, and kinds of events.
    pub skipped: Vec<String>,
    /// What nodes that ticked by their own clock did with it; left out where they ticked by SYNC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub own_clock: Option<OwnClockSummary>,
    /// The lines from node to node; left out where there were none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wires: Option<WiresSummary>,
    /// The CAN interfaces; left out where no node was on one.
    #[serde(skip_serializing_if = "PerInterface::is_empty")]
    pub can: PerInterface,
    /// By id.
    pub nodes: Vec<BenchNodeSummary>,
}

/// Nodes that ticked by their own clock.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct OwnClockSummary {
    /// Time from the first start that was written to the last, s.
    pub start_spread_s: f64,
    /// Largest time between the first and the last node that said what a tick came to, as the host read them,
    /// s.
    pub largest_skew_s: f64,
    /// The tick that it was at; `null` where no two nodes told of the same one.
    pub largest_skew_tick: Option<u64>,
    /// The same at the end: the median of the last hundred ticks that two nodes or more have told of, s; `null` where there
    /// was none.
    pub end_skew_s: Option<f64>,
    /// SYNC of time masters; left out where the nodes kept no time by it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sync: Option<BenchSyncSummary>,
    /// Node-ticks of which a state or telemetry was lost, or never sent by a node that was late: the last
    /// value stands in their place.
    pub missed: u64,
    /// By id.
    pub nodes: Vec<OwnClockNodeSummary>,
}

/// SYNC by which they kept one time.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct BenchSyncSummary {
    /// Frames of time masters.
    pub frames: u64,
    /// Those of them that an event kept back.
    pub kept: u64,
    /// How often another node than before was time master.
    pub masters: u64,
}

/// One of them.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct OwnClockNodeSummary {
    /// Its id.
    pub node: u8,
    /// Its ticks of which a part was lost.
    pub missed: u64,
    /// Its ticks whose outcome had not been read from its bus when it told the next tick on its line; zero
    /// where it is not on CAN.
    pub no_bus_time: u64,
    /// Its ticks that came a whole period late or more.
    pub overruns: u32,
    /// Values of neighbours that had not come when their tick ran, and were extrapolated.
    pub extrapolated: u32,
    /// States of neighbours that came after the tick that needed them. What is missing at the first tick is
    /// seen here alone: a neighbour that was never heard is not extrapolated.
    pub late: u32,
}

/// Lines from node to node.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct WiresSummary {
    /// How many.
    pub count: usize,
    /// Time that their states had before each SYNC, s.
    pub settle_s: f64,
    /// Values that had not come when their tick ran, on all lines, by the nodes' count.
    pub extrapolated: u64,
    /// States that came after the tick that needed them, likewise.
    pub late: u64,
}

/// What was heard on CAN.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct CanSummary {
    /// Its name.
    pub interface: String,
    /// Data frames, with those of this program.
    pub frames: u64,
    /// Frames of nodes that were not of this run.
    pub strangers: u64,
    /// Frames that were none of the real-time plane.
    pub unreadable: u64,
    /// States that were not relayed in a frame of CAN FD, since a component of them was lost on its way to
    /// this program.
    pub incomplete: u64,
    /// Errors that the controller reported.
    pub errors: u64,
    /// The last of them.
    pub last_error: Option<String>,
}

/// One per CAN interface, in the order of the bench file: an object where there is one, an array where there
/// are several.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PerInterface(pub Vec<CanSummary>);

impl PerInterface {
    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl Serialize for PerInterface {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.as_slice() {
            [interface] => interface.serialize(serializer),
            interfaces => interfaces.serialize(serializer),
        }
    }
}

/// One node of a bench.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct BenchNodeSummary {
    /// Its id.
    pub node: u8,
    /// What it was reached by.
    pub place: String,
    /// The unique number of its chip, 16 hexadecimal digits; 0 where it has none.
    pub uid: String,
    /// Version of its firmware.
    pub firmware: String,
    /// Frames from it that could not be read.
    pub unreadable: u64,
    /// Ticks of which nothing was recorded, or not all.
    pub unrecorded: u64,
    /// First tick at which a bit differs from loopback, or nothing was recorded; `null` if there is none.
    pub first_difference: Option<u64>,
    /// Largest distance of its state to loopback's, state units.
    pub largest_deviation: f64,
}

/// One line of `[expect]` and what the run made of it.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Expectation {
    /// The key in `[expect]`.
    pub name: String,
    /// The value in `[expect]`.
    pub limit: f64,
    /// What the run had; `null` if it could not be measured, which is a failure.
    pub value: Option<f64>,
    /// Whether it held.
    pub pass: bool,
}

impl Expectation {
    /// Holds if `value` is known, a number, and below `limit`.
    pub fn below(name: impl Into<String>, limit: f64, value: Option<f64>) -> Self {
        Self { name: name.into(), limit, value, pass: value.is_some_and(|v| v < limit) }
    }
}

impl Summary {
    /// Whether all expectations and checks hold.
    pub fn passes(&self) -> bool {
        self.expect.iter().all(|e| e.pass) && self.checks.iter().all(|check| check.pass)
    }

    /// The text of `summary.json`.
    pub fn to_json(&self) -> String {
        // Serialising plain structs with string keys into memory has no way to fail.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// Writes `summary.json`, whole or not at all.
    ///
    /// # Errors
    /// [`RecordError`], naming `path` and the reason.
    pub fn write(&self, path: impl Into<PathBuf>) -> Result<(), RecordError> {
        write_atomic(path, self.to_json().as_bytes())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) fn example() -> Summary {
        Summary {
            scenario: "Five <heterogeneous> agents".into(),
            seed: 1,
            on: "loopback".into(),
            nodes: 5,
            ticks: 20000,
            tick_s: 0.001,
            trace_hash: Some("00000000deadbeef".into()),
            funnel: Some(FunnelSummary { max_ratio: 0.955, ..FunnelSummary::default() }),
            sync: Some(SyncSummary { final_spread: 0.5, max_spread: 9.0, bound: 1.5, lambda2: 1.382 }),
            emergent: Some(EmergentSummary {
                unresolved: None,
                final_error: Some(0.25),
                xi_final: Some(PerComponent(vec![-3.0])),
                blended_error: Some(4.5),
                blended_final: Some(PerComponent(vec![1.5])),
                contraction: Some(Contraction { slowest: -0.75, mean: -1.0 }),
                steady_ratio: vec![0.5, -0.5],
                steady_ratio_max: vec![0.5, 0.75],
            }),
            bus: Some(BusSummary { refused: [("crc".into(), 3)].into(), sent: 7, ..BusSummary::default() }),
            expect: vec![
                Expectation::below("funnel_ratio", 1.0, Some(0.955)),
                Expectation::below("final_spread", 0.1, Some(0.5)),
                Expectation::below("reference_error", 0.001, None),
            ],
            checks: vec![Check { name: "stopped", pass: true, text: "no node stopped by itself".into() }],
            ..Summary::default()
        }
    }

    #[test]
    fn the_json_is_the_one_of_the_contract() {
        let expected = r#"{"scenario":"Five <heterogeneous> agents","seed":1,"on":"loopback","nodes":5,
            "ticks":20000,"tick_s":0.001,"trace_hash":"00000000deadbeef",
            "funnel":{"max_ratio":0.955,"breaches":0,"unknown":0,"uncoupled":0,"reopened_ratio":null,"believed":null},
            "sync":{"final_spread":0.5,"max_spread":9.0,"bound":1.5,"lambda2":1.382},
            "emergent":{"final_error":0.25,"xi_final":-3.0,"blended_error":4.5,"blended_final":1.5,
            "contraction":{"slowest":-0.75,"mean":-1.0},
            "steady_ratio":[0.5,-0.5],"steady_ratio_max":[0.5,0.75]},"reference":null,
            "bus":{"utilisation":0.0,"sent":7,"lost":0,"no_room":0,"replaced":0,"corrupted":0,"duplicated":0,"reordered":0,"refused":{"crc":3}},
            "counters":null,"max_input":0.0,"expect":[{"name":"funnel_ratio","limit":1.0,"value":0.955,"pass":true},
            {"name":"final_spread","limit":0.1,"value":0.5,"pass":false},
            {"name":"reference_error","limit":0.001,"value":null,"pass":false}],
            "checks":[{"name":"stopped","pass":true,"text":"no node stopped by itself"}],"passed":false,"ended_early":null,"stopped":[],"overruns":0,"version":"","command":"","wall_s":0.0}"#;
        let expected = expected.replace("\n            ", "");
        assert_eq!(serde_json::to_string(&example()).unwrap(), expected);
        assert!(!example().passes());
    }

    #[test]
    fn what_is_not_a_number_is_null_and_no_pass() {
        assert!(!Expectation::below("funnel_ratio", 1.0, Some(f64::NAN)).pass);
        let summary = Summary { wall_s: f64::INFINITY, ..Summary::default() };
        assert!(summary.to_json().contains("\"wall_s\": null"));
    }
}
