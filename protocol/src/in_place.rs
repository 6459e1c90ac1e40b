//! Reads a configuration where it is to stay.
//!
//! What serde makes of it by value is moved from function to function: 11 KiB of a node's stack (2026-11-26).
//! So only small values are made that way, one after the other, as postcard writes a struct.

use core::fmt;

use crate::config::{
    Breach, Coupling, Field, Funnel, Gain, HeardLimits, Limits, MASTER_BYTES, NodeConfig, Program, Shape,
    TickSource, TimeRules, Tuning,
};
use crate::refusal::Refusal;
use heapless::Vec;
use postcard::de_flavors::Flavor;
use postcard::{Deserializer, Error, Result};
use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer as _};

type Source<'a> = Deserializer<'a, Bytes<'a>>;

impl NodeConfig {
    /// No configuration, but room for one.
    pub const fn empty() -> Self {
        Self {
            id: 0,
            tick_ns: 0,
            tick_source: TickSource::Timer,
            initial_state: Vec::new(),
            state_limit: 0.0,
            field: Field { slope: Vec::new(), offset: Vec::new(), sines: Vec::new() },
            coupling: Coupling::None,
            gain: Gain::Linear { slope: 0.0 },
            funnel: Funnel { factor: 0.0, shape: Shape::Constant { width: 0.0 } },
            on_breach: Breach::Ride,
            neighbours: Vec::new(),
            extrapolate_ticks: 0,
            telemetry_every: 0,
            lost_neighbours: 0,
            holdover_ns: 0,
            tuning: Tuning {
                damping: 0.0,
                guard: 0.0,
                round: 0,
                input_limit: 0.0,
                slope_limit: 0.0,
                slow_start: 0,
            },
            program: Program::none(),
            limits: Limits { low: 0.0, high: 0.0 },
            heard: HeardLimits::NONE,
            time: TimeRules::NONE,
        }
    }

    /// Becomes what `bytes` are, the body of a CONFIGURE or STAGE. The limits of what is heard and the rules
    /// of time may be missing: then there are none.
    ///
    /// # Errors
    /// `Length` for trailing bytes, `Value` for anything else that is not a configuration. It is of no use
    /// then.
    pub fn read(&mut self, bytes: &[u8]) -> core::result::Result<(), Refusal> {
        self.read_older(bytes, 0)
    }

    /// The same of an older layout: the last `missing` bytes, each of them a zero, were not written then.
    ///
    /// # Errors
    /// As for [`NodeConfig::read`].
    pub fn read_older(&mut self, bytes: &[u8], missing: usize) -> core::result::Result<(), Refusal> {
        let mut source = Deserializer::from_flavor(Bytes { bytes, zeros: missing });
        self.fill(&mut source).map_err(|_| Refusal::Value)?;
        let rest = source.finalize().map_err(|_| Refusal::Value)?;
        let (heard, time) = divide(rest.bytes)?;
        (self.heard, self.time) = (HeardLimits::read(heard)?, TimeRules::read(time)?);
        if rest.zeros == 0 { Ok(()) } else { Err(Refusal::Value) }
    }

    fn fill(&mut self, source: &mut Source<'_>) -> Result<()> {
        // In this order. A field more does not compile before it is here.
        let Self {
            id,
            tick_ns,
            tick_source,
            initial_state,
            state_limit,
            field: Field { slope, offset, sines },
            coupling,
            gain,
            funnel,
            on_breach,
            neighbours,
            extrapolate_ticks,
            telemetry_every,
            lost_neighbours,
            holdover_ns,
            tuning: Tuning { damping, guard, round, input_limit, slope_limit, slow_start },
            program: Program { code, constants },
            limits: Limits { low, high },
            // Behind them, where it is there.
            heard: _,
            time: _,
        } = self;
        value(id, source)?;
        value(tick_ns, source)?;
        value(tick_source, source)?;
        list(initial_state, source)?;
        value(state_limit, source)?;
        list(slope, source)?;
        list(offset, source)?;
        list(sines, source)?;
        value(coupling, source)?;
        value(gain, source)?;
        value(funnel, source)?;
        value(on_breach, source)?;
        list(neighbours, source)?;
        value(extrapolate_ticks, source)?;
        value(telemetry_every, source)?;
        value(lost_neighbours, source)?;
        value(holdover_ns, source)?;
        value(damping, source)?;
        value(guard, source)?;
        value(round, source)?;
        value(input_limit, source)?;
        value(slope_limit, source)?;
        value(slow_start, source)?;
        list(code, source)?;
        list(constants, source)?;
        value(low, source)?;
        value(high, source)
    }
}

/// What is left of a configuration: limits of what is heard, and rules of time, each where there are any.
fn divide(rest: &[u8]) -> core::result::Result<(&[u8], &[u8]), Refusal> {
    const BOTH: usize = HeardLimits::BYTES + TimeRules::BYTES;
    let heard = match rest.len() {
        0 | TimeRules::BYTES => 0,
        HeardLimits::BYTES | BOTH => HeardLimits::BYTES,
        _ => return Err(Refusal::Length),
    };
    rest.split_at_checked(heard).ok_or(Refusal::Length)
}

impl HeardLimits {
    /// Bytes of them, where they are said.
    const BYTES: usize = 9;

    /// Reads them.
    fn read(rest: &[u8]) -> core::result::Result<Self, Refusal> {
        let (limit, rate, drop_after) = match *rest {
            [] => return Ok(Self::NONE),
            [a, b, c, d, e, f, g, h, drop_after] => ([a, b, c, d], [e, f, g, h], drop_after),
            _ => return Err(Refusal::Length),
        };
        let heard = Self { limit: f32::from_le_bytes(limit), rate: f32::from_le_bytes(rate), drop_after };
        // A configuration has one form, so that its checksum is one.
        if heard.is_none() { Err(Refusal::Value) } else { Ok(heard) }
    }
}

impl TimeRules {
    /// Reads them.
    fn read(rest: &[u8]) -> core::result::Result<Self, Refusal> {
        let Some((masters, [a, b, c, d, e, f, g, h])) = rest.split_first_chunk::<MASTER_BYTES>() else {
            return Ok(Self::NONE);
        };
        let [period_us, jitter_us] = [[*a, *b, *c, *d], [*e, *f, *g, *h]].map(u32::from_le_bytes);
        let time = Self { masters: *masters, period_us, jitter_us };
        // One form of them, too.
        if time.is_none() { Err(Refusal::Value) } else { Ok(time) }
    }
}

fn value<'a, T: Deserialize<'a>>(place: &mut T, source: &mut Source<'a>) -> Result<()> {
    *place = T::deserialize(source)?;
    Ok(())
}

fn list<'a, T: Deserialize<'a>, const N: usize>(
    place: &mut Vec<T, N>,
    source: &mut Source<'a>,
) -> Result<()> {
    place.clear();
    source.deserialize_seq(Items(place))
}

/// Takes the items of a list.
struct Items<'v, T, const N: usize>(&'v mut Vec<T, N>);

impl<'a, T: Deserialize<'a>, const N: usize> Visitor<'a> for Items<'_, T, N> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at most {N} items")
    }

    fn visit_seq<A: SeqAccess<'a>>(self, mut items: A) -> core::result::Result<(), A::Error> {
        while let Some(item) = items.next_element()? {
            self.0.push(item).map_err(|_| A::Error::invalid_length(N + 1, &self))?;
        }
        Ok(())
    }
}

/// As many as the longest number takes.
static ZEROS: [u8; 8] = [0; 8];

/// Bytes, and then zeros.
pub(crate) struct Bytes<'a> {
    pub bytes: &'a [u8],
    pub zeros: usize,
}

impl<'a> Flavor<'a> for Bytes<'a> {
    type Remainder = Self;
    type Source = &'a [u8];

    fn pop(&mut self) -> Result<u8> {
        if let Some((&first, rest)) = self.bytes.split_first() {
            self.bytes = rest;
            return Ok(first);
        }
        self.zeros = self.zeros.checked_sub(1).ok_or(Error::DeserializeUnexpectedEnd)?;
        Ok(0)
    }

    fn try_take_n(&mut self, count: usize) -> Result<&'a [u8]> {
        if let Some((taken, rest)) = self.bytes.split_at_checked(count) {
            self.bytes = rest;
            return Ok(taken);
        }
        // A number begins with the bytes or with the zeros, and ends there.
        let zeros = ZEROS.get(..count).filter(|_| self.bytes.is_empty());
        self.zeros = self.zeros.checked_sub(count).ok_or(Error::DeserializeUnexpectedEnd)?;
        zeros.ok_or(Error::DeserializeUnexpectedEnd)
    }

    fn finalize(self) -> Result<Self> {
        Ok(self)
    }
}
