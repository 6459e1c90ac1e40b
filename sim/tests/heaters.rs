//! The worked example of the book in loopback: three heaters that differ, each behind the plant that it has
//! on a board (`docs/book/src/your-own-test.md`).
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::VectorField;
use funnelnet_node::Fixed;
use funnelnet_plant::{Actuator, ActuatorScale, Plant, Sampled, Sensor, SensorScale, Sink, Source};
use funnelnet_sim::scenario::{Override, Scenario};
use funnelnet_sim::{Simulation, Verdict};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

/// A heated block: what stands behind the pins. It differs from its model, and from heater to heater.
#[derive(Clone, Copy)]
struct Block {
    /// Degrees C.
    celsius: f32,
    /// Share of full drive.
    drive: f32,
    /// Losses (1/s) and the room around it (degrees C).
    loss: f32,
    room: f32,
    /// The wire of the sensor.
    is_broken: bool,
}

impl Block {
    fn of(id: u16) -> Self {
        let which = f32::from(id - 1);
        Self {
            celsius: 18.0 + 6.0 * which,
            drive: 0.0,
            loss: 0.014 - 0.004 * which,
            room: 15.0 + 5.0 * which,
            is_broken: false,
        }
    }

    /// One tick of 100 ms.
    fn advance(&mut self) {
        self.celsius += 0.1 * (0.5 * self.drive - self.loss * (self.celsius - self.room));
    }
}

type Shared = Rc<RefCell<Block>>;

struct Converter(Shared);

impl Source for Converter {
    type Error = ();

    fn counts(&mut self) -> Result<i32, ()> {
        let block = self.0.borrow();
        if block.is_broken { Err(()) } else { Ok(((block.celsius + 50.0) * 4096.0 / 330.0) as i32) }
    }
}

struct Heater(Shared);

impl Sink for Heater {
    type Error = ();

    fn max(&self) -> u16 {
        999
    }

    fn set(&mut self, value: u16) -> Result<(), ()> {
        self.0.borrow_mut().drive = f32::from(value) / 999.0;
        Ok(())
    }
}

/// How the nodes believe that their blocks move.
#[derive(Clone, Copy)]
struct Model;

impl VectorField<f32> for Model {
    fn at(&self, _: u64, celsius: f32) -> f32 {
        0.5 * 0.4 - 0.01 * (celsius - 20.0)
    }
}

/// The plant as it is on the board.
fn plant(block: &Shared) -> impl Plant<Model: 'static> + use<> {
    let sensor = SensorScale { zero: -50.0, per_count: 330.0 / 4096.0, valid: 248..=2482 };
    let actuator = ActuatorScale { at_zero: 0.4, per_input: 2.0, safe: 0.0 };
    let (sensor, actuator) =
        (Sensor::new(Converter(block.clone()), sensor), Actuator::new(Heater(block.clone()), actuator));
    Sampled::new([sensor.unwrap()], [actuator.unwrap()], Fixed(Model), 10)
}

/// The three of them, with what happens to the blocks at each tick.
fn heat(sets: &[&str], mut happens: impl FnMut(u64, &[Shared])) -> (Verdict, Vec<Block>) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware/heaters.toml");
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    let scenario = Scenario::load(&file, &sets).unwrap();
    let blocks = [1, 2, 3].map(|id| Rc::new(RefCell::new(Block::of(id))));
    let setup = Simulation::setup(&scenario);
    let setup = (1..).zip(&blocks).fold(setup, |setup, (id, block)| setup.plant(id, plant(block)));
    let mut heaters = setup.start().unwrap();
    while let Some(tick) = heaters.step() {
        blocks.iter().for_each(|block| block.borrow_mut().advance());
        happens(tick, &blocks);
    }
    let verdict = heaters.verdict();
    (verdict, blocks.iter().map(|block| *block.borrow()).collect())
}

fn spread(blocks: &[Block]) -> f32 {
    let fold = |start, with: fn(f32, f32) -> f32| blocks.iter().map(|block| block.celsius).fold(start, with);
    fold(f32::MIN, f32::max) - fold(f32::MAX, f32::min)
}

#[test]
fn heaters_agree_within_their_funnel() {
    let (verdict, blocks) = heat(&[], |_, _| {});
    assert!(verdict.holds(), "{verdict}");
    // Each end of the path is less than 1 K from the middle one.
    assert!(spread(&blocks) < 2.0, "{}", spread(&blocks));
    // They are heaters of their own: without the law they end elsewhere.
    let (_, alone) = heat(&["coupling.kind=none", "time.duration=300s"], |_, _| {});
    assert!(spread(&alone) > 20.0, "{}", spread(&alone));
}

#[test]
fn a_broken_wire_stops_its_node_with_the_heater_off() {
    let (verdict, blocks) = heat(&["time.duration=20s"], |tick, blocks| {
        if tick == 50 {
            blocks[1].borrow_mut().is_broken = true;
        }
    });
    assert!(!verdict.holds());
    let stop = verdict.stops.first().unwrap();
    // Eleven samples in a row: the tick is 100 ms.
    assert_eq!((stop.id, (stop.at_s * 10.0).round()), (2, 61.0), "{stop:?}");
    assert_eq!(blocks[1].drive, 0.0);
    assert!(blocks[0].drive > 0.0 && blocks[2].drive > 0.0);
}

/// Its power fails for 2 s: the heater is off meanwhile, and the node is one of its neighbours again
/// afterwards.
#[test]
fn a_board_without_power_heats_nothing() {
    let mut drives = Vec::new();
    let bounce = ["time.duration=30s", "event=[{at='5s',kind='bounce',node=2,for='2s'}]"];
    let (_, blocks) = heat(&bounce, |tick, blocks| {
        if [40, 60, 80].contains(&tick) {
            drives.push(blocks[1].borrow().drive);
        }
    });
    assert!(drives[0] > 0.0 && drives[1] == 0.0, "{drives:?}");
    assert!(blocks[1].drive > 0.0, "{}", blocks[1].drive);
}

/// The sensor of heater 2 says 3 K more than there is: the nodes believe that they agree, and the verdict does not.
#[test]
fn a_sensor_that_is_wrong_deceives_the_nodes_and_not_the_verdict() {
    let wrong = ["event=[{at='400s',kind='sensor',node=2,offset=3}]"];
    let (verdict, blocks) = heat(&wrong, |_, _| {});
    let (honest, whole) = heat(&[], |_, _| {});
    assert!(spread(&blocks) > spread(&whole) + 1.0, "{} {}", spread(&blocks), spread(&whole));
    let (found, without) = (verdict.findings.final_spread.unwrap(), honest.findings.final_spread.unwrap());
    assert!((found - f64::from(spread(&blocks))).abs() < 0.2, "{found} {}", spread(&blocks));
    assert!(found > without + 1.0 && !verdict.holds(), "{found} {without}");
}
