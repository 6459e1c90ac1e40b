//! Keeps the time of a network on one node: hears SYNC, sends it where the node is time master, takes over
//! from a master that has fallen silent, and knows for how long nobody may be.

use super::map::Map;
use super::servo::{Servo, Taken};
use crate::observe::Event;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::message::{Message, NodeId, TickStamp, UNKNOWN_PHASE};
use funnelnet_protocol::refusal::Refusal;

/// A time master that is new sends so many SYNC faster, so that the others know its rate soon.
const QUICK: u8 = 16;
/// How much faster.
const QUICKER: u64 = 8;
/// Part of the time between two such SYNC by which the next one may miss its instant.
const NEAR: u64 = 4;
/// Half of what 24 bits of a tick can tell, and all of it.
const HALF: u32 = (1 << 23) - 1;
const WHOLE: u32 = (1 << 24) - 1;
const NS_PER_US: u64 = 1_000;
const NS_PER_MS: u64 = 1_000_000;

/// Nodes that may be time master.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masters(u128);

impl Masters {
    /// Masters with one node more.
    #[must_use]
    pub const fn and(self, id: NodeId) -> Self {
        Self(self.0 | 1 << id.get())
    }

    /// Whether `id` may be time master.
    #[must_use]
    pub const fn contains(self, id: NodeId) -> bool {
        self.0 >> id.get() & 1 == 1
    }

    /// How many of them come before `id`.
    const fn before(self, id: NodeId) -> u32 {
        (self.0 & ((1 << id.get()) - 1)).count_ones()
    }
}

/// Rules that a keeper is told before it starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// Id of the node.
    pub id: NodeId,
    /// Nodes that may be time master.
    pub masters: Masters,
    /// Time from one SYNC to the next, ns, at least a tick.
    pub period_ns: u64,
    /// Period of a tick of the network, ns, above zero.
    pub tick_ns: u64,
    /// Time for which the node goes on without a SYNC that it can use, ns; `None`: for ever.
    pub holdover_ns: Option<u64>,
    /// How far the stamp of a SYNC may be from the instant at which it was on the wire, ns; 0 for those of CAN
    /// controllers.
    pub jitter_ns: u64,
}

impl Rules {
    /// Those of a configuration that [`Params`](crate::Params) have accepted; none where its node keeps no time
    /// with others.
    #[must_use]
    pub fn of(config: &NodeConfig) -> Option<Self> {
        let said = &config.time;
        let id = NodeId::new(config.id).filter(|_| !said.is_none())?;
        Some(Self {
            id,
            masters: said.masters().filter_map(NodeId::new).fold(Masters::default(), Masters::and),
            period_ns: u64::from(said.period_us) * NS_PER_US,
            tick_ns: config.period_ns(),
            holdover_ns: holdover(config),
            jitter_ns: u64::from(said.jitter_us) * NS_PER_US,
        })
    }

    /// Time between the SYNC of a new master, ns.
    fn quick_ns(&self) -> u64 {
        quick(self.period_ns, self.tick_ns)
    }

    /// Time between those of one that has led for a while, ns.
    fn usual_ns(&self) -> u64 {
        whole_ticks(self.period_ns, self.tick_ns)
    }

    /// A master that was silent for so long (ns) is taken for dead: the third SYNC in a row would come next.
    /// Of several that may be master the lowest is the first to find so; `dead` is not counted.
    fn patience_ns(&self, dead: Option<NodeId>) -> u64 {
        let dead = dead.is_some_and(|dead| self.masters.contains(dead) && dead < self.id);
        let rank = self.masters.before(self.id).saturating_sub(u32::from(dead));
        let most = self.period_ns.saturating_mul(11) / 4;
        most.saturating_add(self.period_ns / 16 * u64::from(rank))
    }
}

/// What a configuration says of [`Rules::holdover_ns`].
pub(crate) fn holdover(config: &NodeConfig) -> Option<u64> {
    (config.holdover_ns > 0).then_some(config.holdover_ns)
}

/// The largest [`Rules::jitter_ns`] by which two SYNC of a new master are still told apart from three, ns: they come faster than
/// those of one that leads for long.
#[must_use]
pub fn largest_jitter(period_ns: u64, tick_ns: u64) -> u64 {
    quick(period_ns, tick_ns) / NEAR
}

/// The shortest [`Rules::period_ns`] with stamps of this [`Rules::jitter_ns`], ns: see [`largest_jitter`].
#[must_use]
pub fn shortest_period(jitter_ns: u64, tick_ns: u64) -> u64 {
    let tick_ns = tick_ns.max(1);
    match jitter_ns.saturating_mul(NEAR).div_ceil(tick_ns) {
        0 | 1 => tick_ns,
        ticks => ticks.saturating_mul(tick_ns).saturating_mul(QUICKER),
    }
}

/// Time between the SYNC of a new master, ns.
fn quick(period_ns: u64, tick_ns: u64) -> u64 {
    whole_ticks(period_ns / QUICKER, tick_ns)
}

/// `ns` in whole ticks, at least one.
fn whole_ticks(ns: u64, tick_ns: u64) -> u64 {
    let ticks = ns.checked_div(tick_ns).unwrap_or(0).max(1);
    ticks.saturating_mul(tick_ns)
}

/// Role of a node in keeping time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It has heard no time master.
    Waits,
    /// It follows that one.
    Follows(NodeId),
    /// It is time master.
    Leads,
}

/// Change of role or time that others may want to know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Change {
    /// The node is time master from now on.
    Leads,
    /// It follows that one from now on.
    Follows(NodeId),
    /// Its master is silent, and it goes on by itself.
    Alone,
}

impl From<Change> for Event {
    fn from(change: Change) -> Self {
        match change {
            Change::Leads => Self::TimeMaster,
            Change::Follows(id) => Self::Follows(id),
            Change::Alone => Self::NoTimeMaster,
        }
    }
}

/// Action to be taken next for a keeper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// Put this on the link; [`Keeper::on_sent`] has to follow when it is on the wire.
    Send(Message),
    /// Log or show this.
    Report(Change),
    /// No SYNC that could be used has come for so long, ms: the node has to stop.
    Lost {
        /// Silence, ms.
        silent_ms: u16,
    },
}

/// The keeper of a node's time.
#[derive(Clone, Debug)]
pub struct Keeper {
    rules: Rules,
    servo: Servo,
    role: Role,
    runs: bool,
    /// It has come to a network that runs.
    joins: bool,
    /// Network time of tick 0, ns.
    epoch: u64,
    /// Time of the last SYNC of the master that is followed, or of tick 0 (ns, own clock).
    heard_at: u64,
    /// Stamp of that SYNC, where there was one.
    stamp: Option<u64>,
    /// Time of the last SYNC that the map follows, or of the start (ns, own clock).
    taken_at: u64,
    /// Network time at which a master sends next, ns.
    due: u64,
    /// SYNC that it still sends fast.
    quick: u8,
    /// Stamp of the last one that went out.
    sent: Option<u64>,
    is_alone: bool,
    change: Option<Change>,
}

impl Keeper {
    /// A keeper that has not started: both clocks run alike.
    #[must_use]
    pub const fn new(rules: Rules) -> Self {
        Self {
            rules,
            servo: Servo::new(Map::new(0, 0), rules.jitter_ns),
            role: Role::Waits,
            runs: false,
            joins: false,
            epoch: 0,
            heard_at: 0,
            stamp: None,
            taken_at: 0,
            due: 0,
            quick: 0,
            sent: None,
            is_alone: false,
            change: None,
        }
    }

    /// Starts when the own clock shows `own`, which is network time `network`; tick 0 is at network time
    /// `epoch` (ns). All nodes of a network start at once, and the first of the masters leads from tick 0 on.
    /// One that `joins` listens first; it can do so for as long as the network's tick fits in the 24 bits of a SYNC.
    pub fn start(&mut self, own: u64, network: u64, epoch: u64, joins: bool) {
        *self = Self { runs: true, joins, epoch, ..Self::new(self.rules) };
        self.servo = Servo::new(Map::new(own, network), self.rules.jitter_ns);
        self.heard_at = self.servo.map().own(epoch);
        self.taken_at = self.heard_at;
        let Rules { id, masters, .. } = self.rules;
        if !joins && masters.contains(id) && masters.before(id) == 0 {
            self.lead(own);
        }
    }

    /// Goes by another holdover (ns) from now on, as [`Rules::holdover_ns`] says it.
    pub fn hold_over(&mut self, holdover_ns: Option<u64>) {
        self.rules.holdover_ns = holdover_ns;
    }

    /// Stops: a node that does not run neither leads nor follows.
    pub fn stop(&mut self) {
        (self.runs, self.role) = (false, Role::Waits);
    }

    /// Time of the network when the own clock shows `own`, ns.
    #[must_use]
    pub fn network(&self, own: u64) -> u64 {
        self.servo.map().network(own)
    }

    /// Time of the own clock at which it is `network` on that of the network, ns.
    #[must_use]
    pub fn own(&self, network: u64) -> u64 {
        self.servo.map().own(network)
    }

    /// The tick of the network that comes next when the own clock shows `own`, and when that is on the
    /// network's clock, ns.
    #[must_use]
    pub fn next_tick(&self, own: u64) -> (u32, u64) {
        let passed = self.network(own).saturating_sub(self.epoch);
        let tick = passed.checked_div(self.rules.tick_ns).unwrap_or(0).saturating_add(1);
        (tick as u32, self.epoch.saturating_add(tick.saturating_mul(self.rules.tick_ns)))
    }

    /// Role of the node.
    #[must_use]
    pub const fn role(&self) -> Role {
        self.role
    }

    /// Whether the node has followed a time master, or is one.
    #[must_use]
    pub fn is_in_time(&self) -> bool {
        self.role == Role::Leads || self.servo.has_joined()
    }

    /// Rate by which the network's clock runs faster than the own one, in parts of 2^32.
    #[must_use]
    pub const fn rate(&self) -> i64 {
        self.servo.map().rate()
    }

    /// Takes a SYNC of `source`, which came when the own clock showed `stamp`, and is known now, when it
    /// shows `now` (ns).
    ///
    /// # Errors
    /// The reason for refusing it: `Phase` before the start, `OwnId`, `UnknownSource` for one that is not the
    /// master to be followed, `TickWindow` for a time that cannot be right, and, where stamps have jitter, for one
    /// that does not come a period after the last.
    pub fn on_sync(
        &mut self,
        source: NodeId,
        (previous, phase_us): (TickStamp, u16),
        stamp: u64,
        now: u64,
    ) -> Result<(), Refusal> {
        if !self.runs {
            return Err(Refusal::Phase);
        }
        self.may_follow(source, stamp)?;
        if self.role != Role::Follows(source) {
            self.follow(source);
        }
        (self.heard_at, self.is_alone) = (stamp, false);
        match self.stamp.replace(stamp).filter(|_| phase_us != UNKNOWN_PHASE) {
            // It says when the one before was on the wire. Was that the one that was heard?
            Some(before) if self.is_next(stamp.saturating_sub(before)) => {
                self.observe(before, (previous, phase_us), now)
            }
            // On lines either one was lost or this one was too late. Controllers are not late.
            Some(_) if self.rules.jitter_ns > 0 => Err(Refusal::TickWindow),
            _ => Ok(()),
        }
    }

    /// Whether a SYNC that came so long (ns) after the last one that was heard is the next one, so that none
    /// was lost in between.
    fn is_next(&self, passed: u64) -> bool {
        let (quick, usual) = (self.rules.quick_ns(), self.rules.usual_ns());
        passed.abs_diff(quick).min(passed.abs_diff(usual)) < quick / NEAR
    }

    /// Of several masters the lowest one is followed, as long as it is not silent.
    fn may_follow(&self, source: NodeId, stamp: u64) -> Result<(), Refusal> {
        let Rules { id, masters, period_ns, .. } = self.rules;
        let is_silent = |since: u64| stamp.saturating_sub(since) > period_ns.saturating_mul(2);
        let follows = match self.role {
            _ if source == id => return Err(Refusal::OwnId),
            Role::Waits => true,
            // Two lead: the other one has to yield, or this one does.
            Role::Leads => source < id,
            Role::Follows(master) => source <= master || is_silent(self.heard_at),
        };
        if follows && masters.contains(source) { Ok(()) } else { Err(Refusal::UnknownSource) }
    }

    fn follow(&mut self, source: NodeId) {
        self.role = Role::Follows(source);
        self.servo.turn_to_another();
        self.stamp = None;
        self.change = Some(Change::Follows(source));
    }

    /// Takes what the master says of its SYNC that came at `stamp` (ns, own clock).
    fn observe(&mut self, stamp: u64, said: (TickStamp, u16), now: u64) -> Result<(), Refusal> {
        let network = self.network_time(said, now);
        // Beyond it two SYNC might be taken for each other.
        let limit = self.rules.quick_ns() / 2;
        if self.servo.has_joined() && self.servo.offset(stamp, network, now).unsigned_abs() > limit {
            return Err(Refusal::TickWindow);
        }
        match self.servo.observe(stamp, network, now) {
            Taken::First => {}
            Taken::Joined | Taken::Bent | Taken::Kept => self.taken_at = now,
            Taken::LeftOut => return Err(Refusal::TickWindow),
        }
        let Rules { id, masters, .. } = self.rules;
        let is_lower = matches!(self.role, Role::Follows(master) if id < master);
        if is_lower && masters.contains(id) && self.servo.is_settled() {
            self.lead(now);
        }
        Ok(())
    }

    /// Network time of a tick and a phase, ns; `now` is that of the own clock.
    fn network_time(&self, (tick, phase_us): (TickStamp, u16), now: u64) -> u64 {
        let ticks = match self.joins && !self.servo.has_joined() {
            // It knows nothing yet but what it is told.
            true => tick.rebuild(0, 0, WHOLE).map_or(0, u64::from),
            false => self.near(tick, now),
        };
        let phase = u64::from(phase_us) * NS_PER_US;
        self.epoch.saturating_add(ticks.saturating_mul(self.rules.tick_ns)).saturating_add(phase)
    }

    /// The tick that is nearest to the one of the network when the own clock shows `now` (ns).
    fn near(&self, tick: TickStamp, now: u64) -> u64 {
        let passed = self.network(now).saturating_sub(self.epoch);
        let near = passed.checked_div(self.rules.tick_ns).unwrap_or(0);
        let low = near as u32;
        let ahead = tick.rebuild(low, HALF, HALF).map_or(0, |tick| tick.wrapping_sub(low) as i32);
        near.saturating_add_signed(ahead.into())
    }

    /// Becomes time master: the next SYNC comes at the next tick.
    fn lead(&mut self, now: u64) {
        (self.role, self.quick, self.sent, self.is_alone) = (Role::Leads, QUICK, None, false);
        let passed = self.network(now).saturating_sub(self.epoch);
        let ticks = passed.div_ceil(self.rules.tick_ns.max(1));
        self.due = self.epoch.saturating_add(ticks.saturating_mul(self.rules.tick_ns));
        self.change = Some(Change::Leads);
    }

    /// Takes note that its last SYNC was on the wire when the own clock showed `stamp` (ns).
    pub fn on_sent(&mut self, stamp: u64) {
        self.sent = Some(stamp);
    }

    /// Time of the own clock at which [`Keeper::poll`] has something to do, ns.
    #[must_use]
    pub fn poll_at(&self) -> Option<u64> {
        if !self.runs {
            return None;
        }
        if self.change.is_some() {
            return Some(0);
        }
        match self.role {
            Role::Leads => Some(self.servo.map().own(self.due)),
            Role::Waits | Role::Follows(_) => match (self.lost_at(), self.silent_at()) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            },
        }
    }

    /// When the node stops unless a SYNC comes, ns of the own clock.
    fn lost_at(&self) -> Option<u64> {
        Some(self.taken_at.saturating_add(self.rules.holdover_ns?))
    }

    /// When its master is taken for dead, ns of the own clock; none where that is known.
    fn silent_at(&self) -> Option<u64> {
        let dead = match self.role {
            Role::Follows(master) => Some(master),
            Role::Waits | Role::Leads => None,
        };
        (!self.is_alone).then(|| self.heard_at.saturating_add(self.rules.patience_ns(dead)))
    }

    /// Does what is due when the own clock shows `now` (ns), and gives the next thing to be done; call it
    /// until it gives `None`.
    pub fn poll(&mut self, now: u64) -> Option<Output> {
        if !self.runs {
            return None;
        }
        if self.role != Role::Leads {
            if self.lost_at().is_some_and(|at| now >= at) {
                self.stop();
                let silent_ms = now.saturating_sub(self.taken_at) / NS_PER_MS;
                return Some(Output::Lost { silent_ms: u16::try_from(silent_ms).unwrap_or(u16::MAX) });
            }
            if self.silent_at().is_some_and(|at| now >= at) {
                self.miss(now);
            }
        }
        if let Some(change) = self.change.take() {
            return Some(Output::Report(change));
        }
        let is_due = self.role == Role::Leads && self.network(now) >= self.due;
        is_due.then(|| Output::Send(self.sync(now)))
    }

    /// Takes the master for dead.
    fn miss(&mut self, now: u64) {
        if self.rules.masters.contains(self.rules.id) {
            return self.lead(now);
        }
        (self.is_alone, self.change) = (true, Some(Change::Alone));
    }

    /// The next SYNC. It carries the instant of the one before.
    fn sync(&mut self, now: u64) -> Message {
        let interval = if self.quick > 0 { self.rules.quick_ns() } else { self.rules.usual_ns() };
        self.quick = self.quick.saturating_sub(1);
        // One that was long away does not make up for what it has missed.
        let missed = self.network(now).saturating_sub(self.due).checked_div(interval).unwrap_or(0);
        self.due = self.due.saturating_add(interval.saturating_mul(missed.saturating_add(1)));
        let (previous_tick, phase_us) = self.last_instant();
        Message::Sync { source: Some(self.rules.id), previous_tick, phase_us }
    }

    /// Tick and phase of the last SYNC that went out.
    fn last_instant(&mut self) -> (TickStamp, u16) {
        let unknown = (TickStamp::full(u32::MAX), UNKNOWN_PHASE);
        let Some(passed) = self.sent.take().and_then(|sent| self.network(sent).checked_sub(self.epoch))
        else {
            return unknown;
        };
        let ticks = passed.checked_div(self.rules.tick_ns).unwrap_or(0);
        let phase_ns = passed - ticks.saturating_mul(self.rules.tick_ns);
        match u16::try_from((phase_ns + NS_PER_US / 2) / NS_PER_US) {
            Ok(phase_us) if phase_us != UNKNOWN_PHASE => (TickStamp::full(ticks as u32), phase_us),
            _ => unknown,
        }
    }
}
