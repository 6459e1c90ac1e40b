//! The power fails at every byte of every write, and in every erase, of an update, of the swap and of the way
//! back: what starts then is the old program or the new one, whole, and the configuration is there.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail so")]

mod flash;

use core::cell::RefCell;
use std::ops::Range;

use embassy_sync::blocking_mutex::Mutex;
use flash::{Fault, Flash, PAGE, now};
use funnelnet_node::Task;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::update::{Block, Checksum, Image, MAX_BLOCK, Reply, Request, Status, UpdateError};
use funnelnet_store::Store;
use funnelnet_update::{Regions, TRIAL_TICKS, Updater, boot};

const BOARD: u32 = 7;
const P: u32 = PAGE as u32;
/// Pages of a program.
const PAGES: u32 = 2;
/// Where the configuration is.
const STORAGE: Range<u32> = 0..4 * P;

/// State, active, spare, behind the storage.
fn regions() -> Regions {
    let active = 5 * P..(5 + PAGES) * P;
    Regions { state: 4 * P..5 * P, spare: active.end..active.end + (PAGES + 1) * P, active }
}

/// A program that fills its part but for a few bytes.
fn program(seed: u32) -> Vec<u8> {
    (0..PAGES * P - 100).map(|i| (i.wrapping_mul(seed).wrapping_add(i >> 8) ^ seed) as u8).collect()
}

fn old() -> Vec<u8> {
    program(31)
}

fn new() -> Vec<u8> {
    program(77)
}

fn config() -> NodeConfig {
    NodeConfig::builder(3, 1_000_000).state([1.0]).build().unwrap()
}

/// A chip on which the old program runs, with a configuration.
fn chip() -> Flash {
    let mut flash = Flash::new(5 + 2 * PAGES as usize + 1);
    let start = regions().active.start as usize;
    flash.bytes[start..][..old().len()].copy_from_slice(&old());
    let mut store = now(Store::open(flash, STORAGE)).unwrap();
    now(store.perform(Task::Store(&config()))).unwrap();
    let mut flash = store.release();
    flash.restart(None);
    flash
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Runs {
    Old,
    New,
}

/// What would start; anything else than one of the two, whole, is the end of the node.
fn runs(flash: &Flash) -> Option<Runs> {
    let start = regions().active.start as usize;
    let is = |program: Vec<u8>| flash.bytes[start..][..program.len()] == program;
    match (is(old()), is(new())) {
        (true, _) => Some(Runs::Old),
        (_, true) => Some(Runs::New),
        _ => None,
    }
}

/// The boot loader; whether it came to its end.
fn start(flash: &mut Flash) -> bool {
    start_with::<{ funnelnet_update::WORD }>(flash)
}

fn start_with<const W: usize>(flash: &mut Flash) -> bool {
    let shared = Mutex::new(RefCell::new(flash.clone()));
    let done = boot::prepare_with::<_, W>(&shared, &regions(), &mut [0; 256]).is_ok();
    *flash = shared.into_inner().into_inner();
    done
}

fn keeps_configuration(flash: &Flash) -> bool {
    let mut copy = flash.clone();
    copy.restart(None);
    let mut store = now(Store::open(copy, STORAGE)).unwrap();
    let mut room = None;
    now(store.load(&mut room)).is_ok() && room == Some(config())
}

fn blocks(program: &[u8]) -> impl Iterator<Item = Block> + '_ {
    program.chunks(MAX_BLOCK).enumerate().map(|(i, bytes)| Block {
        offset: (i * MAX_BLOCK) as u32,
        crc: Checksum::of(bytes),
        bytes: bytes.iter().copied().collect(),
    })
}

fn image(program: &[u8]) -> Image {
    Image { board: BOARD, length: program.len() as u32, crc: Checksum::of(program) }
}

fn updater(flash: &mut Flash) -> Updater {
    let mut updater = Updater::new(regions(), BOARD);
    now(updater.look(flash));
    updater
}

fn status(updater: &mut Updater, flash: &mut Flash) -> Status {
    match now(updater.answer(flash, &Request::Status { length: new().len() as u32 }, false)) {
        Reply::Status(status) => status,
        other => panic!("{other:?}"),
    }
}

/// Sends a program, up to the restart into it.
fn update(flash: &mut Flash, program: &[u8]) -> Result<(), UpdateError> {
    let mut updater = updater(flash);
    let mut ask = |request: Request| match now(updater.answer(flash, &request, false)) {
        Reply::Begun(outcome) | Reply::Checked(outcome) | Reply::Restarts(outcome) => outcome,
        Reply::Written(outcome) => outcome.map(|_| ()),
        other => panic!("{other:?}"),
    };
    ask(Request::Begin(image(program)))?;
    blocks(program).try_for_each(|block| ask(Request::Block(block)))?;
    ask(Request::Check)?;
    ask(Request::Swap)
}

/// The running program completes ticks.
fn tick(flash: &mut Flash, ticks: u32) {
    let mut updater = updater(flash);
    (1..=ticks).for_each(|completed| now(updater.note_ticks(flash, completed)));
}

/// A new program that ticks, or one that does not come up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Life {
    Good,
    Bad,
}

/// An update until nothing changes any more; ends early where the power fails.
fn live(flash: &mut Flash, life: Life) -> Result<(), Fault> {
    let cut = |done: bool| if done { Ok(()) } else { Err(Fault::PowerCut) };
    cut(update(flash, &new()).is_ok())?;
    cut(start(flash))?;
    settle(flash, life)
}

/// Whatever runs goes on from a start on until nothing changes any more.
fn settle(flash: &mut Flash, life: Life) -> Result<(), Fault> {
    let cut = |done: bool| if done { Ok(()) } else { Err(Fault::PowerCut) };
    for _ in 0..3 {
        if life == Life::Good && runs(flash) == Some(Runs::New) {
            tick(flash, TRIAL_TICKS);
        }
        cut(start(flash))?;
    }
    Ok(())
}

/// Steps of a life without a cut.
fn length(life: Life) -> u64 {
    let mut flash = chip();
    live(&mut flash, life).unwrap();
    flash.steps
}

/// Cuts a life at `first`, and what follows at `second`; what is wrong then.
fn broken(life: Life, first: u64, second: Option<u64>) -> Option<String> {
    wrong_after(life, first, second).0
}

/// The same, and whether the second cut came before all was done.
fn wrong_after(life: Life, first: u64, second: Option<u64>) -> (Option<String>, bool) {
    let mut flash = chip();
    flash.seed = first.wrapping_mul(31).wrapping_add(second.unwrap_or(0));
    flash.restart(Some(first));
    let _ = live(&mut flash, life);
    flash.restart(second);
    let mut done = start(&mut flash);
    let struck = !done;
    if struck {
        flash.restart(None);
        done = start(&mut flash);
    }
    let Some(found) = runs(&flash) else { return (Some("neither program is whole".to_owned()), struck) };
    if !done || !keeps_configuration(&flash) {
        return (Some(format!("{found:?}, done {done}, or the configuration is lost")), struck);
    }
    flash.restart(None);
    settle(&mut flash, life).unwrap();
    let wrong = match (life, runs(&flash)) {
        (Life::Bad, Some(Runs::Old)) | (Life::Good, Some(_)) if keeps_configuration(&flash) => None,
        (_, end) => Some(format!("{found:?} became {end:?}")),
    };
    (wrong, struck)
}

#[test]
fn an_update_without_a_cut_arrives_and_a_bad_one_goes_back() {
    for (life, end) in [(Life::Good, Runs::New), (Life::Bad, Runs::Old)] {
        let mut flash = chip();
        live(&mut flash, life).unwrap();
        assert_eq!(runs(&flash), Some(end), "{life:?}");
        assert!(keeps_configuration(&flash));
        let mut again = updater(&mut flash);
        assert!(!status(&mut again, &mut flash).on_trial);
    }
}

#[test]
fn every_cut_leaves_one_of_the_two_programs_and_the_configuration() {
    for life in [Life::Good, Life::Bad] {
        let length = length(life);
        let mut ends = 0;
        for cut in 0..length {
            if let Some(wrong) = broken(life, cut, None) {
                panic!("{life:?}, cut at {cut} of {length}: {wrong}");
            }
            ends += 1;
        }
        println!("{life:?}: {ends} cuts");
    }
}

#[test]
fn a_second_cut_while_it_goes_on_changes_nothing() {
    let length = length(Life::Bad);
    let mut pairs = 0;
    for first in (0..length).step_by(397) {
        for second in (0..length).step_by(409) {
            let (wrong, struck) = wrong_after(Life::Bad, first, Some(second));
            assert!(wrong.is_none(), "cuts at {first} and {second}: {wrong:?}");
            pairs += u32::from(struck);
        }
    }
    println!("{pairs} pairs of cuts");
    assert!(pairs > 100, "the second cut did not come");
}

/// Erases of the page of state that are cut off, with words of one byte, and of eight: the harness sees the
/// difference, and why `Wide` is there.
#[test]
fn words_of_a_single_byte_do_not_survive() {
    let lost = |narrow: bool| {
        (0..20_000_u64)
            .filter(|&seed| {
                let mut flash = chip();
                flash.seed = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
                is_lost(&mut flash, narrow, seed)
            })
            .count()
    };
    let (narrow, wide) = (lost(true), lost(false));
    println!("lost of 20,000: {narrow} with words of 1 byte, {wide} with words of 8");
    assert!(narrow > 0 && wide == 0);
}

/// A program that has been confirmed, and is whole; then the erase of its state is cut off.
fn is_lost(flash: &mut Flash, narrow: bool, seed: u64) -> bool {
    let width = if narrow { 1 } else { funnelnet_update::WORD };
    let state = regions().state.start as usize;
    // Swapped, and confirmed: magic, no longer valid, and all marks of the way there.
    flash.bytes[state..][..width].fill(0xF0);
    flash.bytes[state + width..][..width * (1 + 2 * PAGES as usize)].fill(0x00);
    flash.restart(Some(seed % 8));
    let _ = embedded_storage::nor_flash::NorFlash::erase(flash, regions().state.start, regions().state.end);
    flash.restart(None);
    let _ = if narrow { start_with::<1>(flash) } else { start(flash) };
    runs(flash) != Some(Runs::Old)
}
