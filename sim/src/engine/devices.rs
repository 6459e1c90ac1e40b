//! What stands between a simulated node and its world: its plant, with a sensor and an actuator that may fail.

use super::malfunctions::Malfunctions;
use super::own_field::OwnField;
use super::plants::Driven;
use funnelnet_law::field::{State, VectorField};
use funnelnet_node::{Action, Node, Observation};
use funnelnet_protocol::message::FaultCode;

/// The devices of an engine, by index; none of a virtual node.
pub(super) struct Devices<V>(Vec<Option<Box<Device<V>>>>);

/// The device of one node.
struct Device<V> {
    plant: Kind<V>,
    /// Where something of it may fail.
    failing: Option<Failing>,
}

enum Kind<V> {
    /// Of the user's own.
    Own(Box<dyn Driven>),
    /// The node's field.
    Field(OwnField<V>),
}

/// What may fail, and what is so whatever the node believes.
struct Failing {
    malfunctions: Malfunctions,
    /// The state of the plant at the last sample, state units.
    x: State<f32>,
    /// What its actuator does, state units / s.
    u: State<f32>,
}

impl<V> Default for Devices<V> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<V: VectorField<f32> + Clone> Devices<V> {
    /// Gives a node a plant of the user's own. What may fail of its plant stays.
    pub(super) fn give(&mut self, index: usize, plant: Box<dyn Driven>) {
        self.reach(index);
        let Some(slot) = self.0.get_mut(index) else { return };
        let failing = slot.take().and_then(|device| device.failing);
        *slot = Some(Box::new(Device { plant: Kind::Own(plant), failing }));
    }

    /// Gives a node its field as a plant, of ticks of `tick_s` seconds, of which something may fail.
    pub(super) fn give_field(
        &mut self,
        index: usize,
        node: &Node<f32, V>,
        tick_s: f64,
        malfunctions: Malfunctions,
    ) {
        self.reach(index);
        let x: State<f32> = node.state().collect();
        let u: State<f32> = x.iter().map(|_| 0.0).collect();
        let field = OwnField::new(node.field().clone(), tick_s, x.iter().copied());
        let failing = Some(Failing { malfunctions, x, u });
        if let Some(slot) = self.0.get_mut(index) {
            *slot = Some(Box::new(Device { plant: Kind::Field(field), failing }));
        }
    }

    fn reach(&mut self, index: usize) {
        if self.0.len() <= index {
            self.0.resize_with(index + 1, || None);
        }
    }

    /// Does what a node asks of its plant at `now` (ns), as the app on a board does: what fails is told to the
    /// node, which counts it or stops.
    #[cold]
    pub(super) fn act(&mut self, index: usize, now: u64, action: &Action, node: &mut Node<f32, V>) {
        let Some(Some(device)) = self.0.get_mut(index) else { return };
        match action {
            Action::Sample => match device.measure(now, node.tick()) {
                Some(x) => node.measured(&x),
                None => node.sample_failed(),
            },
            Action::Actuate => {
                if device.actuate(now, node.inputs()).is_none() {
                    node.fail(FaultCode::PLANT, 0);
                }
            }
            Action::Safe => device.safe(),
            Action::Send(_) | Action::Report(_) => {}
        }
    }

    /// The power of a node fails: its actuators fall into their safe position.
    pub(super) fn power_off(&mut self, index: usize) {
        if let Some(Some(device)) = self.0.get_mut(index) {
            device.safe();
        }
    }

    /// Whether all nodes are virtual.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Lets the field of a node that has stopped go on to tick `k`, and puts its state in the place of the last that the node knew. A plant of
    /// the user's own is looked at by samples alone.
    #[cold]
    pub(super) fn go_on_to(&mut self, index: usize, k: u32, seen: &mut [Observation<f32>]) {
        let Some(Some(device)) = self.0.get_mut(index) else { return };
        let (Kind::Field(field), Some(failing)) = (&mut device.plant, &mut device.failing) else { return };
        field.go_on_to(k.into());
        failing.x = field.state();
        self.tell(index, seen);
    }

    /// Puts what is so in the place of what a node believes of its state and its input.
    pub(super) fn tell(&self, index: usize, seen: &mut [Observation<f32>]) {
        let Some(Some(device)) = self.0.get(index) else { return };
        let Some(Failing { x, u, .. }) = &device.failing else { return };
        for ((seen, &x), &u) in seen.iter_mut().zip(x).zip(u) {
            (seen.x, seen.u) = (x, u);
        }
    }
}

impl<V: VectorField<f32>> Device<V> {
    /// The state that is measured at `now` (ns), before tick `k`.
    fn measure(&mut self, now: u64, k: u32) -> Option<State<f32>> {
        let x = match &mut self.plant {
            Kind::Own(plant) => plant.measure().ok()?,
            Kind::Field(field) => {
                field.go_on_to(k.into());
                field.state()
            }
        };
        let Some(failing) = &mut self.failing else { return Some(x) };
        let given = failing.malfunctions.measured(now, &x);
        failing.x = x;
        given
    }

    /// Drives the plant with `u` (state units / s); none where it refuses.
    fn actuate(&mut self, now: u64, u: &[f32]) -> Option<()> {
        let Some(failing) = &mut self.failing else { return self.plant.drive(u) };
        failing.u = failing.malfunctions.done(now, u, &failing.u);
        self.plant.drive(&failing.u)
    }

    /// An actuator that cannot be made safe has nobody left to be told: the node has stopped.
    fn safe(&mut self) {
        if let Some(failing) = &mut self.failing {
            failing.u.iter_mut().for_each(|u| *u = 0.0);
        }
        match &mut self.plant {
            Kind::Own(plant) => drop(plant.safe()),
            Kind::Field(field) => {
                let still: State<f32> = field.state().iter().map(|_| 0.0).collect();
                field.drive(&still);
            }
        }
    }
}

impl<V: VectorField<f32>> Kind<V> {
    fn drive(&mut self, u: &[f32]) -> Option<()> {
        match self {
            Self::Own(plant) => plant.actuate(u).ok(),
            Self::Field(field) => {
                field.drive(u);
                Some(())
            }
        }
    }
}
