//! A transfer: in order, in parts that are checked, repeated where an answer was lost; and who is refused.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail so")]

mod flash;

use flash::{Flash, PAGE, now};
use funnelnet_protocol::service::Body;
use funnelnet_protocol::update::{Block, Checksum, Image, MAX_BLOCK, Reply, Request, Status, UpdateError};
use funnelnet_update::{Regions, TRIAL_TICKS, Updater};

const BOARD: u32 = 7;
const P: u32 = PAGE as u32;
const REGIONS: Regions = Regions { state: 0..P, active: P..3 * P, spare: 3 * P..6 * P };
const ROOM: u32 = 2 * P;

struct Node {
    flash: Flash,
    updater: Updater,
    is_running: bool,
}

impl Node {
    fn new() -> Self {
        Self { flash: Flash::new(6), updater: Updater::new(REGIONS, BOARD), is_running: false }
    }

    /// Through the bytes of the wire.
    fn ask(&mut self, request: Request) -> Reply {
        let mut bytes = [0; 600];
        let length = request.encode(&mut bytes).unwrap();
        let request = Request::decode(request.kind(), &bytes[..length]).unwrap();
        now(self.updater.answer(&mut self.flash, &request, self.is_running))
    }

    fn begin(&mut self, program: &[u8]) -> Reply {
        let image = Image { board: BOARD, length: program.len() as u32, crc: Checksum::of(program) };
        self.ask(Request::Begin(image))
    }

    fn send(&mut self, program: &[u8]) {
        assert_eq!(self.begin(program), Reply::Begun(Ok(())));
        for offset in (0..program.len()).step_by(MAX_BLOCK) {
            let next = program.len().min(offset + MAX_BLOCK) as u32;
            assert_eq!(self.ask(block(program, offset)), Reply::Written(Ok(next)));
        }
    }

    fn status(&mut self) -> Status {
        match self.ask(Request::Status { length: 0 }) {
            Reply::Status(status) => status,
            other => panic!("{other:?}"),
        }
    }

    /// As after a swap by the boot loader.
    fn put_on_trial(&mut self) {
        self.flash.bytes[..PAGE].fill(0xFF);
        self.flash.bytes[..8].fill(0xF0);
        now(self.updater.look(&mut self.flash));
    }
}

fn block(program: &[u8], offset: usize) -> Request {
    let bytes = &program[offset..program.len().min(offset + MAX_BLOCK)];
    Request::Block(Block {
        offset: offset as u32,
        crc: Checksum::of(bytes),
        bytes: bytes.iter().copied().collect(),
    })
}

fn program(length: usize) -> Vec<u8> {
    (0..length).map(|i| (i * 7 + i / 256) as u8).collect()
}

#[test]
fn a_whole_program_arrives_is_checked_and_restarts_the_node() {
    for length in [1, 255, 256, 257, 1_000, ROOM as usize] {
        let (mut node, program) = (Node::new(), program(length));
        node.send(&program);
        assert_eq!(node.ask(Request::Swap), Reply::Restarts(Err(UpdateError::NotChecked)));
        assert_eq!(node.ask(Request::Check), Reply::Checked(Ok(())));
        assert!(node.status().is_checked && !node.updater.restarts());
        let start = REGIONS.spare.start as usize;
        assert_eq!(node.flash.bytes[start..][..length], program);
        assert_eq!(node.ask(Request::Swap), Reply::Restarts(Ok(())));
        assert!(node.updater.restarts());
    }
}

#[test]
fn a_block_that_comes_again_is_taken_once_and_counted() {
    let (mut node, program) = (Node::new(), program(600));
    node.begin(&program);
    for _ in 0..3 {
        assert_eq!(node.ask(block(&program, 0)), Reply::Written(Ok(256)));
    }
    assert_eq!(node.ask(block(&program, 256)), Reply::Written(Ok(512)));
    assert_eq!((node.status().repeated, node.status().refused), (2, 0));
    assert_eq!(node.status().received, 512);
}

#[test]
fn a_block_out_of_order_or_with_a_wrong_checksum_is_refused_and_counted() {
    let (mut node, program) = (Node::new(), program(1_000));
    assert_eq!(node.ask(block(&program, 0)), Reply::Written(Err(UpdateError::NotBegun)));
    node.begin(&program);
    let ahead = node.ask(block(&program, 256));
    assert_eq!(ahead, Reply::Written(Err(UpdateError::Order { next: 0 })));
    let Request::Block(mut spoilt) = block(&program, 0) else { panic!() };
    spoilt.bytes[17] ^= 1;
    assert_eq!(node.ask(Request::Block(spoilt)), Reply::Written(Err(UpdateError::Block)));
    let short = Block { offset: 0, crc: Checksum::of(&[1]), bytes: [1].into_iter().collect() };
    assert_eq!(node.ask(Request::Block(short)), Reply::Written(Err(UpdateError::Block)));
    assert_eq!((node.status().refused, node.status().received), (4, 0));
    assert_eq!(node.ask(Request::Check), Reply::Checked(Err(UpdateError::Incomplete { received: 0 })));
}

#[test]
fn a_program_for_another_board_or_without_room_does_not_begin() {
    let mut node = Node::new();
    let begin = |board, length| Request::Begin(Image { board, length, crc: 0 });
    assert_eq!(node.ask(begin(8, 10)), Reply::Begun(Err(UpdateError::Board { own: BOARD })));
    for length in [0, ROOM + 1, u32::MAX] {
        let reply = node.ask(begin(BOARD, length));
        assert_eq!(reply, Reply::Begun(Err(UpdateError::Length { room: ROOM })), "{length}");
    }
    assert_eq!(node.ask(begin(BOARD, ROOM)), Reply::Begun(Ok(())));
}

#[test]
fn a_node_that_runs_only_says_how_it_is() {
    let (mut node, program) = (Node::new(), program(10));
    node.send(&program);
    assert_eq!(node.ask(Request::Check), Reply::Checked(Ok(())));
    node.is_running = true;
    let before = node.flash.bytes.clone();
    let running = Err(UpdateError::Running);
    assert_eq!(node.begin(&program), Reply::Begun(running));
    assert_eq!(node.ask(block(&program, 0)), Reply::Written(Err(UpdateError::Running)));
    assert_eq!(node.ask(Request::Check), Reply::Checked(running));
    assert_eq!(node.ask(Request::Swap), Reply::Restarts(running));
    assert_eq!(node.ask(Request::Restart), Reply::Restarts(running));
    assert!(node.flash.bytes == before && !node.updater.restarts() && node.status().is_checked);
}

#[test]
fn flash_that_does_not_keep_a_program_is_noticed() {
    let (mut node, program) = (Node::new(), program(700));
    node.send(&program);
    node.flash.bytes[REGIONS.spare.start as usize + 300] ^= 4;
    assert!(matches!(node.ask(Request::Check), Reply::Checked(Err(UpdateError::Checksum { .. }))));
    assert_eq!(node.ask(Request::Swap), Reply::Restarts(Err(UpdateError::NotChecked)));
}

#[test]
fn a_program_on_trial_is_confirmed_by_its_last_tick_and_no_sooner() {
    let mut node = Node::new();
    node.put_on_trial();
    assert_eq!(node.begin(&program(10)), Reply::Begun(Err(UpdateError::OnTrial)));
    (1..=60).for_each(|completed| now(node.updater.note_ticks(&mut node.flash, completed)));
    // Configured anew: it counts anew.
    (1..TRIAL_TICKS - 60).for_each(|completed| now(node.updater.note_ticks(&mut node.flash, completed)));
    assert_eq!((node.status().on_trial, node.status().ticks_left), (true, 1));
    now(node.updater.note_ticks(&mut node.flash, TRIAL_TICKS - 60));
    assert!(!node.status().on_trial);
    assert_eq!(node.begin(&program(10)), Reply::Begun(Ok(())));
}

#[test]
fn a_tick_number_that_leaps_confirms_nothing() {
    let mut node = Node::new();
    node.put_on_trial();
    now(node.updater.note_ticks(&mut node.flash, 1_000_000));
    assert!(node.status().ticks_left > TRIAL_TICKS / 2);
}

#[test]
fn a_confirmation_that_the_flash_does_not_take_is_tried_again() {
    let mut node = Node::new();
    node.put_on_trial();
    node.flash.restart(Some(0));
    (1..=TRIAL_TICKS + 5).for_each(|completed| now(node.updater.note_ticks(&mut node.flash, completed)));
    assert!(node.status().on_trial);
    node.flash.restart(None);
    now(node.updater.note_ticks(&mut node.flash, TRIAL_TICKS + 6));
    assert!(!node.status().on_trial);
}

#[test]
fn the_checksum_of_the_running_program_is_told_for_any_length() {
    let mut node = Node::new();
    let running = program(3_000);
    node.flash.bytes[REGIONS.active.start as usize..][..3_000].copy_from_slice(&running);
    for length in [0, 1, 256, 3_000] {
        let Reply::Status(status) = node.ask(Request::Status { length }) else { panic!() };
        assert_eq!(status.crc, Checksum::of(&running[..length as usize]), "{length}");
    }
}

#[test]
fn regions_that_no_boot_loader_can_swap_in_are_refused() {
    assert!(REGIONS.suit(P));
    let broken = [
        Regions { spare: 3 * P..5 * P, ..REGIONS },
        Regions { active: P + 1..3 * P + 1, ..REGIONS },
        Regions { active: 2 * P..4 * P, ..REGIONS },
        Regions { state: 0..0, ..REGIONS },
        Regions { state: P..2 * P, ..REGIONS },
    ];
    for regions in broken {
        assert!(!regions.suit(P), "{regions:?}");
        let mut node = Node { updater: Updater::new(regions, BOARD), ..Node::new() };
        assert_eq!(node.begin(&program(10)), Reply::Begun(Err(UpdateError::Absent)));
    }
}
