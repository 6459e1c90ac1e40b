//! Played nodes that take new programs: the app of every node in a thread, with the updater and the boot loader of
//! every board over a flash in memory, and with what goes wrong.
#![allow(dead_code, reason = "each file of tests has its own use for this")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

#[path = "../../../update/tests/flash/mod.rs"]
mod flash;

use flash::{Flash, PAGE, now};
use funnelnet_app::link::{self, Health, Input};
use funnelnet_app::storage::Storage;
use funnelnet_app::{App, Clock, Platform, watchdog};
use funnelnet_node::{Session, Task};
use funnelnet_plant::Virtual;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Identity, Reply, StoreError};
use funnelnet_protocol::update::{self, Request, UPDATE, board_number};
use funnelnet_protocol::{NodeConfig, Refusal, WIRE_VERSION};
use funnelnet_update::{Regions, Updater, boot};
use sim_host::hub::{Attached, Device, Link, SLICE};
use sim_host::interrupt::Interrupt;
use std::cell::{Cell, RefCell};
use std::fs::File;
use std::future::poll_fn;
use std::io::{ErrorKind, Read, Write};
use std::ops::Range;
use std::os::unix::net::UnixStream;
use std::pin::pin;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

const P: u32 = PAGE as u32;
const REGIONS: Regions = Regions { state: 0..P, active: P..3 * P, spare: 3 * P..6 * P };
/// How long a node rests where nothing is to be done.
const PAUSE: Duration = Duration::from_micros(100);
/// How long a swap takes.
const SWAP: Duration = Duration::from_millis(30);
/// Longer than a third of the time for an answer, after which a block is sent again.
const LATE: Duration = Duration::from_millis(600);
/// What a slow node takes for each step.
const SLOW: Duration = Duration::from_millis(50);
/// Of the watchdog.
const WATCHDOG: Duration = Duration::from_millis(300);
/// Ticks of a trial.
pub const TICKS: u32 = funnelnet_update::TRIAL_TICKS;

/// A moment of an update, as a node sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// It is asked who it is, for the first time.
    Met,
    /// The program is announced.
    Begin,
    /// The block with this number comes.
    Block(u32),
    Check,
    Swap,
    /// It is told to restart.
    Restart,
    /// It starts, on trial.
    OnTrial,
    /// It is on trial, and this tick comes.
    Tick(u32),
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    Nothing,
    /// It says nothing from this moment on, and has no watchdog.
    SilentFrom(Moment),
    /// The same, until its watchdog has reset it.
    HangsAt(Moment),
    /// Its line is cut.
    CutAt(Moment),
    /// The user wants to stop.
    InterruptAt(Moment),
    /// It does not hear every third frame of an update, nor is every fourth answer heard.
    Loses,
    /// Every fifth block is spoilt behind the frame's own checksum.
    Spoils,
    /// Its flash does not keep a bit of the next program.
    WeakCell,
    /// It knows no frames of updates.
    WithoutFeature,
    /// It has another boot loader's map: none.
    WithoutBootLoader,
    /// It is another board.
    AnotherBoard,
    /// It does not hear that it is to swap for the first time.
    DeafToSwap,
    /// Its answer to that is lost.
    SwapUnheard,
    /// It is reset as it is asked for the n-th time how many ticks its trial still takes.
    ResetWhenAsked(u32),
    /// It does not count the ticks of its trial.
    CountsNoTicks,
    /// What it says as it stops is lost.
    ReportUnheard,
    /// It is reset when this block comes.
    ResetAt(u32),
    /// What it is given never comes up there: its watchdog takes it back.
    NeverComesUp,
    /// Some answers come after the block was sent again, and the block after that is lost.
    Late,
    /// It takes its time for each block and each tick.
    Slow,
}

/// A program of so many bytes, which differ by `seed`; it has the vectors of one for a Pico.
pub fn program(length: usize, seed: u32) -> Vec<u8> {
    let mut bytes: Vec<u8> =
        (0..length as u32).map(|i| (i.wrapping_mul(seed).wrapping_add(i >> 8) ^ seed) as u8).collect();
    bytes[..4].copy_from_slice(&0x2000_8000_u32.to_le_bytes());
    bytes[4..8].copy_from_slice(&0x1000_8041_u32.to_le_bytes());
    bytes
}

pub fn old() -> Vec<u8> {
    program(3_500, 31)
}

pub fn new() -> Vec<u8> {
    program(3_000, 77)
}

pub fn another() -> Vec<u8> {
    program(3_300, 55)
}

/// What a node has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Runs {
    Old,
    New,
    /// The third program.
    Another,
    /// None of them.
    Neither,
}

/// A played node.
pub struct Updatable {
    flash: Arc<Mutex<Flash>>,
    /// Starts since it was made.
    starts: Arc<AtomicU32>,
    /// Blocks and ticks of a trial that have come.
    steps: Arc<AtomicU32>,
    quit: Arc<AtomicBool>,
}

impl Updatable {
    /// What it starts with after its power was off: the boot loader's word is the last.
    pub fn runs_after_power_off(&self) -> Runs {
        let mut flash = self.flash.lock().unwrap().clone();
        start(&mut flash);
        let at = REGIONS.active.start as usize;
        let is = |program: Vec<u8>| flash.bytes[at..][..program.len()] == program;
        match () {
            () if is(old()) => Runs::Old,
            () if is(new()) => Runs::New,
            () if is(another()) => Runs::Another,
            () => Runs::Neither,
        }
    }

    /// Times that it has started.
    pub fn starts(&self) -> u32 {
        self.starts.load(Ordering::Relaxed)
    }

    /// Blocks that have come, and ticks of a trial.
    pub fn steps(&self) -> u32 {
        self.steps.load(Ordering::Relaxed)
    }

    /// Nothing was written or erased on it since it was made.
    pub fn is_untouched(&self) -> bool {
        self.flash.lock().unwrap().steps == 0
    }
}

impl Drop for Updatable {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
    }
}

/// Before it is attached.
pub struct Made {
    flash: Flash,
    flaw: Flaw,
    interrupt: Interrupt,
    ticked: u32,
}

impl Made {
    /// A node that has the old program.
    pub fn new(flaw: Flaw) -> Self {
        let mut flash = Flash::new(6);
        put(&mut flash, &old());
        Self { flash, flaw, interrupt: Interrupt::default(), ticked: 0 }
    }

    /// One that has the new program for good.
    pub fn updated() -> Self {
        let mut made = Self::new(Flaw::Nothing);
        put(&mut made.flash, &new());
        made
    }

    /// One that is on trial with this program, and has the old one.
    pub fn on_trial(program: &[u8], flaw: Flaw) -> Self {
        Self::new(flaw).trying(program)
    }

    /// It is on trial with this program.
    pub fn trying(self, program: &[u8]) -> Self {
        let mut made = self;
        let mut updater = Updater::new(REGIONS, 7);
        let mut ask = |request: Request| now(updater.answer(&mut made.flash, &request, false));
        let crc = update::Checksum::of(program);
        ask(Request::Begin(update::Image { board: 7, length: program.len() as u32, crc }));
        for (n, bytes) in program.chunks(update::MAX_BLOCK).enumerate() {
            let (offset, crc) = ((n * update::MAX_BLOCK) as u32, update::Checksum::of(bytes));
            ask(Request::Block(update::Block { offset, crc, bytes: bytes.iter().copied().collect() }));
        }
        ask(Request::Check);
        assert_eq!(ask(Request::Swap), update::Reply::Restarts(Ok(())));
        // The swap comes at its first start.
        made
    }

    /// It has completed so many ticks of its trial.
    pub fn ticked(self, ticked: u32) -> Self {
        Self { ticked, ..self }
    }

    pub fn interrupting(self, interrupt: &Interrupt) -> Self {
        Self { interrupt: interrupt.clone(), ..self }
    }

    /// Behind a pair of sockets, as node `id`.
    pub fn attach(self, id: u8) -> (Updatable, Attached) {
        let (ours, theirs) = UnixStream::pair().unwrap();
        ours.set_read_timeout(Some(SLICE)).unwrap();
        theirs.set_nonblocking(true).unwrap();
        let link = Link::new(id, "the played node".to_owned(), Box::new(ours), self.interrupt.clone());
        let attached = Attached { link, device: Box::new(PlayedDevice), uid: None };
        (self.start(theirs, id.into()), attached)
    }

    /// Behind a pseudo-terminal.
    pub fn at(self, terminal: File, uid: u64) -> Updatable {
        self.start(terminal, uid)
    }

    fn start(self, line: impl Read + Write + Send + 'static, uid: u64) -> Updatable {
        let flash = Arc::new(Mutex::new(self.flash));
        let (starts, quit) = (Arc::new(AtomicU32::new(0)), Arc::new(AtomicBool::new(false)));
        let steps = Arc::new(AtomicU32::new(0));
        let chip = Chip {
            flash: flash.clone(),
            starts: starts.clone(),
            steps: steps.clone(),
            quit: quit.clone(),
            uid,
        };
        let (flaw, interrupt, ticked) = (self.flaw, self.interrupt, self.ticked);
        std::thread::spawn(move || {
            chip.run(Box::new(line), Script::new(flaw, interrupt, ticked, chip.steps.clone()))
        });
        Updatable { flash, starts, steps, quit }
    }
}

fn put(flash: &mut Flash, program: &[u8]) {
    flash.bytes[REGIONS.active.start as usize..][..program.len()].copy_from_slice(program);
}

/// The boot loader.
fn start(flash: &mut Flash) {
    let shared = boot::Shared::new(RefCell::new(flash.clone()));
    boot::prepare(&shared, &REGIONS, &mut [0; 256]).unwrap();
    *flash = shared.into_inner().into_inner();
}

trait Port: Read + Write + Send {}
impl<T: Read + Write + Send> Port for T {}

struct Chip {
    flash: Arc<Mutex<Flash>>,
    starts: Arc<AtomicU32>,
    steps: Arc<AtomicU32>,
    quit: Arc<AtomicBool>,
    uid: u64,
}

impl Chip {
    /// Until nobody needs it any more.
    fn run(&self, port: Box<dyn Port>, script: Script) {
        let script = Rc::new(script);
        let mut line = Played {
            port,
            script: script.clone(),
            deframer: Deframer::new(),
            bytes: [0; 512],
            unread: 0..0,
            spoilt: Vec::new(),
        };
        while !self.quit.load(Ordering::Relaxed) && !script.is_cut.get() {
            self.boot();
            script.restart();
            (line.deframer, line.unread) = (Deframer::new(), 0..0);
            self.live(&mut line, &script);
        }
    }

    fn boot(&self) {
        let starts = self.starts.fetch_add(1, Ordering::Relaxed);
        let mut flash = self.flash.lock().unwrap();
        let before = flash.steps;
        start(&mut flash);
        let swapped = starts > 0 && flash.steps > before;
        drop(flash);
        if swapped {
            std::thread::sleep(SWAP);
        }
    }

    /// Until it restarts.
    fn live(&self, line: &mut Played, script: &Rc<Script>) {
        let starts = u8::try_from(self.starts.load(Ordering::Relaxed)).unwrap_or(u8::MAX);
        let (wire_version, firmware) = (WIRE_VERSION, [0, starts, 0]);
        let identity = Identity { wire_version, firmware, uid: self.uid, ..Identity::default() };
        let mut storage = PlayedStorage {
            updater: self.updater(script),
            flash: self.flash.clone(),
            script: script.clone(),
        };
        let mut session = Session::new(identity);
        let platform = Platform { watchdog: watchdog::Absent, clock: Wall(Instant::now()), log: () };
        let mut app = App::new(&mut session, line, &mut storage, Virtual, platform);
        let mut node = pin!(app.run());
        while !self.quit.load(Ordering::Relaxed) && !script.is_over() {
            let pending = node.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending();
            assert!(pending, "a node runs for ever");
            std::thread::sleep(PAUSE);
        }
    }

    fn updater(&self, script: &Script) -> Updater {
        let board = if script.flaw.get() == Flaw::AnotherBoard { 7 } else { board_number("rp2040-pico") };
        let regions = match script.flaw.get() {
            Flaw::WithoutBootLoader => Regions { spare: 0..0, ..REGIONS },
            _ => REGIONS,
        };
        let mut updater = Updater::new(regions, board);
        let mut flash = self.flash.lock().unwrap();
        now(updater.look(&mut *flash));
        (1..=script.ticked.take()).for_each(|completed| now(updater.note_ticks(&mut *flash, completed)));
        let status = now(updater.answer(&mut *flash, &Request::Status { length: 0 }, false));
        let on_trial = matches!(status, update::Reply::Status(update::Status { on_trial: true, .. }));
        script.on_trial.set(on_trial);
        if on_trial {
            script.at(Moment::OnTrial);
        }
        updater
    }
}

/// That a node says nothing, and until when.
#[derive(Clone, Copy, PartialEq)]
enum Hung {
    No,
    UntilReset(Instant),
    ForEver,
}

/// What happens to a node, and when.
struct Script {
    flaw: Cell<Flaw>,
    interrupt: Interrupt,
    on_trial: Cell<bool>,
    hung: Cell<Hung>,
    restarts: Cell<bool>,
    is_cut: Cell<bool>,
    /// Frames of an update, answers to them, and SYNCs of a trial, so far.
    counts: [Cell<u32>; 3],
    /// Ticks of its trial that it has completed before anybody comes.
    ticked: Cell<u32>,
    steps: Arc<AtomicU32>,
}

impl Script {
    fn new(flaw: Flaw, interrupt: Interrupt, ticked: u32, steps: Arc<AtomicU32>) -> Self {
        Self {
            flaw: Cell::new(flaw),
            interrupt,
            on_trial: Cell::new(false),
            hung: Cell::new(Hung::No),
            restarts: Cell::new(false),
            is_cut: Cell::new(false),
            counts: Default::default(),
            ticked: Cell::new(ticked),
            steps,
        }
    }

    fn restart(&self) {
        self.restarts.set(false);
        if matches!(self.hung.get(), Hung::UntilReset(_)) {
            self.hung.set(Hung::No);
        }
        self.counts[2].set(0);
    }

    /// Whether what runs has come to its end.
    fn is_over(&self) -> bool {
        let reset = matches!(self.hung.get(), Hung::UntilReset(since) if since.elapsed() > WATCHDOG);
        self.restarts.get() || self.is_cut.get() || reset
    }

    fn count(&self, which: usize) -> u32 {
        self.counts[which].set(self.counts[which].get() + 1);
        self.counts[which].get()
    }

    fn at(&self, moment: Moment) {
        if matches!(moment, Moment::Block(_) | Moment::Tick(_)) {
            self.steps.fetch_add(1, Ordering::Relaxed);
            if self.flaw.get() == Flaw::Slow {
                std::thread::sleep(SLOW);
            }
        }
        match self.flaw.get() {
            Flaw::SilentFrom(at) if at == moment => self.hung.set(Hung::ForEver),
            Flaw::HangsAt(at) if at == moment => {
                self.hung.set(Hung::UntilReset(Instant::now()));
                self.flaw.set(Flaw::Nothing);
            }
            Flaw::NeverComesUp if moment == Moment::OnTrial => {
                self.hung.set(Hung::UntilReset(Instant::now()))
            }
            Flaw::CutAt(at) if at == moment => self.is_cut.set(true),
            Flaw::InterruptAt(at) if at == moment => self.interrupt.set(),
            Flaw::ResetAt(block) if moment == Moment::Block(block) => {
                self.restarts.set(true);
                self.flaw.set(Flaw::Nothing);
            }
            _ => {}
        }
    }

    fn asked_for_ticks(&self) {
        match self.flaw.get() {
            Flaw::ResetWhenAsked(1) => {
                self.restarts.set(true);
                self.flaw.set(Flaw::Nothing);
            }
            Flaw::ResetWhenAsked(n) => self.flaw.set(Flaw::ResetWhenAsked(n - 1)),
            _ => {}
        }
    }

    /// Takes note of a frame that has come; whether the node hears it.
    fn hears_block(&self, count: u32) -> bool {
        if count % 5 == 2 {
            std::thread::sleep(LATE);
        }
        count % 5 != 4
    }

    fn hears(&self, frame: &Result<Frame<'_>, Refusal>) -> bool {
        let mut hears = true;
        match frame {
            Ok(Frame::Service { kind: UPDATE, body, .. }) => {
                let count = self.count(0);
                let request = Request::decode(UPDATE, body).unwrap();
                match &request {
                    Request::Begin(_) => self.at(Moment::Begin),
                    Request::Block(block) => self.at(Moment::Block(block.offset / update::BLOCK_UNIT)),
                    Request::Check => self.at(Moment::Check),
                    Request::Swap => self.at(Moment::Swap),
                    Request::Restart => self.at(Moment::Restart),
                    Request::Status { length: 0 } => self.asked_for_ticks(),
                    _ => {}
                }
                hears = match self.flaw.get() {
                    Flaw::WithoutFeature => false,
                    Flaw::Loses => !count.is_multiple_of(3),
                    Flaw::Late if matches!(request, Request::Block(_)) => self.hears_block(count),
                    Flaw::DeafToSwap if request == Request::Swap => {
                        self.flaw.set(Flaw::Nothing);
                        false
                    }
                    _ => true,
                };
            }
            Ok(Frame::Service { .. }) => self.at(Moment::Met),
            Ok(Frame::RealTime(Message::Sync { .. })) if self.on_trial.get() => {
                let tick = self.count(2);
                self.at(Moment::Tick(tick));
            }
            _ => {}
        }
        hears && self.hung.get() == Hung::No && !self.is_over()
    }

    /// Whether the host hears this.
    fn is_heard(&self, reply: &Reply) -> bool {
        if matches!(reply, Reply::Report(_)) {
            return self.flaw.get() != Flaw::ReportUnheard;
        }
        let Reply::Update(reply) = reply else { return true };
        let count = self.count(1);
        match self.flaw.get() {
            Flaw::Loses => !count.is_multiple_of(4),
            Flaw::SwapUnheard => !matches!(reply, update::Reply::Restarts(_)),
            _ => true,
        }
    }
}

/// A node's end of its line.
struct Played {
    port: Box<dyn Port>,
    script: Rc<Script>,
    deframer: Deframer<MAX_RAW>,
    bytes: [u8; 512],
    /// Bytes that were received and not read yet.
    unread: Range<usize>,
    /// A body that is not what was sent.
    spoilt: Vec<u8>,
}

impl Played {
    fn receive(&mut self) -> bool {
        if self.unread.is_empty() && !self.script.is_over() {
            // An error: nothing has come.
            self.unread = 0..self.port.read(&mut self.bytes).unwrap_or(0);
        }
        !self.unread.is_empty()
    }

    fn put(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() && self.script.hung.get() == Hung::No && !self.script.is_cut.get() {
            match self.port.write(rest) {
                Ok(length) => rest = &rest[length..],
                Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(PAUSE),
                Err(_) => return,
            }
        }
    }
}

impl link::Link for Played {
    async fn wait(&mut self, _: impl Clock) {
        poll_fn(|_| if self.receive() { Poll::Ready(()) } else { Poll::Pending }).await;
    }

    fn next(&mut self, _: u64) -> Option<Input<'_>> {
        let script = self.script.clone();
        while let Some(byte) = self.unread.next().map(|at| self.bytes[at]) {
            if byte != 0 {
                let _ = self.deframer.push(byte);
                continue;
            }
            let frame = self.deframer.push(byte)?;
            if !script.hears(&frame) {
                return None;
            }
            if let Ok(Frame::Service { kind: UPDATE, source, body }) = frame
                && script.flaw.get() == Flaw::Spoils
                && script.counts[0].get().is_multiple_of(5)
                && body.len() > 100
            {
                self.spoilt = body.to_vec();
                self.spoilt[90] ^= 1;
                return Some(Input::Frame(Ok(Frame::Service { kind: UPDATE, source, body: &self.spoilt })));
            }
            return Some(Input::Frame(frame));
        }
        None
    }

    async fn send(&mut self, message: &Message, _: u64) {
        self.put(&serial::encode(message));
    }

    async fn reply(&mut self, reply: &Reply, source: u8) {
        if !self.script.is_heard(reply) {
            return;
        }
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        let length = serial::encode_service(reply, source, &mut scratch, &mut frame).unwrap();
        self.put(&frame[..length]);
    }

    fn health(&self) -> Health {
        Health::default()
    }
}

/// Keeps no configuration, and programs.
struct PlayedStorage {
    updater: Updater,
    flash: Arc<Mutex<Flash>>,
    script: Rc<Script>,
}

impl Storage for PlayedStorage {
    async fn load(&mut self, room: &mut Option<NodeConfig>) {
        *room = None;
    }

    async fn has_key(&mut self) -> bool {
        false
    }

    async fn perform(&mut self, _: Task<'_>) -> Result<u32, StoreError> {
        Err(StoreError::Absent)
    }

    async fn update(&mut self, request: &Request, is_running: bool) -> update::Reply {
        let mut flash = self.flash.lock().unwrap();
        let reply = now(self.updater.answer(&mut *flash, request, is_running));
        if self.script.flaw.get() == Flaw::WeakCell
            && matches!(request, Request::Block(block) if block.offset == 512)
        {
            flash.bytes[REGIONS.spare.start as usize + 600] ^= 4;
        }
        reply
    }

    async fn note_ticks(&mut self, completed: u32) {
        if self.script.flaw.get() == Flaw::CountsNoTicks {
            return;
        }
        now(self.updater.note_ticks(&mut *self.flash.lock().unwrap(), completed));
    }

    fn wants_restart(&self) -> bool {
        self.updater.restarts()
    }

    fn restart(&mut self) {
        self.script.restarts.set(true);
    }
}

#[derive(Clone, Copy)]
struct Wall(Instant);

impl Clock for Wall {
    fn now(self) -> u64 {
        self.0.elapsed().as_nanos() as u64
    }

    fn wait_until(self, at: u64) -> impl Future<Output = ()> {
        poll_fn(move |_| if self.now() >= at { Poll::Ready(()) } else { Poll::Pending })
    }
}

/// What a played node runs on: nobody knows more than it says.
struct PlayedDevice;

impl Device for PlayedDevice {
    fn last_words(&mut self, _: bool) -> Vec<String> {
        Vec::new()
    }

    fn into_log(self: Box<Self>) -> Option<String> {
        None
    }
}
