//! A flash that fails once, at any access of a commit: what is read after the restart is the old configuration or the new one, and the
//! failure is told either way.
#![allow(clippy::unwrap_used, clippy::panic)]

mod configs;
mod flash;

use configs::small;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use flash::{Fault, Flash, load, now};
use funnel_core::Task;
use funnel_store::{Error, Store};

const BROKEN: Fault = Fault::Kind(NorFlashErrorKind::Other);

/// One access fails, and all go well after it.
struct Flaky {
    flash: Flash<8, 2048>,
    /// Accesses up to that one.
    fails_after: Option<u32>,
    /// Whether it does what it was asked for all the same.
    does: bool,
}

impl Flaky {
    fn new() -> Self {
        Self { flash: Flash::new(4), fails_after: None, does: false }
    }

    /// Whether this access fails.
    fn fails(&mut self) -> bool {
        let fails = self.fails_after == Some(0);
        self.fails_after = self.fails_after.and_then(|left| left.checked_sub(1));
        fails
    }
}

impl ErrorType for Flaky {
    type Error = Fault;
}

impl ReadNorFlash for Flaky {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        if self.fails() {
            return Err(BROKEN);
        }
        self.flash.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl NorFlash for Flaky {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2048;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        self.flash.erase(from, to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        if !self.fails() {
            return self.flash.write(offset, bytes).await;
        }
        if self.does {
            self.flash.write(offset, bytes).await?;
        }
        Err(BROKEN)
    }
}

fn open(flash: Flaky) -> Store<Flaky> {
    now(Store::open(flash, 0..4 * 2048)).unwrap()
}

/// The id of what would be read now.
fn id(store: &mut Store<Flaky>) -> u8 {
    now(load(store)).unwrap().unwrap().id
}

/// The store after a commit of 2 over 1 whose access of this number has failed; `None` where it has fewer.
fn failed_commit(does: bool, access: u32) -> Option<Store<Flaky>> {
    let mut store = open(Flaky { does, ..Flaky::new() });
    now(store.perform(Task::Store(&small(1)))).unwrap();
    now(store.perform(Task::Stage(&small(2)))).unwrap();
    store.flash().fails_after = Some(access);
    let outcome = now(store.perform(Task::Commit(&mut None)));
    if store.flash().fails_after.take().is_some() {
        assert_eq!((outcome, id(&mut store)), (Ok(2), 2), "nothing has failed");
        return None;
    }
    assert_eq!((outcome, id(&mut store)), (Err(Error::Flash(BROKEN)), 1), "access {access}");
    Some(store)
}

/// Every access of a commit fails once; how often the old and the new configuration is there at the next start.
fn every_failure(does: bool) -> (u32, u32) {
    let (mut old, mut new) = (0, 0);
    for store in (0..).map_while(|access| failed_commit(does, access)) {
        let mut store = open(store.release());
        match id(&mut store) {
            1 => old += 1,
            2 => new += 1,
            found => panic!("a third configuration, {found}"),
        }
        assert_eq!(now(store.perform(Task::Store(&small(3)))).map(|_| id(&mut store)), Ok(3));
        assert_eq!(id(&mut open(store.release())), 3);
    }
    (old, new)
}

#[test]
fn a_commit_that_has_failed_leaves_the_old_configuration_or_the_new_one_at_the_next_start() {
    let (old, new) = every_failure(false);
    println!("accesses that fail: the old one {old} times, the new one {new} times");
    assert!(old > 0 && new > 0);
    let (_, new_though_failed) = every_failure(true);
    assert!(new_though_failed > new, "a write that is told to have failed may be there");
}

/// What has failed may be what counts at the next start: the store after it must not erase that.
#[test]
fn a_power_cut_in_the_store_after_a_commit_that_has_failed_leaves_a_configuration() {
    let last = (0..).take_while(|&access| failed_commit(false, access).is_some()).last().unwrap();
    for steps in 0.. {
        let mut store = failed_commit(false, last).unwrap();
        let cells = &mut store.flash().flash;
        cells.cut_after = Some(cells.steps + steps);
        let done = now(store.perform(Task::Store(&small(3))));
        let mut flash = store.release();
        flash.flash.cut_after = None;
        let found = id(&mut open(flash));
        assert!(found == 3 || found == 2 && done.is_err(), "{found} after {steps} steps");
        if done.is_ok() {
            break;
        }
    }
}
