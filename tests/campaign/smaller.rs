//! The smallest world that is still broken in the same way.

use super::{Broken, World, look};

/// Leaves out line after line, and shortens the run, as long as what is broken stays so.
#[must_use]
pub fn smaller(world: &World, broken: &Broken) -> (World, Broken) {
    smaller_by(world, broken, |world| look(world).map(drop))
}

/// The same with another way to look.
pub fn smaller_by(
    world: &World,
    broken: &Broken,
    look: impl Fn(&World) -> Result<(), Broken>,
) -> (World, Broken) {
    let mut best = (world.clone(), broken.clone());
    let still = |world: World| {
        world.scenario().ok()?;
        let now = look(&world).err()?;
        now.is_like(broken).then_some((world, now))
    };
    loop {
        let Some(next) = candidates(&best.0).find_map(still) else { return best };
        best = next;
    }
}

fn candidates(world: &World) -> impl Iterator<Item = World> {
    let without = |at: usize| {
        let mut smaller = world.clone();
        smaller.optional.remove(at);
        smaller
    };
    let shorter =
        [world.lasts_ms / 2, world.lasts_ms * 3 / 4].map(|lasts_ms| World { lasts_ms, ..world.clone() });
    let fewer = (0..world.optional.len()).flat_map(|at| {
        let line = world.optional.get(at).map_or("", String::as_str);
        let with = |line| {
            let mut smaller = world.clone();
            smaller.optional[at] = line;
            smaller
        };
        with_fewer_kinds(line).into_iter().map(with).collect::<Vec<_>>()
    });
    let shorter = shorter.into_iter().filter(|world| world.lasts_ms > 0);
    (0..world.optional.len()).map(without).chain(fewer).chain(shorter)
}

/// A line of `[faults]` that draws one kind less.
fn with_fewer_kinds(line: &str) -> Vec<String> {
    let Some((before, rest)) = line.split_once("kinds = [").filter(|_| line.starts_with("faults")) else {
        return Vec::new();
    };
    let Some((kinds, after)) = rest.split_once(']') else { return Vec::new() };
    let kinds: Vec<_> = kinds.split(", ").collect();
    let without = |at: usize| {
        let left: Vec<_> =
            kinds.iter().enumerate().filter(|(other, _)| *other != at).map(|(_, kind)| *kind).collect();
        format!("{before}kinds = [{}]{after}", left.join(", "))
    };
    // Without any kind there is nothing to draw.
    if kinds.len() > 1 { (0..kinds.len()).map(without).collect() } else { Vec::new() }
}
