//! A flash that fails once, at any access of a commit: what is read after the restart is the old
//! configuration or the new one, and the failure is told either way.
#![allow(clippy::unwrap_used, clippy::panic)]

mod configs;
mod flash;

use core::ops::Range;

use configs::small;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use flash::{Fault, Flash, load, now};
use funnelnet_node::Task;
use funnelnet_protocol::service::Key;
use funnelnet_store::layout::LAYOUT;
use funnelnet_store::{Error, Store};

const BROKEN: Fault = Fault::Kind(NorFlashErrorKind::Other);

/// A byte of which one read is wrong.
struct Marginal {
    cell: usize,
    /// So far.
    reads: u32,
    /// Number of the wrong one.
    bad: u32,
}

/// One access fails, and all go well after it.
struct Flaky {
    flash: Flash<8, 2048>,
    /// Accesses up to that one.
    fails_after: Option<u32>,
    /// Whether it does what it was asked for all the same.
    does: bool,
    /// Erases up to the one that fails.
    erases_fail_after: Option<u32>,
    /// Bytes that cannot be read; if `heals`, not before they are erased.
    unread: Option<Range<u32>>,
    heals: bool,
    marginal: Option<Marginal>,
}

impl Flaky {
    fn new() -> Self {
        let (erases_fail_after, unread, marginal) = (None, None, None);
        let flash = Flash::new(4);
        Self { flash, fails_after: None, does: false, erases_fail_after, unread, heals: false, marginal }
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
        let end = offset + bytes.len() as u32;
        if self.unread.as_ref().is_some_and(|unread| offset < unread.end && end > unread.start) {
            return Err(BROKEN);
        }
        self.flash.read(offset, bytes).await?;
        if let Some(Marginal { cell, reads, bad }) = &mut self.marginal
            && let Some(byte) = cell.checked_sub(offset as usize).and_then(|at| bytes.get_mut(at))
        {
            *byte ^= u8::from(reads == bad);
            *reads += 1;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl NorFlash for Flaky {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2048;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        if self.erases_fail_after == Some(0) {
            return Err(BROKEN);
        }
        self.erases_fail_after = self.erases_fail_after.map(|left| left - 1);
        if self.heals && self.unread.as_ref().is_some_and(|unread| from <= unread.start && to >= unread.end) {
            self.unread = None;
        }
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

/// Every access of a commit fails once; how often the old and the new configuration is there at the next
/// start.
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

/// Bytes of `small(id)` that are in no other configuration here, as they are stored: its initial state.
fn traces(id: u8) -> [u8; 4] {
    (100.0 + f32::from(id)).to_le_bytes()
}

fn told_apart(id: u8) -> funnelnet_protocol::NodeConfig {
    let x = 100.0 + f32::from(id);
    funnelnet_protocol::NodeConfig { initial_state: funnelnet_protocol::config::scalar(x), ..small(id) }
}

fn holds(flash: &Flaky, bytes: &[u8]) -> bool {
    flash.flash.bytes.windows(bytes.len()).any(|window| window == bytes)
}

#[test]
fn after_an_erase_neither_a_configuration_nor_a_key_is_left_in_the_flash() {
    let (old, new) = ([0xA1, 0x52, 0xC3, 0x74], [0x1A, 0x25, 0x3C, 0x47]);
    let key = |part: [u8; 4]| Key(std::array::from_fn(|i| part[i % 4]));
    let mut store = open(Flaky::new());
    now(store.perform(Task::Store(&told_apart(1)))).unwrap();
    now(store.perform(Task::Key(key(old), &mut None))).unwrap();
    now(store.perform(Task::Store(&told_apart(2)))).unwrap();
    assert!(holds(store.flash(), &old) && holds(store.flash(), &traces(1)), "what was before is still there");
    now(store.perform(Task::Key(key(new), &mut None))).unwrap();
    assert!(!holds(store.flash(), &old), "the old key");
    assert!(holds(store.flash(), &new) && holds(store.flash(), &traces(2)));
    now(store.perform(Task::Stage(&told_apart(3)))).unwrap();
    now(store.perform(Task::Erase)).unwrap();
    for bytes in [&new[..], &old, &traces(1), &traces(2), &traces(3)] {
        assert!(!holds(store.flash(), bytes), "{bytes:?}");
    }
    let mut store = open(store.release());
    assert_eq!((now(load(&mut store)), now(store.key())), (Ok(None), Ok(None)));
}

#[test]
fn an_erase_that_cannot_erase_what_was_before_says_so_and_the_next_one_does() {
    let mut store = open(Flaky::new());
    now(store.perform(Task::Store(&told_apart(1)))).unwrap();
    store.flash().erases_fail_after = Some(1);
    assert_eq!(now(store.perform(Task::Erase)), Err(Error::Flash(BROKEN)));
    store.flash().erases_fail_after = None;
    assert!(holds(store.flash(), &traces(1)));
    let mut store = open(store.release());
    assert_eq!(now(load(&mut store)), Ok(None), "blank all the same");
    assert!(now(store.perform(Task::Erase)).is_ok() && !holds(store.flash(), &traces(1)));
}

#[test]
fn a_half_that_cannot_be_read_is_one_without_a_record() {
    let middle = 2 * 2048;
    for unread in [0..middle, middle..2 * middle] {
        let mut store = open(Flaky::new());
        now(store.perform(Task::Store(&small(1)))).unwrap();
        now(store.perform(Task::Store(&small(2)))).unwrap();
        let mut flash = store.release();
        flash.unread = Some(unread.clone());
        let mut store = open(flash);
        // 1 is in the first half, 2 in the second.
        let readable = if unread.start == 0 { 2 } else { 1 };
        assert_eq!(id(&mut store), readable);
        // What cannot be read is erased by the next one, and can be read then.
        store.flash().heals = true;
        now(store.perform(Task::Store(&small(3)))).unwrap();
        assert_eq!(id(&mut open(store.release())), 3);
    }
}

#[test]
fn what_is_current_survives_whatever_is_done_to_the_spare_half() {
    let mut store = open(Flaky::new());
    for number in 1..=4 {
        now(store.perform(Task::Store(&small(number)))).unwrap();
        let spare = now(store.spare()).unwrap();
        let mut flash = store.release();
        // Not the flash's own writes, which would need an erase: any content.
        flash.flash.bytes[spare.start as usize..spare.end as usize].fill(0x5A);
        store = open(flash);
        assert_eq!(id(&mut store), number);
    }
}

#[test]
fn no_half_is_spare_where_the_other_one_may_hold_what_is_current_and_cannot_be_read() {
    let middle = 2 * 2048;
    // A blank store would write into its first half; what cannot be read in there is no loss.
    for (unread, expected) in [(middle..2 * middle, Err(Error::Flash(BROKEN))), (0..middle, Ok(0..middle))] {
        let mut store = open(Flaky { unread: Some(unread), ..Flaky::new() });
        assert_eq!(now(store.spare()), expected);
    }
}

#[test]
fn nothing_is_erased_for_a_new_configuration_while_none_can_be_read() {
    let mut store = open(Flaky::new());
    now(store.perform(Task::Store(&small(1)))).unwrap();
    now(store.perform(Task::Store(&small(2)))).unwrap();
    let mut flash = store.release();
    flash.unread = Some(0..4 * 2048);
    let mut store = open(flash);
    assert_eq!(now(load(&mut store)), Ok(None));
    assert_eq!(now(store.perform(Task::Store(&small(3)))), Err(Error::Flash(BROKEN)));
    let mut flash = store.release();
    flash.unread = None;
    assert_eq!(id(&mut open(flash)), 2, "the trouble has passed");
}

/// An interrupted write has left a cell in between: it reads as it should now and then.
#[test]
fn a_commit_record_that_does_not_read_the_same_each_time_does_not_count() {
    let mut store = open(Flaky::new());
    now(store.perform(Task::Store(&small(1)))).unwrap();
    now(store.perform(Task::Store(&small(2)))).unwrap();
    let mut flash = store.release();
    // Key, layout and epoch of the record; the cell is the epoch's.
    let record = [1, LAYOUT, 2, 0, 0, 0];
    let cell = 2 + flash.flash.bytes.windows(6).rposition(|bytes| bytes == record).unwrap();
    for bad in 0.. {
        flash.marginal = Some(Marginal { cell, reads: 0, bad });
        let mut store = open(flash);
        let reads = store.flash().marginal.take().map_or(0, |cell| cell.reads);
        let found = id(&mut store);
        if bad >= reads {
            assert!(bad >= 3 && found == 2, "{found}: all {reads} reads were good");
            break;
        }
        assert_eq!(found, 1, "one bad read, number {bad}");
        flash = store.release();
    }
}
