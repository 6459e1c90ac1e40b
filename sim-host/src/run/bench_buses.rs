//! What was on the CAN buses of a bench, by identifier: a table made of what their log holds.

use super::error::RunError;
use super::rows::Rows;
use crate::bus::table::{BusTable, BusTables};
use crate::record::{OnBus, Row};
use crate::scenario::{BusModel, Scenario};
use funnelnet_can_bus::record::ERROR;
use funnelnet_can_bus::{Id, Length, Record, Table, Timing};
use funnelnet_protocol::can::function;

/// Class of an error that says bus-off (linux/can/error.h).
const BUS_OFF: u32 = 0x40;
/// Class of an error of the controller, and its byte that says error-passive.
const CONTROLLER: u32 = 0x04;
const PASSIVE: u8 = 0x30;
/// Classes of errors on the wire: protocol, acknowledgement.
const ON_THE_WIRE: u32 = 0x08 | 0x20;

/// Rows on their way, with a table of what was heard beside them.
pub(super) struct Logged<'a> {
    rows: &'a mut dyn Rows,
    /// Bit rate of the buses, where the scenario says it.
    timing: Option<Timing>,
    /// Time of the whole run, ns.
    duration_ns: u64,
    buses: Vec<Bus>,
}

/// One interface.
#[derive(Default)]
struct Bus {
    interface: String,
    table: Table,
    /// Time of the last SYNC, ns.
    synced: Option<u64>,
    /// Time that the frames of a run took, from its first SYNC on, ns.
    busy_ns: u64,
    errors: u64,
    passive: u64,
    off: u64,
}

impl<'a> Logged<'a> {
    pub fn new(rows: &'a mut dyn Rows, scenario: &Scenario, interfaces: Vec<String>) -> Self {
        let timing = scenario.bus.timing().filter(|_| scenario.bus.model == BusModel::Can);
        let bus = |interface| Bus { interface, ..Bus::default() };
        let duration_ns = scenario.time.ticks.saturating_mul(scenario.time.tick_ns);
        Self { rows, timing, duration_ns, buses: interfaces.into_iter().map(bus).collect() }
    }

    /// The tables, by bus. Only of a `whole` run it is known for which part of its time a bus was busy.
    pub fn tables(&self, whole: bool) -> BusTables {
        let timing = self.timing.filter(|_| whole);
        let table = |bus: &Bus| BusTable {
            interface: bus.interface.clone(),
            bitrate: self.timing.map(|timing| timing.nominal().per_second()),
            utilisation: timing.map(|_| bus.busy_ns as f64 / self.duration_ns.max(1) as f64),
            error_frames: Some(bus.errors),
            error_passive: Some(bus.passive),
            bus_off: Some(bus.off),
            latency_from: bus.synced.map(|_| "sync"),
            ..BusTable::of_log(&bus.table)
        };
        BusTables(self.buses.iter().map(table).collect())
    }
}

impl Rows for Logged<'_> {
    fn take(&mut self, row: Row) -> Result<(), RunError> {
        self.rows.take(row)
    }

    fn hear(&mut self, heard: &[OnBus]) -> Result<(), RunError> {
        for (bus, record) in heard {
            if let Some(bus) = self.buses.get_mut(*bus) {
                bus.take(record, self.timing);
            }
        }
        self.rows.hear(heard)
    }
}

impl Bus {
    fn take(&mut self, record: &Record, timing: Option<Timing>) {
        if record.is_error() {
            self.take_error(record);
            return;
        }
        let Some((frame, passive)) = record.frame() else { return };
        let function = match frame.id() {
            Id::Base(id) => (id >> 7) as u8,
            Id::Extended(_) => u8::MAX,
        };
        if function == function::SYNC {
            self.synced = Some(record.at);
        }
        let is_state = (function::STATE..=function::STATE_FD).contains(&function);
        let latency = self.synced.filter(|_| is_state).map(|synced| record.at.saturating_sub(synced));
        self.table.add_logged(frame.id(), latency);
        if let Some(timing) = timing.filter(|_| self.synced.is_some()) {
            self.busy_ns += Length::of(&frame, passive).ns(timing);
        }
    }

    fn take_error(&mut self, record: &Record) {
        let class = record.id & !ERROR;
        self.errors += u64::from(class & ON_THE_WIRE != 0);
        self.off += u64::from(class & BUS_OFF != 0);
        let status = record.bytes().get(1).copied().unwrap_or(0);
        self.passive += u64::from(class & CONTROLLER != 0 && status & PASSIVE != 0);
    }
}
