//! What is in the flash: golden bytes of every layout, and layouts that are refused.
#![allow(clippy::unwrap_used, clippy::panic)]

mod configs;
mod flash;

use configs::{longest, longest_program, small};
use flash::{Flash, load, now};
use funnelnet_node::Task;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{HeardLimits, Limits, Program, Tuning};
use funnelnet_protocol::service::Key;
use funnelnet_store::layout::LAYOUT;
use funnelnet_store::record::{Commit, checksum};
use funnelnet_store::{Change, Error, MAX_CONFIG, Store};
use sequential_storage::cache::Cache;
use sequential_storage::map::{MapConfig, MapStorage};

type Chip = Flash<8, 2048>;
const REGION: core::ops::Range<u32> = 0..4 * 2048;

/// `small(3)` of layout 1, epoch 5: its configuration and its commit record, written down on 2026-11-24 and
/// never to be changed.
const CONFIG_1: &str = concat!(
    "0103c0843d0001000040400024744901000080bf010000003f0000000000803f0000803f01000020",
    "410002040000803f02050000803f020302",
);
const COMMIT_1: &str = "01050000009adb1478";

/// [`guarded`] of layout 2, epoch 5, written down on the same day and never to be changed.
const CONFIG_2: &str = concat!(
    "0103c0843d0001000040400024744901000080bf010000003f0000000000803f0000803f01000020",
    "410002040000803f02050000803f0203020280cab5ee01",
);
const COMMIT_2: &str = "02050000007c467448";

/// [`guarded`] and [`KEY`] of layout 3, epoch 5, written down on 2026-11-25 and never to be changed. The
/// configuration is that of layout 2.
const KEY_3: &str = "000102030405060708090a0b0c0d0e0f";
const COMMIT_3: &str = "03050000007b47df6b";
const COMMIT_3_WITHOUT_KEY: &str = "0305000000f6fcbcb3";

const KEY: Key = Key([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]);

/// [`tuned`] of layout 4, epoch 5, written down on 2026-11-28 and never to be changed.
const CONFIG_4: &str = concat!(
    "0103c0843d0001000040400024744901000080bf010000003f0000000000803f0000803f01000020",
    "410002040000803f02050000803f0203020280cab5ee01",
    "0000b03fcdcc4c3d02000096430000c8410a",
    "032040060100004040000000c00000a040",
);
const COMMIT_4: &str = "0405000000e1b6bdbe";
const COMMIT_4_WITHOUT_KEY: &str = "04050000006f046cce";

fn tuned() -> NodeConfig {
    let tuning = Tuning {
        damping: 1.375,
        guard: 0.05,
        round: 2,
        input_limit: 300.0,
        slope_limit: 25.0,
        slow_start: 10,
    };
    let program =
        Program { code: [0x20, 0x40, 0x06].into_iter().collect(), constants: [3.0].into_iter().collect() };
    NodeConfig { tuning, program, limits: Limits { low: -2.0, high: 5.0 }, ..guarded() }
}

fn guarded() -> NodeConfig {
    NodeConfig { lost_neighbours: 2, holdover_ns: 500_000_000, ..small(3) }
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
}

/// Flash with these two records, written without the store.
fn written(config: &[u8], commit: &[u8]) -> Chip {
    written_with_key(config, None, commit)
}

/// The same with a key.
fn written_with_key(config: &[u8], key: Option<&[u8]>, commit: &[u8]) -> Chip {
    let mut map =
        MapStorage::<u8, _, _>::new(Chip::new(4), MapConfig::new(0..2 * 2048), Cache::new_uncached());
    let mut buffer = [0; 2048];
    now(map.store_item(&mut buffer, &0, &config)).unwrap();
    if let Some(key) = key {
        now(map.store_item(&mut buffer, &2, &key)).unwrap();
    }
    now(map.store_item(&mut buffer, &1, &commit)).unwrap();
    map.destroy().0
}

fn load_from(flash: Chip) -> Result<Option<funnelnet_protocol::NodeConfig>, Error<flash::Fault>> {
    now(load(&mut now(Store::open(flash, REGION)).unwrap()))
}

#[test]
fn a_configuration_of_layout_1_is_read_for_ever() {
    assert_eq!(load_from(written(&bytes(CONFIG_1), &bytes(COMMIT_1))), Ok(Some(small(3))));
}

#[test]
fn a_configuration_of_layout_2_is_read_for_ever() {
    assert_eq!(load_from(written(&bytes(CONFIG_2), &bytes(COMMIT_2))), Ok(Some(guarded())));
}

#[test]
fn what_is_stored_now_has_the_golden_bytes() {
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    now(store.stage(Change::Config(&tuned()))).unwrap();
    now(store.commit(5)).unwrap();
    assert_eq!(LAYOUT, 4, "a new layout needs its own golden bytes");
    let commit = |key| Commit { layout: 4, epoch: 5, crc: checksum(4, 5, key, &bytes(CONFIG_4)) }.encode();
    assert_eq!(commit(None), bytes(COMMIT_4_WITHOUT_KEY)[..]);
    assert_eq!(commit(Some(&KEY)), bytes(COMMIT_4)[..]);
    assert!(store.release().bytes == written(&bytes(CONFIG_4), &bytes(COMMIT_4_WITHOUT_KEY)).bytes);
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    let blank_with_key = now(async {
        store.stage(Change::Key(KEY, &mut None)).await?;
        store.commit(4).await?;
        Ok::<_, Error<flash::Fault>>((load(&mut store).await?, store.key().await?))
    });
    assert_eq!(blank_with_key, Ok((None, Some(KEY))));
    now(store.stage(Change::Config(&tuned()))).unwrap();
    now(store.commit(5)).unwrap();
    let half = REGION.end as usize / 2;
    let golden = written_with_key(&bytes(CONFIG_4), Some(&bytes(KEY_3)), &bytes(COMMIT_4));
    assert!(store.release().bytes[half..] == golden.bytes[..half]);
}

#[test]
fn a_configuration_of_layout_3_and_its_key_are_read_for_ever() {
    let loaded = |flash| {
        let mut store = now(Store::open(flash, REGION)).unwrap();
        (now(load(&mut store)), now(store.key()))
    };
    let with = written_with_key(&bytes(CONFIG_2), Some(&bytes(KEY_3)), &bytes(COMMIT_3));
    assert_eq!(loaded(with), (Ok(Some(guarded())), Ok(Some(KEY))));
    let without = written(&bytes(CONFIG_2), &bytes(COMMIT_3_WITHOUT_KEY));
    assert_eq!(loaded(without), (Ok(Some(guarded())), Ok(None)));
    // A key that has come or gone since the commit belongs to nobody.
    for torn in [
        written(&bytes(CONFIG_2), &bytes(COMMIT_3)),
        written_with_key(&bytes(CONFIG_2), Some(&bytes(KEY_3)), &bytes(COMMIT_3_WITHOUT_KEY)),
        written_with_key(&bytes(CONFIG_2), Some(&bytes(KEY_3)[1..]), &bytes(COMMIT_3)),
    ] {
        assert_eq!(loaded(torn), (Err(Error::Corrupt), Err(Error::Corrupt)));
    }
    // One of before had none, whatever lies beside it.
    let older = written_with_key(&bytes(CONFIG_2), Some(&bytes(KEY_3)), &bytes(COMMIT_2));
    assert_eq!(loaded(older), (Ok(Some(guarded())), Ok(None)));
}

#[test]
fn a_configuration_of_layout_4_is_read_for_ever() {
    assert_eq!(load_from(written(&bytes(CONFIG_4), &bytes(COMMIT_4_WITHOUT_KEY))), Ok(Some(tuned())));
}

/// They are written only where they are said, so that the layout is the same without them.
#[test]
fn limits_of_what_is_heard_are_kept_behind_the_rest() {
    let heard = HeardLimits { limit: 2.0, rate: 3.0, drop_after: 20 };
    let limited = NodeConfig { heard, ..tuned() };
    let golden = [&bytes(CONFIG_4)[..], &[0, 0, 0, 0x40, 0, 0, 0x40, 0x40, 20]].concat();
    let commit = Commit { layout: 4, epoch: 5, crc: checksum(4, 5, None, &golden) };
    assert_eq!(load_from(written(&golden, &commit.encode())), Ok(Some(limited.clone())));
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    now(store.stage(Change::Config(&limited))).unwrap();
    now(store.commit(5)).unwrap();
    assert!(store.release().bytes == written(&golden, &commit.encode()).bytes);
    // Half of them is nothing.
    let torn = &golden[..golden.len() - 4];
    let commit = Commit { layout: 4, epoch: 5, crc: checksum(4, 5, None, torn) };
    assert_eq!(load_from(written(torn, &commit.encode())), Err(Error::Corrupt));
}

#[test]
fn the_key_stays_until_the_node_is_made_blank() {
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    let mut epoch = 0;
    let mut next = || {
        epoch += 1;
        epoch
    };
    now(store.stage(Change::Config(&small(1)))).unwrap();
    now(store.commit(next())).unwrap();
    now(store.stage(Change::Key(KEY, &mut None))).unwrap();
    assert_eq!(now(store.key()), Ok(None), "until the commit");
    now(store.commit(next())).unwrap();
    assert_eq!((now(load(&mut store)), now(store.key())), (Ok(Some(small(1))), Ok(Some(KEY))));
    now(store.stage(Change::Config(&longest(2)))).unwrap();
    now(store.commit(next())).unwrap();
    let mut store = now(Store::open(store.release(), REGION)).unwrap();
    assert_eq!((now(load(&mut store)), now(store.key())), (Ok(Some(longest(2))), Ok(Some(KEY))));
    now(store.stage(Change::Blank)).unwrap();
    now(store.commit(next())).unwrap();
    assert_eq!((now(load(&mut store)), now(store.key())), (Ok(None), Ok(None)));
    now(store.stage(Change::Config(&small(1)))).unwrap();
    now(store.commit(next())).unwrap();
    assert_eq!(now(store.key()), Ok(None), "gone for good");
}

#[test]
fn each_task_of_a_node_has_the_next_epoch() {
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    let mut room = None;
    assert_eq!(now(store.perform(Task::Store(&small(1)))), Ok(1));
    assert_eq!(now(store.perform(Task::Key(KEY, &mut room))), Ok(2));
    assert_eq!(now(store.perform(Task::Stage(&small(2)))), Ok(2));
    assert_eq!(
        (now(load(&mut store)), now(store.perform(Task::Commit(&mut room)))),
        (Ok(Some(small(1))), Ok(3))
    );
    assert_eq!(
        (room, now(load(&mut store)), now(store.key())),
        (Some(small(2)), Ok(Some(small(2))), Ok(Some(KEY)))
    );
    assert_eq!(now(store.perform(Task::Commit(&mut None))), Err(Error::NotStaged));
    assert_eq!(
        (now(store.perform(Task::Erase)), now(load(&mut store)), now(store.key())),
        (Ok(4), Ok(None), Ok(None))
    );
}

#[test]
fn what_is_staged_can_be_read_and_is_not_committed_once_it_has_changed() {
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    let staged = |store: &mut Store<Chip>| {
        let mut room = None;
        now(store.staged(&mut room)).map(|()| room)
    };
    assert_eq!(staged(&mut store), Err(Error::NotStaged));
    now(store.stage(Change::Config(&small(1)))).unwrap();
    assert_eq!((staged(&mut store), now(load(&mut store))), (Ok(Some(small(1))), Ok(None)));
    // Behind the head of its page and that of its record.
    store.flash().bytes[20] ^= 4;
    assert_eq!(staged(&mut store), Err(Error::Corrupt));
    assert_eq!((now(store.commit(1)), now(load(&mut store))), (Err(Error::Corrupt), Ok(None)));
}

/// Layout 1 lacks three fields: neither a record that has one of them nor one that lacks four is of that
/// layout. A blank node lacks none.
#[test]
fn an_older_layout_is_read_as_it_was_written_and_not_otherwise() {
    let good = bytes(CONFIG_1);
    let loaded = |config: &[u8]| {
        let commit = Commit { layout: 1, epoch: 5, crc: checksum(1, 5, None, config) };
        load_from(written(config, &commit.encode()))
    };
    assert_eq!(loaded(&good), Ok(Some(small(3))));
    assert_eq!(loaded(&[0]), Ok(None));
    for config in
        [&good[..good.len() - 1], &[&good[..], &[0]].concat(), &[&good[..], &[0, 0]].concat(), &[0, 0]]
    {
        assert_eq!(loaded(config), Err(Error::Corrupt), "{} bytes", config.len());
    }
}

#[test]
fn a_later_layout_is_refused_and_can_be_replaced() {
    let commit = Commit { layout: LAYOUT + 1, epoch: 9, crc: 0 };
    let mut store = now(Store::open(written(b"who knows", &commit.encode()), REGION)).unwrap();
    assert_eq!(now(load(&mut store)), Err(Error::Newer { layout: LAYOUT + 1 }));
    now(store.stage(Change::Config(&small(1)))).unwrap();
    now(store.commit(10)).unwrap();
    assert_eq!(load_from(store.release()), Ok(Some(small(1))));
}

#[test]
fn a_configuration_that_is_not_the_committed_one_is_refused() {
    let good = bytes(CONFIG_1);
    let mut changed = good.clone();
    changed[10] ^= 1;
    assert_eq!(load_from(written(&changed, &bytes(COMMIT_1))), Err(Error::Corrupt));
    // A right checksum over something that is no configuration, and over one with a tail.
    for config in [vec![7, 7, 7], [&good[..], &[0]].concat()] {
        let commit = Commit { layout: 1, epoch: 5, crc: checksum(1, 5, None, &config) };
        assert_eq!(load_from(written(&config, &commit.encode())), Err(Error::Corrupt));
    }
}

/// In the configuration it is a damaged one; in the commit record it is as if that had never been finished.
/// Padding does not count.
#[test]
fn a_bit_that_flips_in_the_flash_never_gives_another_configuration() {
    let flash = written(&bytes(CONFIG_1), &bytes(COMMIT_1));
    let commit = 8 + 8 + (1 + CONFIG_1.len() / 2).next_multiple_of(8);
    let end = commit + 8 + (1 + COMMIT_1.len() / 2).next_multiple_of(8);
    let mut noticed = 0;
    for bit in 8 * 8..end * 8 {
        let mut flash = flash.clone();
        flash.bytes[bit / 8] ^= 1 << (bit % 8);
        let loaded = load_from(flash);
        let damaged = if bit < commit * 8 { Err(Error::Corrupt) } else { Ok(None) };
        assert!(loaded == damaged || loaded == Ok(Some(small(3))), "bit {bit}: {loaded:?}");
        noticed += usize::from(loaded == damaged);
    }
    // Two headers, the two records with their keys.
    let counted = 8 * (8 + 1 + CONFIG_1.len() / 2 + 8 + 1 + COMMIT_1.len() / 2);
    assert_eq!(noticed, counted);
}

#[test]
fn the_longest_fits() {
    let mut bytes = [0; 2048];
    let length = postcard::to_slice(&Some(longest(1)), &mut bytes).unwrap().len();
    assert!(length <= MAX_CONFIG && length + 32 > MAX_CONFIG, "{length} of {MAX_CONFIG}");
    for longest in [longest(1), longest_program(1)] {
        assert!(postcard::to_slice(&Some(&longest), &mut bytes).unwrap().len() <= length);
        let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
        now(store.stage(Change::Config(&longest))).unwrap();
        now(store.commit(1)).unwrap();
        assert_eq!(load_from(store.release()), Ok(Some(longest)));
    }
}
