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
    (0..world.optional.len()).map(without).chain(shorter.into_iter().filter(|world| world.lasts_ms > 0))
}
