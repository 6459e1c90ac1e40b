//! The keys of events that happen to a node's plant: its sensor gives, or its actuator does, what it should not.

use super::read_frames::{SAID, SLOPE};
use super::{ActuatorFault, Detail, Lie, SensorFault};
use crate::scenario::diagnostic::Problem;
use crate::scenario::reader::{Range, Section};

/// Standard deviation of a sensor's noise (state units).
pub(in crate::scenario) const DEVIATION: Range = Range::positive("state units");
/// Part of an input that an actuator does.
pub(in crate::scenario) const PART: Range = Range::between(0.0, 1.0, "of the input");
/// What an actuator can do at most (state units / s).
pub(in crate::scenario) const LIMIT: Range = Range::positive("state units / s");
/// What an actuator does, whatever it is told (state units / s).
pub(in crate::scenario) const INPUT: Range = Range::any("state units / s");
/// Its slope (state units / s^2).
pub(in crate::scenario) const INPUT_SLOPE: Range = Range::any("state units / s^2");

/// How a sensor fails: one of `constant`, `ramp`, `offset`, `noise`, `loss` and `age`.
pub(super) fn sensor(section: &mut Section<'_>) -> Detail {
    let number = |section: &mut Section<'_>, key, range| section.optional_number(key, range);
    let given = [
        number(section, "constant", SAID).map(|value| SensorFault::Gives(Lie::Constant(value))),
        number(section, "ramp", SLOPE).map(|slope| SensorFault::Gives(Lie::Ramp(slope))),
        number(section, "offset", SAID).map(|offset| SensorFault::Gives(Lie::Offset(offset))),
        number(section, "noise", DEVIATION).map(SensorFault::Noise),
        number(section, "loss", Range::positive_probability()).map(SensorFault::Loss),
        section.take("age").is_some().then(|| SensorFault::Age(section.duration("age", None))),
    ];
    let allowed = "must be what is measured for a state, as 3.0; or ramp, its slope per s, 0.0 for a sensor that is stuck; or offset, noise, loss, age; one of them";
    Detail::Sensor(only(section, given, allowed).unwrap_or(SensorFault::Gives(Lie::Ramp(0.0))))
}

/// How an actuator fails: one of `effectiveness`, `limit`, `constant` and `ramp`.
pub(super) fn actuator(section: &mut Section<'_>) -> Detail {
    let number = |section: &mut Section<'_>, key, range| section.optional_number(key, range);
    let given = [
        number(section, "effectiveness", PART).map(ActuatorFault::Part),
        number(section, "limit", LIMIT).map(ActuatorFault::Limit),
        number(section, "constant", INPUT).map(ActuatorFault::Constant),
        number(section, "ramp", INPUT_SLOPE).map(ActuatorFault::Ramp),
    ];
    let allowed = "must be what is done whatever the input is, as 3.0; or ramp, its slope per s, 0.0 for an actuator that is stuck; or effectiveness, limit; one of them";
    Detail::Actuator(only(section, given, allowed).unwrap_or(ActuatorFault::Ramp(0.0)))
}

/// The only one that is given; else, reported, none.
fn only<T>(section: &Section<'_>, given: impl IntoIterator<Item = Option<T>>, allowed: &str) -> Option<T> {
    let mut given = given.into_iter().flatten();
    let first = given.next();
    if first.is_none() {
        section.missing("constant", allowed);
    } else if given.next().is_some() {
        if let Some(item) = section.known("kind") {
            let allowed = "must have one key that says how it fails, and has more";
            section.log().report(item.diagnostic(Problem::Value, allowed));
        }
        return None;
    }
    first
}
