//! What nodes that tick by their own clock say, put together tick by tick.
//!
//! Tick `k` of a node is its state stamped `k` and its telemetry of `k`, whenever they come. Lines keep
//! order, so a part that has not come when the node tells a later tick was lost, or was never sent: a node
//! that is late makes up for ticks and tells only the last of them. States on CAN come on another way than
//! the telemetry, so the outcome of a tick is waited for until the node tells the next one.

use super::{Stamps, observation};
use crate::engine::NOTHING;
use crate::presence::Presence;
use funnelnet_node::Observation;
use funnelnet_protocol::report::Telemetry;
use std::collections::VecDeque;
use std::time::Duration;

/// Ticks that a node may leave out before what it says is taken for nonsense.
const MAX_LEAP: u32 = 100_000;

/// What has come of one tick of one node.
#[derive(Clone, Debug, Default)]
struct Cell {
    /// By component, as far as they have come.
    x: Vec<Option<f32>>,
    telemetry: Vec<Option<Telemetry>>,
    stamps: Stamps,
}

/// One node.
#[derive(Clone, Debug, Default)]
struct Track {
    /// From the row that is closed next on.
    cells: VecDeque<Cell>,
    /// First tick of which it may still tell something.
    telling: u32,
    /// First tick that it has not run, once it has stopped.
    end: Option<u32>,
    /// Since then an event keeps it off.
    off: bool,
    /// It has been told to come, and the first tick that it tells is where it begins.
    comes: bool,
    /// Its states come on another way than its telemetry.
    apart: bool,
    /// Tick of its newest state that has come whole.
    newest: u32,
    /// First tick of one that has come during the run.
    began: Option<u32>,
    missed: u64,
    /// Rows that were closed before what their tick came to was read from its bus.
    no_bus_time: u64,
    /// The state in the last row that was closed before its end is not what it was.
    stale: bool,
}

/// A node's count cannot have come from the last one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Leap {
    /// First tick of which it might have told.
    pub(crate) from: u32,
    /// Tick that it named.
    pub(crate) to: u32,
}

/// The rows that are not whole yet.
#[derive(Clone, Debug)]
pub(crate) struct Recording {
    components: usize,
    /// Row that is closed next.
    tick: u32,
    tracks: Vec<Track>,
}

impl Recording {
    /// Of so many nodes whose states have so many components.
    pub(crate) fn new(nodes: usize, components: usize) -> Self {
        Self { components, tick: 0, tracks: vec![Track::default(); nodes] }
    }

    /// With the states of a node on another way than its telemetry.
    pub(crate) fn set_apart(&mut self, node: usize) {
        if let Some(track) = self.tracks.get_mut(node) {
            track.apart = true;
        }
    }

    /// First tick of which a node may still tell something.
    pub(crate) fn telling(&self, node: usize) -> u32 {
        self.tracks.get(node).map_or(0, |track| track.telling)
    }

    /// Node-ticks of a node of which a part was lost.
    pub(crate) fn missed(&self, node: usize) -> u64 {
        self.tracks.get(node).map_or(0, |track| track.missed)
    }

    /// Ticks that a node on CAN has run, and whose outcome had not been read from the bus when the row was
    /// closed: it was lost, or the line, which another thread reads, was quicker by a tick.
    pub(crate) fn without_bus_time(&self, node: usize) -> u64 {
        self.tracks.get(node).map_or(0, |track| track.no_bus_time)
    }

    /// Takes a component of a state stamped `tick`, which was read at `at`, and on CAN at `bus`.
    pub(crate) fn state(
        &mut self,
        node: usize,
        (tick, component, x): (u32, u8, f32),
        at: Duration,
        bus: Option<Duration>,
    ) {
        if let Some(slot) =
            self.cell(node, tick).and_then(|cell| Some((cell.x.get_mut(usize::from(component))?, x)))
        {
            *slot.0 = Some(slot.1);
        }
        if let Some(track) =
            self.tracks.get_mut(node).filter(|_| usize::from(component) + 1 >= self.components)
        {
            track.newest = track.newest.max(tick);
        }
        // It is what the tick before has come to.
        if let Some(cell) = tick.checked_sub(1).and_then(|tick| self.cell(node, tick)) {
            (cell.stamps.state, cell.stamps.bus) = (Some(at), bus);
        }
    }

    /// Takes telemetry, which was read at `at`.
    ///
    /// # Errors
    /// It is of a tick that the node cannot tell of now; nothing has changed.
    pub(crate) fn telemetry(&mut self, node: usize, told: &Telemetry, at: Duration) -> Result<(), Leap> {
        self.refuse(node, told)?;
        if let Some(cell) = self.cell(node, told.tick) {
            cell.stamps.telemetry = Some(at);
            if let Some(slot) = cell.telemetry.get_mut(usize::from(told.component)) {
                *slot = Some(*told);
            }
        }
        Ok(())
    }

    /// Takes note that a node has told of a tick, but nothing of what it told.
    ///
    /// # Errors
    /// It is of a tick that the node cannot tell of now; nothing has changed.
    pub(crate) fn refuse(&mut self, node: usize, told: &Telemetry) -> Result<(), Leap> {
        let row = self.tick;
        let Some(track) = self.tracks.get_mut(node) else { return Ok(()) };
        if track.comes {
            track.begin_at(told.tick.max(row));
        }
        let (from, to) = (track.telling, told.tick);
        if from > to && from - to <= MAX_LEAP && track.began == Some(from) {
            // Of before its first row, which others have closed without it.
            return Ok(());
        }
        if to.wrapping_sub(from) > MAX_LEAP {
            return Err(Leap { from, to });
        }
        let last = usize::from(told.component) + 1 >= self.components;
        track.telling = to.wrapping_add(u32::from(last));
        Ok(())
    }

    /// A node has stopped by itself; `tick` is the first that it has not run.
    pub(crate) fn stop(&mut self, node: usize, tick: u32) {
        if let Some(track) = self.tracks.get_mut(node) {
            track.end = Some(tick);
        }
    }

    /// Whether a node has run a tick, or may have: it has not stopped before.
    pub(crate) fn has_run(&self, node: usize, tick: u32) -> bool {
        self.tracks.get(node).is_some_and(|track| !track.has_ended(tick))
    }

    /// An event has taken a node off, whatever it has told.
    pub(crate) fn leave(&mut self, node: usize) {
        if let Some(track) = self.tracks.get_mut(node) {
            let told = track.telling;
            (track.end, track.off, track.comes) =
                (Some(track.end.map_or(told, |end| end.min(told))), true, false);
        }
    }

    /// A node that is off has been told to come.
    pub(crate) fn come(&mut self, node: usize) {
        if let Some(track) = self.tracks.get_mut(node) {
            track.cells.clear();
            track.comes = true;
        }
    }

    /// Whether a node that has been told to come has not told of a tick yet.
    pub(crate) fn is_coming(&self, node: usize) -> bool {
        self.tracks.get(node).is_some_and(|track| track.comes)
    }

    /// Whether something is awaited from a node.
    pub(crate) fn awaits(&self, node: usize) -> bool {
        self.tracks.get(node).is_some_and(Track::awaited)
    }

    /// Closes the next row, if it is whole or cannot become so any more: observations by index and then by
    /// component, in which a value that was lost stays the last one, and stamps and what is known of the
    /// node, by index.
    pub(crate) fn close(
        &mut self,
        observations: &mut [Observation<f32>],
        stamps: &mut [Stamps],
        presence: &mut [Presence],
    ) -> bool {
        let tick = self.tick;
        if self.tracks.iter().any(|track| track.is_open(tick)) {
            return false;
        }
        let slots = observations.chunks_mut(self.components.max(1)).zip(stamps).zip(presence);
        for (track, ((seen, stamps), presence)) in self.tracks.iter_mut().zip(slots) {
            let cell = track.cells.pop_front().unwrap_or_default();
            *presence = track.presence(tick, &cell);
            track.missed += u64::from(*presence == Presence::Unrecorded && !track.has_ended(tick));
            let awaits_bus = track.apart && !track.has_ended(tick);
            track.no_bus_time += u64::from(awaits_bus && cell.stamps.bus.is_none());
            *stamps = cell.stamps;
            if *presence == Presence::Off {
                seen.fill(NOTHING);
            } else {
                fill(seen, &cell);
            }
        }
        self.tick = tick.wrapping_add(1);
        true
    }

    /// The cell of a row that is not closed.
    fn cell(&mut self, node: usize, tick: u32) -> Option<&mut Cell> {
        let ahead = tick.checked_sub(self.tick).filter(|&ahead| ahead <= 2 * MAX_LEAP)? as usize;
        let cells = &mut self.tracks.get_mut(node)?.cells;
        if cells.len() <= ahead {
            cells.resize(ahead + 1, Cell::of(self.components));
        }
        cells.get_mut(ahead)
    }
}

impl Track {
    /// It runs from that tick on.
    fn begin_at(&mut self, tick: u32) {
        (self.end, self.off, self.comes, self.stale) = (None, false, false, false);
        (self.telling, self.newest, self.began) = (tick, tick, Some(tick));
    }

    fn awaited(&self) -> bool {
        self.end.is_none_or(|end| self.telling < end)
    }

    fn has_ended(&self, tick: u32) -> bool {
        self.end.is_some_and(|end| end <= tick)
    }

    /// What is known of the node at a tick that is closed with this cell. One that has stopped keeps its last
    /// state, if that has come.
    fn presence(&mut self, tick: u32, cell: &Cell) -> Presence {
        if !self.has_ended(tick) {
            self.stale = !cell.has_state();
        }
        match () {
            () if self.has_ended(tick) && self.off => Presence::Off,
            () if self.has_ended(tick) && !self.stale => Presence::Stopped,
            () if !self.has_ended(tick) && cell.is_whole() => Presence::Ran,
            () => Presence::Unrecorded,
        }
    }

    /// Whether something of a row may still come.
    fn is_open(&self, tick: u32) -> bool {
        if self.has_ended(tick) {
            return false;
        }
        let next = tick.wrapping_add(1);
        // The last tick of a node comes to nothing.
        let outcome = !self.apart || self.newest >= next || self.telling > next || self.end == Some(next);
        self.telling <= tick || !outcome
    }
}

impl Cell {
    fn of(components: usize) -> Self {
        Self { x: vec![None; components], telemetry: vec![None; components], stamps: Stamps::default() }
    }

    fn has_state(&self) -> bool {
        !self.x.is_empty() && self.x.iter().all(Option::is_some)
    }

    fn is_whole(&self) -> bool {
        self.has_state() && self.telemetry.iter().all(Option::is_some)
    }
}

/// Puts what has come in the place of what was seen at the tick before.
fn fill(seen: &mut [Observation<f32>], cell: &Cell) {
    for ((seen, x), telemetry) in seen.iter_mut().zip(&cell.x).zip(&cell.telemetry) {
        seen.x = x.unwrap_or(seen.x);
        if let Some(telemetry) = telemetry {
            *seen = observation(seen.x, telemetry);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: Duration = Duration::from_millis(1);

    /// What a recording of scalar states has closed so far, and what was seen last.
    struct Rows {
        recording: Recording,
        seen: Vec<Observation<f32>>,
        stamps: Vec<Stamps>,
        presence: Vec<Presence>,
    }

    impl Rows {
        fn of(nodes: usize) -> Self {
            let seen = vec![Observation::default(); nodes];
            let presence = vec![Presence::default(); nodes];
            Self {
                recording: Recording::new(nodes, 1),
                seen,
                stamps: vec![Stamps::default(); nodes],
                presence,
            }
        }

        fn state(&mut self, node: usize, tick: u32) {
            self.recording.state(node, (tick, 0, tick as f32), AT * tick, None);
        }

        fn told(&mut self, node: usize, tick: u32) {
            let telemetry = Telemetry { tick, component: 0, nu: tick as f32, psi: 2.0, u: 0.0 };
            self.recording.telemetry(node, &telemetry, AT * tick).unwrap();
        }

        fn close(&mut self) -> bool {
            self.recording.close(&mut self.seen, &mut self.stamps, &mut self.presence)
        }

        /// Tick, state and diffusive term of a node.
        fn last(&self, node: usize) -> (u32, f32, f32) {
            let Observation { tick, x, nu, .. } = self.seen[node];
            (tick, x, nu)
        }
    }

    #[test]
    fn a_row_is_closed_when_the_last_node_has_told_it() {
        let mut rows = Rows::of(2);
        for tick in 0..3 {
            rows.state(0, tick);
            rows.told(0, tick);
        }
        assert!(!rows.close());
        rows.state(1, 0);
        assert!(!rows.close(), "its telemetry is to come");
        rows.told(1, 0);
        assert!(rows.close() && !rows.close());
        assert_eq!((rows.last(0), rows.last(1)), ((0, 0.0, 0.0), (0, 0.0, 0.0)));
        // The state of tick 1 was read after tick 0 had run.
        assert_eq!((rows.stamps[0].state, rows.stamps[0].telemetry), (Some(AT), Some(Duration::ZERO)));
        assert_eq!((rows.recording.missed(0), rows.recording.missed(1)), (0, 0));
    }

    #[test]
    fn what_a_later_telemetry_overtakes_is_lost_counted_and_the_last_value_stays() {
        let mut rows = Rows::of(1);
        rows.state(0, 0);
        rows.told(0, 0);
        assert!(rows.close());
        // The telemetry of 1 and the state of 2 are lost.
        rows.state(0, 1);
        assert!(!rows.close());
        rows.told(0, 2);
        assert_eq!(rows.presence, [Presence::Ran]);
        assert!(rows.close());
        assert_eq!((rows.last(0), rows.presence[0]), ((0, 1.0, 0.0), Presence::Unrecorded));
        // Its telemetry has the tick, but its state is that of the tick before.
        assert!(rows.close());
        assert_eq!((rows.last(0), rows.presence[0]), ((2, 1.0, 2.0), Presence::Unrecorded));
        assert_eq!(rows.recording.missed(0), 2);
        assert!(!rows.close());
    }

    #[test]
    fn a_node_that_has_stopped_is_awaited_up_to_its_last_tick_and_misses_nothing_then() {
        let mut rows = Rows::of(1);
        rows.state(0, 0);
        rows.recording.stop(0, 1);
        assert!(!rows.close() && rows.recording.awaits(0));
        rows.told(0, 0);
        assert!(!rows.recording.awaits(0));
        assert!(rows.close() && rows.close() && rows.close());
        assert_eq!((rows.last(0), rows.recording.missed(0)), ((0, 0.0, 0.0), 0));
        assert_eq!(rows.presence, [Presence::Stopped]);
    }

    #[test]
    fn what_a_node_stopped_with_is_not_known_where_its_last_state_was_lost() {
        let mut rows = Rows::of(1);
        rows.state(0, 0);
        rows.told(0, 0);
        rows.recording.stop(0, 2);
        rows.told(0, 1);
        for expected in [Presence::Ran, Presence::Unrecorded, Presence::Unrecorded] {
            assert!(rows.close());
            assert_eq!(rows.presence, [expected]);
        }
        assert_eq!(rows.recording.missed(0), 1);
    }

    #[test]
    fn a_refused_telemetry_ends_its_tick_and_leaves_nothing() {
        let mut rows = Rows::of(1);
        rows.state(0, 0);
        rows.told(0, 0);
        rows.state(0, 1);
        let refused = Telemetry { tick: 1, nu: f32::NAN, ..Telemetry::default() };
        assert_eq!(rows.recording.refuse(0, &refused), Ok(()));
        assert!(rows.close() && rows.close());
        assert_eq!((rows.last(0), rows.presence[0]), ((0, 1.0, 0.0), Presence::Unrecorded));
    }

    #[test]
    fn a_state_on_another_way_is_waited_for_until_the_next_tick_is_told() {
        let mut rows = Rows::of(1);
        rows.recording.set_apart(0);
        rows.state(0, 0);
        rows.told(0, 0);
        assert!(!rows.close(), "what the tick came to has not come");
        rows.state(0, 1);
        assert!(rows.close());
        assert_eq!(rows.stamps[0].state, Some(AT));
        // That of 2 comes after what is told of 2, and still belongs to its rows.
        rows.told(0, 1);
        assert!(!rows.close());
        rows.told(0, 2);
        assert!(rows.close() && !rows.close());
        rows.state(0, 2);
        rows.state(0, 3);
        assert!(rows.close());
        assert_eq!((rows.last(0), rows.recording.missed(0)), ((2, 2.0, 2.0), 0));
        // The last tick comes to nothing.
        rows.recording.stop(0, 4);
        rows.told(0, 3);
        assert!(rows.close());
        assert_eq!((rows.last(0), rows.recording.missed(0)), ((3, 3.0, 3.0), 0));
    }

    #[test]
    fn a_row_that_the_line_closes_before_the_bus_is_read_is_counted_and_lost_nothing() {
        let mut rows = Rows::of(1);
        rows.recording.set_apart(0);
        let heard = |rows: &mut Rows, tick: u32| {
            rows.recording.state(0, (tick, 0, tick as f32), AT * tick, Some(AT * tick));
        };
        heard(&mut rows, 0);
        rows.told(0, 0);
        heard(&mut rows, 1);
        assert!(rows.close());
        assert_eq!((rows.stamps[0].bus, rows.recording.without_bus_time(0)), (Some(AT), 0));
        // The telemetry of 2 is read before the state of 2, which is what tick 1 has come to.
        rows.told(0, 1);
        rows.told(0, 2);
        assert!(rows.close());
        assert_eq!((rows.stamps[0].bus, rows.recording.without_bus_time(0)), (None, 1));
        heard(&mut rows, 2);
        heard(&mut rows, 3);
        assert!(rows.close());
        assert_eq!((rows.last(0), rows.stamps[0].bus), ((2, 2.0, 2.0), Some(AT * 3)));
        assert_eq!((rows.recording.without_bus_time(0), rows.recording.missed(0)), (1, 0));
    }

    #[test]
    fn every_component_belongs_to_a_row() {
        let mut recording = Recording::new(1, 2);
        let (mut seen, mut stamps) = (vec![Observation::default(); 2], vec![Stamps::default()]);
        let telemetry = |component| Telemetry { tick: 0, component, nu: 1.0, psi: 2.0, u: 0.0 };
        recording.state(0, (0, 0, 3.0), AT, None);
        recording.state(0, (0, 1, 4.0), AT, None);
        recording.telemetry(0, &telemetry(0), AT).unwrap();
        let mut presence = vec![Presence::Absent];
        assert!(!recording.close(&mut seen, &mut stamps, &mut presence));
        recording.telemetry(0, &telemetry(1), AT).unwrap();
        assert!(recording.close(&mut seen, &mut stamps, &mut presence));
        assert_eq!(presence, [Presence::Ran]);
        assert_eq!((seen[0].x, seen[1].x, seen[1].ratio, recording.missed(0)), (3.0, 4.0, 0.5, 0));
    }

    #[test]
    fn a_tick_that_goes_back_or_far_ahead_is_nonsense() {
        let mut rows = Rows::of(1);
        rows.told(0, 4);
        let mut tell = |tick| rows.recording.telemetry(0, &Telemetry { tick, ..Telemetry::default() }, AT);
        assert_eq!(tell(4), Err(Leap { from: 5, to: 4 }));
        assert_eq!(tell(6 + MAX_LEAP), Err(Leap { from: 5, to: 6 + MAX_LEAP }));
        assert_eq!(tell(5 + MAX_LEAP), Ok(()));
    }
}
