//! What runs the tasks of a board: embassy's thread-mode executor on hardware, one of our own on the emulated board ([`crate::mps2::executor`]).

use embassy_executor::Spawner;

use crate::priority;

#[cfg(feature = "_mps2")]
use crate::mps2::executor::Executor as Inner;
#[cfg(feature = "_hardware")]
use embassy_executor::Executor as Inner;

/// Runs tasks in thread mode, and sleeps when there is nothing to do.
pub struct Executor(Inner);

impl Default for Executor {
    fn default() -> Self {
        Self::new()
    }
}

impl Executor {
    /// An executor without tasks.
    pub fn new() -> Self {
        Self(Inner::new())
    }

    /// Gives all interrupts the same priority, calls `init` to spawn the first tasks, then runs for ever.
    pub fn run(&'static mut self, init: impl FnOnce(Spawner)) -> ! {
        priority::level();
        self.0.run(init)
    }
}
