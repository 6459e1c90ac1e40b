//! The bus, its links, and the clocks of the nodes.

use super::{Dice, Net};

/// The bus and what links do beside it.
pub(super) fn bus(dice: &mut Dice, net: &mut Net) -> Vec<String> {
    let mut lines = Vec::new();
    let models = ["ideal", "ideal", "can", "can-fd", "uart"];
    net.bus = models[dice.below(models.len())];
    if net.bus != "ideal" {
        lines.push(format!("bus.model = \"{}\"", net.bus));
    }
    if dice.is(0.2) {
        let loss = match dice.is(0.7) {
            true => dice.between(0.001, 0.1).to_string(),
            false => "{ to_bad = 0.01, to_good = 0.2 }".to_owned(),
        };
        lines.push(format!("bus.loss = {loss}"));
    }
    lines.extend(of_the_model(dice, net.bus));
    if dice.is(0.2) {
        lines.push(link(dice, net));
    }
    lines
}

/// What only one of the models has.
fn of_the_model(dice: &mut Dice, model: &str) -> Vec<String> {
    let mut lines = Vec::new();
    match model {
        "ideal" if dice.is(0.15) => {
            lines.push(format!("bus.latency = \"{}us\"", 50 + dice.below(1_500)));
            lines.push(format!("bus.jitter = \"{}us\"", 1 + dice.below(400)));
        }
        "ideal" => {}
        "uart" => {
            if dice.is(0.3) {
                lines.push("bus.wiring = \"hub\"".to_owned());
            }
            if dice.is(0.2) {
                lines.push("bus.receive_buffer = 128".to_owned());
            }
        }
        _ => {
            if dice.is(0.15) {
                lines.push(format!("bus.bitrate = {}", dice.one(&["500000", "250000"])));
            }
            if dice.is(0.1) {
                lines.push("bus.sample_point = 0.8".to_owned());
            }
            if model == "can-fd" && dice.is(0.2) {
                lines.push(format!("bus.data_bitrate = {}", dice.one(&["1000000", "4000000", "5000000"])));
            }
        }
    }
    if model != "ideal" && dice.is(0.3) {
        lines.push("bus.bit_errors = 1e-5".to_owned());
    }
    lines
}

fn link(dice: &mut Dice, net: &Net) -> String {
    let (from, to) = net.edge(dice);
    let place = match dice.is(0.7) {
        true => format!("between = [{from}, {to}]"),
        false => format!("from = {from}\nto = {to}"),
    };
    let mut line = format!(
        "[[link]]\n{place}\nloss = {}\njitter = \"{}us\"\nreorder = 0.01\nduplicate = 0.01",
        dice.between(0.0, 0.2),
        dice.below(400)
    );
    if dice.is(0.2) {
        line += &format!("\nlatency = \"{}us\"", dice.below(500));
    }
    if dice.is(0.1) {
        line += "\ncorrupt = 0.001";
    }
    line
}

/// Clocks that are not right. On CAN a time master keeps them together, or two that take turns.
pub(super) fn clocks(dice: &mut Dice, net: &mut Net) -> Vec<String> {
    let on_can = net.bus.starts_with("can");
    net.clocks = dice.is(if on_can { 0.4 } else { 0.05 });
    if !net.clocks {
        return Vec::new();
    }
    let mut lines = vec![format!("clock.drift_ppm = {}", dice.one(&["20.0", "50.0", "100.0"]))];
    net.sync = on_can && dice.is(0.9);
    if net.sync {
        lines[0] += &format!("\nsync.period = \"{}ms\"", dice.one(&["20", "50", "100"]));
        if dice.is(0.6) {
            lines.push("sync.masters = [1, 2]".to_owned());
        }
    }
    if dice.is(0.2) {
        lines.push("clock.wander = 0.5".to_owned());
    }
    if dice.is(0.2) {
        lines.push("clock.offset = \"200us\"".to_owned());
    }
    if dice.is(0.1) {
        lines.push("safety.holdover = \"500ms\"".to_owned());
    }
    lines
}
