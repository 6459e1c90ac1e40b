//! From an input in SI units to a duty cycle or a DAC.

use crate::failure::{BadScale, Failure, check};
use embedded_hal::pwm::SetDutyCycle;
use funnelnet_node::InputRange;

/// Something that is driven by a number from 0 to a largest one: any `SetDutyCycle`, or a DAC that is adapted
/// by these two lines.
pub trait Sink {
    /// What it says when it refuses.
    type Error;

    /// The largest value.
    fn max(&self) -> u16;

    /// Drives it with `value`, at most [`Self::max`].
    ///
    /// # Errors
    /// Whatever the pin or converter says.
    fn set(&mut self, value: u16) -> Result<(), Self::Error>;
}

impl<P: SetDutyCycle> Sink for P {
    type Error = P::Error;

    fn max(&self) -> u16 {
        self.max_duty_cycle()
    }

    fn set(&mut self, value: u16) -> Result<(), Self::Error> {
        self.set_duty_cycle(value)
    }
}

/// `fraction = at_zero + per_input u` of full scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorScale {
    /// Fraction of full scale without input, 0 to 1. What the plant does at this one belongs to the model's
    /// field.
    pub at_zero: f32,
    /// Fraction of full scale per input of 1 state unit / s; negative where more drive lowers the state.
    pub per_input: f32,
    /// Fraction of full scale that is safe whenever the node is stopped, 0 to 1.
    pub safe: f32,
}

/// One component of the input, driven.
#[derive(Debug)]
pub struct Actuator<A> {
    sink: A,
    scale: ActuatorScale,
    range: InputRange,
}

impl<A: Sink> Actuator<A> {
    /// An actuator that drives `sink`. The inputs that it can do follow from the scale.
    ///
    /// # Errors
    /// A fraction outside 0 to 1, or a slope that gives no range.
    pub fn new(sink: A, scale: ActuatorScale) -> Result<Self, BadScale> {
        let ActuatorScale { at_zero, per_input, safe } = scale;
        let fraction = |field, found: f32| check(field, found, (0.0..=1.0).contains(&found), "0 to 1");
        fraction("ActuatorScale::at_zero", at_zero)?;
        fraction("ActuatorScale::safe", safe)?;
        let (empty, full) = (-at_zero / per_input, (1.0 - at_zero) / per_input);
        let range = InputRange::new(empty.min(full), empty.max(full)).map_err(|_| BadScale {
            field: "ActuatorScale::per_input",
            found: per_input,
            allowed: "a finite number other than 0, so large that inputs are finite",
        })?;
        Ok(Self { sink, scale, range })
    }

    /// What the actuator can do, state units / s.
    pub fn range(&self) -> InputRange {
        self.range
    }

    pub(crate) fn drive(&mut self, component: u8, u: f32) -> Result<(), Failure> {
        self.set(component, self.scale.at_zero + self.scale.per_input * u)
    }

    pub(crate) fn safe(&mut self, component: u8) -> Result<(), Failure> {
        self.set(component, self.scale.safe)
    }

    fn set(&mut self, component: u8, fraction: f32) -> Result<(), Failure> {
        let full = self.sink.max();
        // The conversion saturates, but at the largest u16 and not at `full`.
        let value = (fraction * f32::from(full) + 0.5) as u16;
        self.sink.set(value.min(full)).map_err(|_| Failure::Sink { component })
    }
}
