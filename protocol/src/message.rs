//! The real-time plane: what travels every tick, and the typed fields that it is made of.

use core::fmt;

/// Identifier of a node, 1 to 127 (seven bits; 0 is the host or "all").
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NodeId(u8);

impl NodeId {
    /// Largest identifier.
    pub const MAX: u8 = 127;

    /// `id` in 1..=127, otherwise `None`.
    pub const fn new(id: u8) -> Option<Self> {
        if id >= 1 && id <= Self::MAX { Some(Self(id)) } else { None }
    }

    /// The number, 1 to 127.
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// Index of a component of a vector state, 0 to 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Component(u8);

impl Component {
    /// The only component of a scalar state.
    pub const FIRST: Self = Self(0);
    /// Number of components that the wire has room for.
    pub const COUNT: u8 = 8;

    /// `index` in 0..8, otherwise `None`.
    pub const fn new(index: u8) -> Option<Self> {
        if index < Self::COUNT { Some(Self(index)) } else { None }
    }

    /// The index, 0 to 7.
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// The low bits of a tick number, as many as a frame has room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickStamp {
    value: u32,
    /// Ones where `value` is known.
    mask: u32,
}

impl TickStamp {
    /// A whole tick number; an encoder takes the bits that it sends.
    pub const fn full(tick: u32) -> Self {
        Self { value: tick, mask: u32::MAX }
    }

    /// The low `bits` (1 to 32) of `tick`, as a decoder gets them.
    pub const fn low(tick: u32, bits: u8) -> Self {
        let mask = mask(bits);
        Self { value: tick & mask, mask }
    }

    /// The known low bits.
    pub const fn value(self) -> u32 {
        self.value
    }

    /// The tick with these low bits that is nearest to `own`, if it lies at most `back` before or `ahead`
    /// after it.
    ///
    /// Both bounds must be below half the range of the stamp for the answer to be unambiguous; ticks wrap at
    /// 2^32.
    pub const fn rebuild(self, own: u32, back: u32, ahead: u32) -> Option<u32> {
        let forward = self.value.wrapping_sub(own) & self.mask;
        let backward = own.wrapping_sub(self.value) & self.mask;
        if forward <= ahead {
            Some(own.wrapping_add(forward))
        } else if backward <= back {
            Some(own.wrapping_sub(backward))
        } else {
            None
        }
    }
}

const fn mask(bits: u8) -> u32 {
    if bits >= 32 { u32::MAX } else { (1 << bits) - 1 }
}

/// Target of a command: all nodes or one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Target {
    /// Every node that hears it.
    All,
    /// One node.
    Node(NodeId),
}

impl Target {
    /// Whether a node called `id` is meant.
    pub fn includes(self, id: NodeId) -> bool {
        match self {
            Self::All => true,
            Self::Node(node) => node == id,
        }
    }
}

/// `at_tick` of a start for a node that ticks by SYNC and comes to a network that runs: it announces nothing,
/// since it does not know the tick yet.
pub const JOIN: u16 = u16::MAX;

/// `phase_us` of a SYNC whose sender does not know when the one before was on the wire.
pub const UNKNOWN_PHASE: u16 = u16::MAX;

/// Command of a CTRL frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Begin: announce the initial state; tick 0 follows (protocol/README.md, "Start").
    Start,
    /// End: no further tick, safe output.
    Stop,
    /// Become what was staged: at once, or while running before the law of the tick with these low 16 bits
    /// (protocol/README.md, "Commit").
    Commit,
}

/// Severity of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Severity {
    /// Worth knowing; the node goes on.
    Notice,
    /// The guarantee is lost or weakened; the node goes on.
    Warning,
    /// The node has stopped with a safe output.
    Stopped,
}

/// Code of a fault. Unknown codes are passed on, so that a newer node can be heard by an older host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultCode(pub u8);

impl FaultCode {
    /// The node heard a frame that carries its own id.
    pub const DUPLICATE_ID: Self = Self(1);
    /// The node's own state is no longer a finite number within its limit.
    pub const STATE_LIMIT: Self = Self(2);
    /// The node has restarted after a panic (argument 1) or a hard fault (2); said as a warning once it has
    /// its id.
    pub const PANIC: Self = Self(3);
    /// The diffusive term has left the funnel, and the node is configured to stop then.
    pub const FUNNEL_LEFT: Self = Self(4);
    /// The node's CAN controller went off the bus; the argument is how often so far.
    pub const BUS_OFF: Self = Self(5);
    /// The node has lost as many neighbours at once as stop it; the argument is how many.
    pub const NEIGHBOURS_LOST: Self = Self(6);
    /// No SYNC for longer than the node goes on without; the argument is for how long, ms.
    pub const HOLDOVER: Self = Self(7);
    /// The node's sensor has failed for longer than it may: the argument is for how many samples. 0: its
    /// actuator has failed.
    pub const PLANT: Self = Self(8);
    /// The node's storage has failed at a commit; it goes on with its old configuration, and says so as a
    /// warning.
    pub const COMMIT: Self = Self(9);
    /// The law, or a field or gain of a user's own, has given an input that is not a finite number; the
    /// argument is its component.
    pub const INPUT: Self = Self(10);
    /// The node's own field has given what is not a finite number; the argument is its component.
    pub const FIELD: Self = Self(11);
    /// The node was told to stop, it alone, and leaves a network that runs: its goodbye. Argument 0.
    pub const LEAVES: Self = Self(12);
    /// The node joins a network in which it may have been before, and starts anew: what it said before its next state counts no
    /// more. Argument 0. A notice; the node runs.
    pub const STARTS_ANEW: Self = Self(13);
}

/// What a code says, for `core::write` and `defmt::write` alike.
macro_rules! say {
    ($($write:ident)::+, $f:expr, $code:expr) => {
        match *$code {
            FaultCode::DUPLICATE_ID => $($write)::+!($f, "another node has its id"),
            FaultCode::STATE_LIMIT => $($write)::+!($f, "its state is beyond its limit"),
            FaultCode::PANIC => $($write)::+!($f, "its firmware panicked"),
            FaultCode::FUNNEL_LEFT => $($write)::+!($f, "its diffusive term has left the funnel"),
            FaultCode::BUS_OFF => $($write)::+!($f, "its CAN controller went off the bus"),
            FaultCode::NEIGHBOURS_LOST => $($write)::+!($f, "it has lost too many neighbours"),
            FaultCode::HOLDOVER => $($write)::+!($f, "it has heard no SYNC for too long"),
            FaultCode::PLANT => $($write)::+!($f, "its sensor or actuator has failed"),
            FaultCode::COMMIT => $($write)::+!($f, "its storage has failed at a commit"),
            FaultCode::INPUT => $($write)::+!($f, "its input is not a finite number"),
            FaultCode::FIELD => $($write)::+!($f, "its own field is not a finite number"),
            FaultCode::LEAVES => $($write)::+!($f, "it was told to stop"),
            FaultCode::STARTS_ANEW => $($write)::+!($f, "it starts anew"),
            FaultCode(code) => $($write)::+!($f, "fault {}", code),
        }
    };
}

impl fmt::Display for FaultCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        say!(core::write, f, self)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for FaultCode {
    fn format(&self, f: defmt::Formatter<'_>) {
        say!(defmt::write, f, self);
    }
}

/// One frame of the real-time plane.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Message {
    /// A command from a host.
    Ctrl {
        /// Whom it is for.
        target: Target,
        /// What to do.
        command: Command,
        /// Its number: nodes on lines to each other pass it on once; 0 is for the receiver alone.
        arg: u8,
        /// Start: tick periods to wait before tick 0 (timer as tick source; ignored with SYNC as the source).
        /// Commit: low 16 bits of the tick.
        at_tick: u16,
    },
    /// The time master's beat: it marks the tick after `previous_tick`.
    Sync {
        /// Time master; `None` is the host.
        source: Option<NodeId>,
        /// Low 24 bits of the tick that the previous SYNC marked (all ones before tick 0).
        previous_tick: TickStamp,
        /// Offset of the previous SYNC from its tick, microseconds; [`UNKNOWN_PHASE`] where that is not
        /// known.
        phase_us: u16,
    },
    /// A node reports a fault.
    Fault {
        /// Who.
        source: NodeId,
        /// What.
        code: FaultCode,
        /// How bad.
        severity: Severity,
        /// Detail, by code.
        arg: u16,
        /// When.
        tick: TickStamp,
    },
    /// One component of a node's state at a tick.
    State {
        /// Who.
        source: NodeId,
        /// Which component.
        component: Component,
        /// When.
        tick: TickStamp,
        /// The value, state units. A decoder refuses NaN and infinities.
        x: f32,
    },
    /// A node tells one of its edge weights, which must be the same at both ends (paper, Assumption 1).
    Edge {
        /// Who.
        source: NodeId,
        /// The other end.
        neighbour: NodeId,
        /// `alpha_ij` as `source` has it. A decoder refuses NaN and infinities.
        weight: f32,
    },
}
