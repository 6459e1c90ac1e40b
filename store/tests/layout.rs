//! What is in the flash: golden bytes of every layout, and layouts that are refused.
#![allow(clippy::unwrap_used, clippy::panic)]

mod configs;
mod flash;

use configs::{longest, small};
use flash::{Flash, now};
use funnel_protocol::NodeConfig;
use funnel_store::layout::LAYOUT;
use funnel_store::record::{Commit, checksum};
use funnel_store::{Error, MAX_CONFIG, Store};
use sequential_storage::cache::Cache;
use sequential_storage::map::{MapConfig, MapStorage};

type Chip = Flash<8, 2048>;
const REGION: core::ops::Range<u32> = 0..4 * 2048;

/// `small(3)` of layout 1, epoch 5: its configuration and its commit record, written down on 2026-11-24 and never to be changed.
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

fn guarded() -> NodeConfig {
    NodeConfig { lost_neighbours: 2, holdover_ns: 500_000_000, ..small(3) }
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
}

/// Flash with these two records, written without the store.
fn written(config: &[u8], commit: &[u8]) -> Chip {
    let mut map =
        MapStorage::<u8, _, _>::new(Chip::new(4), MapConfig::new(0..2 * 2048), Cache::new_uncached());
    let mut buffer = [0; 2048];
    now(map.store_item(&mut buffer, &0, &config)).unwrap();
    now(map.store_item(&mut buffer, &1, &commit)).unwrap();
    map.destroy().0
}

fn load(flash: Chip) -> Result<Option<funnel_protocol::NodeConfig>, Error<flash::Fault>> {
    now(now(Store::open(flash, REGION)).unwrap().load())
}

#[test]
fn a_configuration_of_layout_1_is_read_for_ever() {
    assert_eq!(load(written(&bytes(CONFIG_1), &bytes(COMMIT_1))), Ok(Some(small(3))));
}

#[test]
fn a_configuration_of_layout_2_is_read_for_ever() {
    assert_eq!(load(written(&bytes(CONFIG_2), &bytes(COMMIT_2))), Ok(Some(guarded())));
}

#[test]
fn what_is_stored_now_has_the_golden_bytes() {
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    now(store.stage(Some(&guarded()))).unwrap();
    now(store.commit(5)).unwrap();
    assert_eq!(LAYOUT, 2, "a new layout needs its own golden bytes");
    assert!(store.release().bytes == written(&bytes(CONFIG_2), &bytes(COMMIT_2)).bytes);
}

/// Layout 1 lacks two fields: neither a record that has one of them nor one that lacks three is of that layout. A blank node lacks none.
#[test]
fn an_older_layout_is_read_as_it_was_written_and_not_otherwise() {
    let good = bytes(CONFIG_1);
    let loaded = |config: &[u8]| {
        let commit = Commit { layout: 1, epoch: 5, crc: checksum(1, 5, config) };
        load(written(config, &commit.encode()))
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
    assert_eq!(now(store.load()), Err(Error::Newer { layout: LAYOUT + 1 }));
    now(store.stage(Some(&small(1)))).unwrap();
    now(store.commit(10)).unwrap();
    assert_eq!(load(store.release()), Ok(Some(small(1))));
}

#[test]
fn a_configuration_that_is_not_the_committed_one_is_refused() {
    let good = bytes(CONFIG_1);
    let mut changed = good.clone();
    changed[10] ^= 1;
    assert_eq!(load(written(&changed, &bytes(COMMIT_1))), Err(Error::Corrupt));
    // A right checksum over something that is no configuration, and over one with a tail.
    for config in [vec![7, 7, 7], [&good[..], &[0]].concat()] {
        let commit = Commit { layout: 1, epoch: 5, crc: checksum(1, 5, &config) };
        assert_eq!(load(written(&config, &commit.encode())), Err(Error::Corrupt));
    }
}

/// In the configuration it is a damaged one; in the commit record it is as if that had never been finished. Padding does not count.
#[test]
fn a_bit_that_flips_in_the_flash_never_gives_another_configuration() {
    let flash = written(&bytes(CONFIG_1), &bytes(COMMIT_1));
    let commit = 8 + 8 + (1 + CONFIG_1.len() / 2).next_multiple_of(8);
    let end = commit + 8 + (1 + COMMIT_1.len() / 2).next_multiple_of(8);
    let mut noticed = 0;
    for bit in 8 * 8..end * 8 {
        let mut flash = flash.clone();
        flash.bytes[bit / 8] ^= 1 << (bit % 8);
        let loaded = load(flash);
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
    let mut store = now(Store::open(Chip::new(4), REGION)).unwrap();
    now(store.stage(Some(&longest(1)))).unwrap();
    now(store.commit(1)).unwrap();
    assert_eq!(load(store.release()), Ok(Some(longest(1))));
}
