//! The power fails after every single byte of every stage and commit, and at eight moments of every erase:
//! what is read after the restart is the old configuration or the new one, and the next one can be stored.
#![allow(clippy::large_enum_variant, clippy::unwrap_used, clippy::panic, clippy::reversed_empty_ranges)]

mod configs;
mod flash;

use configs::{longest, small};
use embedded_storage_async::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind};
use flash::{Chip, Fault, Flash, load, now};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::Key;
use funnelnet_store::split::{Split, SplitError};
use funnelnet_store::{Change, Error, Store};
use proptest::prelude::*;

/// What a store keeps.
#[derive(Clone, Debug, Default, PartialEq)]
struct Stored {
    config: Option<NodeConfig>,
    key: Option<Key>,
}

/// What is asked of it.
#[derive(Clone, Debug)]
enum Put {
    Config(NodeConfig),
    Blank,
    Key(u8),
}

impl Put {
    /// What is there afterwards.
    fn of(&self, old: &Stored) -> Stored {
        match self {
            Self::Config(config) => Stored { config: Some(config.clone()), key: old.key },
            Self::Blank => Stored::default(),
            Self::Key(key) => Stored { config: old.config.clone(), key: Some(Key([*key; 16])) },
        }
    }
}

/// The first half of it.
async fn stage<F: NorFlash>(store: &mut Store<F>, change: &Put) -> Result<(), Error<F::Error>> {
    match change {
        Put::Config(config) => store.stage(Change::Config(config)).await,
        Put::Blank => store.stage(Change::Blank).await,
        Put::Key(key) => store.stage(Change::Key(Key([*key; 16]), &mut None)).await,
    }
}

fn open<F: Chip>(flash: F) -> Store<F> {
    now(Store::open(flash, F::region())).unwrap_or_else(|error| panic!("the store does not open: {error}"))
}

fn read<F: Chip>(store: &mut Store<F>) -> Stored {
    now(async { Ok(Stored { config: load(store).await?, key: store.key().await? }) })
        .unwrap_or_else(|error: Error<F::Error>| panic!("the store cannot be read: {error}"))
}

/// Stages and commits; how far it came, and the flash.
fn put<F: Chip>(flash: F, change: &Put) -> (Result<(), Fault>, F) {
    let mut store = open(flash);
    let done = now(async {
        stage(&mut store, change).await?;
        store.commit(store.epoch() + 1).await
    });
    let done = done.map_err(|error| match error {
        Error::Flash(fault) => F::fault(fault),
        error => panic!("{error}"),
    });
    (done, store.release())
}

/// Writes of a node's life: the first ones, equal ones, longer and shorter ones, blank in between, keys among
/// them.
fn life() -> Vec<Put> {
    vec![
        Put::Config(small(1)),
        Put::Config(longest(2)),
        Put::Key(7),
        Put::Config(small(3)),
        Put::Key(8),
        Put::Key(8),
        Put::Blank,
        Put::Config(longest(5)),
        Put::Config(longest(5)),
        Put::Blank,
        Put::Blank,
        Put::Key(9),
        Put::Config(small(9)),
    ]
}

/// Every cut point of a life; how many there were, and how often the new configuration was there already.
fn every_cut<F: Chip>() -> (u64, u64) {
    let (mut cuts, mut new_already) = (0, 0);
    let mut before = F::erased();
    let mut old = Stored::default();
    for change in life() {
        let new = change.of(&old);
        let (done, mut after) = put(before.clone().restarted(None), &change);
        assert_eq!(done, Ok(()));
        for n in 0..after.cells().steps() {
            let (done, mut cut) = put(before.clone().restarted(Some(n)), &change);
            assert_eq!(done, Err(Fault::PowerCut), "after {n} steps");
            let bytes = cut.cells().bytes().to_vec();
            let mut store = open(cut.restarted(None));
            let found = read(&mut store);
            assert!(store.flash().cells().bytes() == bytes, "looking must not write");
            assert!(found == old || found == new, "a third configuration after {n} steps: {found:?}");
            new_already += u64::from(found == new && old != new);
            let next = Put::Config(small(77));
            let (done, again) = put(store.release(), &next);
            assert_eq!((done, read(&mut open(again))), (Ok(()), next.of(&found)), "after {n} steps");
            cuts += 1;
        }
        let region = F::region();
        let (start, end) = (region.start as usize, region.end as usize);
        let bytes = after.cells().bytes();
        assert!(bytes[..start].iter().chain(&bytes[end..]).all(|&byte| byte == 0xFF), "foreign pages");
        (before, old) = (after, new);
        assert_eq!(read(&mut open(before.clone())), old);
    }
    (cuts, new_already)
}

#[test]
fn every_cut_leaves_the_old_configuration_or_the_new_one() {
    // Words and pages of the STM32G4, the nRF52 and the RP2040; then those of the STM32F4, whose pages are of
    // 128 KiB, so that the store is shown each one as two.
    let counted = [
        every_cut::<Flash<8, 2048>>(),
        every_cut::<Flash<4, 4096>>(),
        every_cut::<Flash<1, 4096>>(),
        every_cut::<Split<Flash<4, 0x2_0000>, 2>>(),
    ];
    println!("cut points, of them with the new configuration: {counted:?}");
    let cuts: u64 = counted.iter().map(|&(cuts, _)| cuts).sum();
    assert!(cuts > 25_000, "{cuts}");
}

#[test]
fn a_part_of_a_page_is_not_erased() {
    let mut flash = Split::<Flash<4, 4096>, 2>::erased();
    now(flash.write(4096, &[0; 4])).unwrap();
    for (from, to) in [(4096, 6144), (6144, 8192), (4096, 10_240), (2048, 8192), (4097, 8192)] {
        assert_eq!(now(flash.erase(from, to)), Err(SplitError::NotWhole { from, to }));
    }
    assert_eq!((flash.0.steps, flash.0.bytes[4096]), (4, 0), "nothing was touched");
    assert_eq!((now(flash.erase(4096, 8192)), flash.0.bytes[4096]), (Ok(()), 0xFF));
    let outside = now(flash.erase(4 * 4096, 5 * 4096)).map_err(|error| error.kind());
    assert_eq!(outside, Err(NorFlashErrorKind::OutOfBounds));
}

#[test]
fn a_stage_without_its_commit_is_dropped_at_the_restart() {
    let (_, flash) = put(Flash::<8, 2048>::new(6), &Put::Config(small(1)));
    let mut store = open(flash);
    now(store.stage(Change::Config(&small(2)))).unwrap();
    assert_eq!(read(&mut store).config, Some(small(1)), "until the commit the old one counts");
    let mut store = open(store.release());
    assert_eq!(read(&mut store).config, Some(small(1)));
    assert_eq!(now(store.commit(9)), Err(Error::NotStaged));
}

#[test]
fn epochs_grow() {
    let mut store = open(Flash::<8, 2048>::new(6));
    for (epoch, outcome) in
        [(0, Err(Error::Epoch { present: 0 })), (7, Ok(())), (7, Err(Error::Epoch { present: 7 }))]
    {
        now(store.stage(Change::Config(&small(1)))).unwrap();
        assert_eq!(now(store.commit(epoch)), outcome);
    }
    assert_eq!(open(store.release()).epoch(), 7);
}

#[test]
fn flash_full_of_anything_is_a_store_without_a_configuration() {
    // First word, middle and last word of each page. The last one is what the map would repair: an
    // interrupted erase.
    for [first, middle, last] in [[0x00; 3], [0x55; 3], [0xFF; 3], [0x00, 0x55, 0xFF], [0xFF, 0x55, 0x00]] {
        let mut flash = Flash::<8, 2048>::new(6);
        for page in flash.bytes.chunks_mut(2048).skip(1).take(4) {
            page.fill(middle);
            page[..8].fill(first);
            page[2040..].fill(last);
        }
        let bytes = flash.bytes.clone();
        let mut store = open(flash);
        assert_eq!(read(&mut store), Stored::default());
        assert!(store.flash().bytes == bytes, "looking must not write");
        assert_eq!(put(store.release(), &Put::Config(small(1))).0, Ok(()));
    }
}

#[test]
fn a_region_that_does_not_fit_the_pages_is_refused() {
    let backwards = core::ops::Range { start: 4 * 2048, end: 0 };
    for region in [0..3 * 2048, 0..2 * 2048, 100..4 * 2048 + 100, backwards] {
        let opened = now(Store::open(Flash::<8, 2048>::new(8), region.clone()));
        assert!(matches!(opened.map(|_| ()), Err(Error::Region)), "{region:?}");
    }
    assert!(matches!(now(Store::open(Flash::<4, 1024>::new(8), 0..8192)).map(|_| ()), Err(Error::Region)));
}

/// Lets the power fail `cut` steps from now.
fn arm<const W: usize, const P: usize>(store: &mut Store<Flash<W, P>>, cut: Option<u64>) {
    let flash = store.flash();
    flash.cut_after = cut.map(|n| flash.steps + n);
}

/// One step in the life of a node; `cut` is where in it the power fails.
#[derive(Clone, Debug)]
enum Step {
    Stage(Put, Option<u64>),
    Commit(Option<u64>),
    Restart,
}

fn change() -> impl Strategy<Value = Put> {
    prop_oneof![
        6 => (1..100_u8).prop_map(|id| Put::Config(small(id))),
        1 => Just(Put::Blank),
        2 => any::<u8>().prop_map(Put::Key),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (change(), prop::option::of(0..200_u64)).prop_map(|(change, cut)| Step::Stage(change, cut)),
        4 => prop::option::of(0..32_u64).prop_map(Step::Commit),
        1 => Just(Step::Restart),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    /// Against a model: what is committed, and what is staged since the start.
    #[test]
    fn any_life_with_any_cuts_keeps_what_was_committed(steps in prop::collection::vec(step(), 1..40), seed in any::<u64>()) {
        let mut flash = Flash::<8, 2048>::new(6);
        flash.seed = seed;
        let mut store = open(flash);
        let mut committed = Stored::default();
        let mut staged: Option<Stored> = None;
        for step in steps {
            let mut allowed = vec![committed.clone()];
            let (cut, result) = match &step {
                Step::Restart => (true, Ok(())),
                Step::Stage(change, cut) => {
                    let new = change.of(&committed);
                    arm(&mut store, *cut);
                    let result = now(stage(&mut store, change));
                    staged = result.is_ok().then_some(new);
                    (result.is_err(), result)
                }
                Step::Commit(cut) => {
                    arm(&mut store, *cut);
                    let result = now(store.commit(store.epoch() + 1));
                    match (&result, staged.take()) {
                        (Ok(()), new) => allowed = vec![new.clone().unwrap()],
                        (Err(Error::Flash(_)), Some(new)) => allowed.push(new),
                        (error, new) => prop_assert!(*error == Err(Error::NotStaged) && new.is_none(), "{error:?}"),
                    }
                    (matches!(result, Err(Error::Flash(_))), result)
                }
            };
            if cut {
                store = open(store.release().restarted(None));
                staged = None;
            }
            let found = read(&mut store);
            prop_assert!(allowed.contains(&found), "{step:?} gave {result:?}, found {found:?}");
            committed = found;
        }
    }
}
