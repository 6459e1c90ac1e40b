//! A sampled plant on mocked pins: scales, limits, what fails, and what is safe.
#![allow(clippy::unwrap_used, clippy::panic)]

use embedded_hal_mock::eh1::MockError;
use embedded_hal_mock::eh1::pwm::{Mock, Transaction};
use funnelnet_node::{Configured, Model};
use funnelnet_plant::{
    Actuator, ActuatorScale, BadScale, Failure, Plant, Sampled, Sensor, SensorScale, Sink, Source, Virtual,
};
use std::io::ErrorKind;

/// A converter that gives one value, or fails.
#[derive(Debug)]
struct Converter(Result<i32, ()>);

impl Source for Converter {
    type Error = ();

    fn counts(&mut self) -> Result<i32, ()> {
        self.0
    }
}

/// A DAC of 12 bits.
#[derive(Debug, Default)]
struct Dac(u16);

impl Sink for &mut Dac {
    type Error = ();

    fn max(&self) -> u16 {
        4095
    }

    fn set(&mut self, value: u16) -> Result<(), ()> {
        self.0 = value;
        Ok(())
    }
}

/// 10 mV/K and 0.5 V at 0 degrees C, by 12 bits of 3.3 V.
const CELSIUS: SensorScale = SensorScale { zero: -50.0, per_count: 330.0 / 4096.0, valid: 300..=3000 };
/// 40 % without input and all of it at 0.6 K/s; the safe heater is off.
const HEATER: ActuatorScale = ActuatorScale { at_zero: 0.4, per_input: 1.0, safe: 0.0 };

fn sensor(counts: Result<i32, ()>) -> Sensor<Converter> {
    Sensor::new(Converter(counts), CELSIUS).unwrap()
}

/// That a duty cycle of at most 1000 is set to this.
fn set(duty: u16) -> [Transaction; 2] {
    [Transaction::max_duty_cycle(1000), Transaction::set_duty_cycle(duty)]
}

/// The same, and the pin fails.
fn refuse(duty: u16) -> [Transaction; 2] {
    let [max, set] = set(duty);
    [max, set.with_error(MockError::Io(ErrorKind::Other))]
}

/// A plant whose pins expect these calls.
fn plant<const N: usize>(
    counts: [Result<i32, ()>; N],
    calls: [&[Transaction]; N],
) -> (impl Plant<Model: Model> + use<N>, [Mock; N]) {
    let pins = calls.map(Mock::new);
    let actuators = pins.clone().map(|pin| Actuator::new(pin, HEATER).unwrap());
    (Sampled::new(counts.map(sensor), actuators, Configured, 5), pins)
}

#[test]
fn counts_become_states() {
    let (mut plant, pins) = plant([Ok(1000), Ok(300), Ok(3000)], [&[], &[], &[]]);
    let x = plant.measure().unwrap();
    for (x, celsius) in x.iter().zip([30.566, -25.830, 191.699]) {
        assert!((x - celsius).abs() < 1e-3, "{x} instead of {celsius} degrees C");
    }
    assert_eq!(x.len(), 3);
    pins.into_iter().for_each(|mut pin| pin.done());
}

#[test]
fn inputs_become_duty_cycles() {
    // Rounded to the nearest, and never beyond full scale.
    let calls = [set(400), set(500), set(0), set(1000), set(1000), set(0), set(467)].concat();
    let (mut plant, [mut pin]) = plant([Ok(1000)], [&calls]);
    for u in [0.0, 0.1, -0.4, 0.6, 70.0, -70.0, 0.0666] {
        plant.actuate(&[u]).unwrap();
    }
    pin.done();
}

#[test]
fn a_dac_is_driven_in_the_same_way() {
    let mut dac = Dac::default();
    let actuator = Actuator::new(&mut dac, HEATER).unwrap();
    Sampled::new([sensor(Ok(1000))], [actuator], Configured, 5).actuate(&[0.1]).unwrap();
    assert_eq!(dac.0, 2048);
}

#[test]
fn the_core_is_told_what_the_actuator_can_do() {
    let range = |scale| {
        let mut dac = Dac::default();
        let range = Actuator::new(&mut dac, scale).unwrap().range();
        (range.low(), range.high())
    };
    let near =
        |(low, high): (f32, f32), (a, b): (f32, f32)| (low - a).abs() < 1e-6 && (high - b).abs() < 1e-6;
    assert!(near(range(HEATER), (-0.4, 0.6)));
    assert!(near(range(ActuatorScale { per_input: -2.0, ..HEATER }), (-0.3, 0.2)), "more drive cools");
    assert!(near(range(ActuatorScale { at_zero: 0.0, ..HEATER }), (0.0, 1.0)));
    let (plant, pins) = plant([Ok(1000); 2], [&[], &[]]);
    let setup = plant.model().plant().unwrap();
    assert_eq!((setup.inputs.len(), setup.coast_ticks), (2, 5));
    assert_eq!((setup.inputs[1].low(), setup.inputs[1].high()), range(HEATER));
    pins.into_iter().for_each(|mut pin| pin.done());
}

#[test]
fn a_sensor_that_fails_or_gives_nonsense_is_named() {
    let failure = |counts| {
        let (mut plant, pins) = plant([Ok(1000), counts], [&[], &[]]);
        pins.into_iter().for_each(|mut pin| pin.done());
        plant.measure().unwrap_err()
    };
    assert_eq!(failure(Err(())), Failure::Source { component: 1 });
    for counts in [299, 3001, i32::MIN, i32::MAX] {
        let expected = Failure::OutOfRange { component: 1, counts, low: 300, high: 3000 };
        assert_eq!(failure(Ok(counts)), expected);
        let text = format!("component 1: {counts} counts, valid are 300 to 3000");
        assert_eq!(expected.to_string(), text);
    }
}

#[test]
fn a_pin_that_refuses_is_named() {
    let (mut plant, pins) = plant([Ok(1000); 2], [&set(500), &refuse(300)]);
    assert_eq!(plant.actuate(&[0.1, -0.1]), Err(Failure::Sink { component: 1 }));
    pins.into_iter().for_each(|mut pin| pin.done());
    assert_eq!(plant.actuate(&[0.1]), Err(Failure::Components), "and nothing is driven");
}

#[test]
fn all_are_made_safe_even_if_one_refuses() {
    let (mut plant, pins) = plant([Ok(1000); 3], [&set(0), &refuse(0), &set(0)]);
    assert_eq!(plant.safe(), Err(Failure::Sink { component: 1 }));
    pins.into_iter().for_each(|mut pin| pin.done());
}

#[test]
fn a_scale_that_cannot_be_is_refused_by_name() {
    let actuator = |scale| Actuator::new(&mut Dac::default(), scale).map(drop).unwrap_err();
    for bad in [-0.1, 1.1, f32::NAN] {
        let refused = actuator(ActuatorScale { at_zero: bad, ..HEATER });
        assert_eq!((refused.field, refused.allowed), ("ActuatorScale::at_zero", "0 to 1"));
        assert_eq!(actuator(ActuatorScale { safe: bad, ..HEATER }).field, "ActuatorScale::safe");
    }
    for bad in [0.0, f32::NAN, f32::INFINITY, 1e-45] {
        assert_eq!(actuator(ActuatorScale { per_input: bad, ..HEATER }).field, "ActuatorScale::per_input");
    }
    let sensor = |scale| Sensor::new(Converter(Ok(0)), scale).map(drop).unwrap_err();
    assert_eq!(sensor(SensorScale { zero: f32::NAN, ..CELSIUS }).field, "SensorScale::zero");
    assert_eq!(sensor(SensorScale { per_count: 0.0, ..CELSIUS }).field, "SensorScale::per_count");
    for (least, most) in [(3000, 300), (300, 300)] {
        assert_eq!(sensor(SensorScale { valid: least..=most, ..CELSIUS }).field, "SensorScale::valid");
    }
    let text = BadScale { field: "SensorScale::zero", found: 1.0, allowed: "2" }.to_string();
    assert_eq!(text, "SensorScale::zero = 1: allowed is 2");
}

#[test]
fn a_virtual_node_has_no_plant() {
    assert_eq!(Virtual.model().plant(), None);
    assert_eq!((Virtual.safe(), Virtual.actuate(&[])), (Ok(()), Ok(())));
}
