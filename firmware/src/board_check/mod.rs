//! A board that checks its own hardware, by the drivers that its node has, and says what it found: rows of a Markdown table on the line to the
//! host. It is no node. What each row says: docs/book/src/board-check.md.
//!
//! The last check is the watchdog's, which resets the board. So what was found is kept in RAM meanwhile ([`reset::keep`]), and the report goes
//! on behind the reset. The same tells a reset in the middle of another check.

pub mod can;
mod echo;
mod page;
pub mod report;
mod ticks;

use embedded_hal::digital::OutputPin;
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use funnelnet_app::Clock;
use funnelnet_app::storage::Storage;
use funnelnet_app::watchdog::Watchdog;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::ResetCause;

use crate::app::{BoardClock, Chip};
use crate::reset;
use crate::storage::flash::{InFlash, OnFlash};
use can::{Can, FRAMES};
use echo::BYTES;
use report::{Counts, Report, Text, Verdict};
use ticks::TICKS;

/// Nanoseconds from one feeding to the next of a watchdog that nothing else feeds.
const FEEDING: u64 = 200_000_000;
/// Nanoseconds from one note of the time to the next while nobody feeds it.
const NOTING: u64 = 1_000_000;

/// What a board is and should do, by its data sheets.
pub struct Facts {
    /// Its name, as in the tables of the book.
    pub board: &'static str,
    /// Where the jumper of the echo goes.
    pub jumper: &'static str,
    /// The clock that it should have.
    pub clock: &'static str,
    /// What it has instead where that one does not start.
    pub other_clock: &'static str,
    /// Of its ticks, us.
    pub spread_us: u32,
    /// Bytes of its flash that are erased together: a page of the storage, or a half of it.
    pub page: u32,
    /// Of writing so many bytes, us.
    pub program_us: u32,
    /// Of erasing them, us.
    pub erase_us: u32,
    /// From the last feeding of its watchdog to the reset, us, at least and at most.
    pub watchdog_us: (u32, u32),
}

/// What a board hands over to be checked.
pub struct Bench<H, E, C, F, P, W> {
    /// What it should do.
    pub facts: Facts,
    /// The line to the host, which the report goes to.
    pub host: H,
    /// A line for the echo.
    pub echo: E,
    /// Its CAN controller, looped back.
    pub can: C,
    /// Its storage.
    pub storage: OnFlash<F>,
    /// The pin that changes at each tick.
    pub pin: P,
    /// Number, start and watchdog.
    pub chip: Chip<W>,
    /// Whether it has the clock that it should have.
    pub has_clock: bool,
}

/// The flash of a bench, by the name of all its parts.
pub trait Flashed {
    /// Its driver.
    type Flash: NorFlash;
}

impl<H, E, C, F: NorFlash, P, W> Flashed for Bench<H, E, C, F, P, W> {
    type Flash = F;
}

/// Where the storage of a bench stays.
pub type StorageOf<B> = InFlash<<B as Flashed>::Flash>;

/// A check, as it is kept over a reset.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    Ticks = 1,
    Echo,
    Can,
    Flash,
    Watchdog,
}

impl Step {
    const fn name(self) -> &'static str {
        match self {
            Self::Ticks => "ticks",
            Self::Echo => "serial echo",
            Self::Can => "CAN loop-back",
            Self::Flash => "storage",
            Self::Watchdog => "watchdog",
        }
    }

    fn of(code: u32) -> Option<Self> {
        [Self::Ticks, Self::Echo, Self::Can, Self::Flash, Self::Watchdog]
            .into_iter()
            .find(|step| *step as u32 == code)
    }
}

/// The program of a board's check: `board_check!(start, BENCH)`, where `start` is a function that gives the [`Bench`] of type `BENCH`.
#[macro_export]
macro_rules! board_check {
    ($start:ident, $bench:ty) => {
        #[embassy_executor::task]
        async fn check(bench: $bench) {
            static STORAGE: static_cell::StaticCell<$crate::board_check::StorageOf<$bench>> =
                static_cell::StaticCell::new();
            static ROOM: static_cell::ConstStaticCell<Option<funnelnet_protocol::NodeConfig>> =
                static_cell::ConstStaticCell::new(None);
            // May panic: where there are two of this task, and there is one.
            let room = ROOM.take();
            $crate::board_check::run(bench, &STORAGE, room).await
        }

        #[cortex_m_rt::entry]
        #[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
        fn main() -> ! {
            static EXECUTOR: static_cell::StaticCell<$crate::executor::Executor> =
                static_cell::StaticCell::new();
            let check = check($start()).expect("the task is spawned once");
            EXECUTOR.init($crate::executor::Executor::new()).run(|spawner| spawner.spawn(check))
        }

        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo) -> ! {
            $crate::panic::report(info)
        }
    };
}

/// Checks a board, once; then nothing happens any more until it is started anew.
///
/// # Panics
/// `place` is taken.
pub async fn run<H: Write, E: Read + Write, C: Can, F: NorFlash + 'static, P: OutputPin, W: Watchdog>(
    bench: Bench<H, E, C, F, P, W>,
    place: &'static static_cell::StaticCell<InFlash<F>>,
    room: &'static mut Option<NodeConfig>,
) {
    use crate::storage::Medium;
    let Bench { facts, host, mut echo, mut can, storage, mut pin, chip, has_clock } = bench;
    let mut checks = Checks { report: Report::new(host, facts.board), facts, watchdog: chip.watchdog };
    // On some boards it is on already.
    checks.watchdog.start();
    checks.watchdog.feed();
    if let Some(kept) = reset::kept() {
        checks.after_reset(kept, chip.start.reset).await;
    } else {
        checks.report.begin().await;
        checks.identity(chip.uid, has_clock).await;
        checks.ticks(&mut pin).await;
        checks.echo(&mut echo).await;
        checks.can(&mut can).await;
        checks.storage(storage.open(place).await, room).await;
        checks.bite().await;
    }
    reset::forget();
    checks.report.end().await;
    loop {
        checks.watchdog.feed();
        BoardClock.wait_until(BoardClock.now() + FEEDING).await;
    }
}

struct Checks<H, W> {
    report: Report<H>,
    facts: Facts,
    watchdog: W,
}

impl<H: Write, W: Watchdog> Checks<H, W> {
    fn begin(&mut self, step: Step) {
        self.watchdog.feed();
        self.keep(step, 0);
    }

    fn keep(&self, step: Step, elapsed_us: u32) {
        let Counts { pass, fail, skipped } = self.report.counts;
        reset::keep([step as u32, elapsed_us, pass, fail, skipped]);
    }

    async fn identity(&mut self, uid: u64, has_clock: bool) {
        let is_number = uid != 0 && uid != u64::MAX;
        let limit = Text::of("neither all zeros nor all ones");
        self.report.row("unique number", Verdict::of(is_number), &Text::of("0x").hex(uid, 16), &limit).await;
        let found = Text::of(if has_clock { self.facts.clock } else { self.facts.other_clock });
        self.report.row("clock", Verdict::of(has_clock), &found, &Text::of(self.facts.clock)).await;
    }

    async fn ticks(&mut self, pin: &mut impl OutputPin) {
        self.begin(Step::Ticks);
        let late = ticks::run(pin, &mut self.watchdog).await;
        let measured =
            Text::of("spread ").number(late.spread).text(" us, latest ").number(late.most).text(" us, of ");
        let limit = Text::of("spread of at most ").number(self.facts.spread_us).text(" us");
        let verdict = Verdict::of(late.spread <= self.facts.spread_us);
        self.report.row(Step::Ticks.name(), verdict, &measured.number(TICKS), &limit).await;
    }

    async fn echo(&mut self, line: &mut (impl Read + Write)) {
        self.begin(Step::Echo);
        let heard = echo::run(line).await;
        let (verdict, measured) = match heard.heard {
            0 if heard.wrong == 0 => {
                (Verdict::Skipped, Text::of("nothing came: no jumper ").text(self.facts.jumper))
            }
            count => (
                Verdict::of(heard.wrong == 0),
                Text::of("").number(count).text(" bytes, ").number(heard.wrong).text(" wrong"),
            ),
        };
        let limit = Text::of("").number(BYTES as u32).text(" bytes, 0 wrong");
        self.report.row(Step::Echo.name(), verdict, &measured, &limit).await;
    }

    async fn can(&mut self, can: &mut impl Can) {
        self.begin(Step::Can);
        let (verdict, measured) = match can.looped().await {
            None => (Verdict::Skipped, Text::of("no CAN controller")),
            Some(good) => (Verdict::of(good == FRAMES), Text::of("").number(good).text(" frames came back")),
        };
        self.report
            .row(Step::Can.name(), verdict, &measured, &Text::of("").number(FRAMES).text(" frames"))
            .await;
    }

    /// The page is one that nothing counts in; what is stored is read before and after.
    async fn storage<F: NorFlash>(&mut self, storage: &mut InFlash<F>, room: &mut Option<NodeConfig>) {
        self.begin(Step::Flash);
        let before = stored(storage, room).await;
        let outcome = match storage.spare_page(self.facts.page).await {
            Some((flash, page)) => page::run(flash, page, &mut self.watchdog).await.ok(),
            None => None,
        };
        self.watchdog.feed();
        self.page(outcome).await;
        let after = stored(storage, room).await;
        let measured = match after {
            Some((id, checksum)) => {
                Text::of("node ").number(id.into()).text(", checksum 0x").hex(checksum.into(), 8)
            }
            None => Text::of("none"),
        };
        self.report
            .row("stored configuration", Verdict::of(before == after), &measured, &Text::of("as before"))
            .await;
    }

    async fn page(&mut self, outcome: Option<page::Outcome>) {
        let Facts { page, program_us, erase_us, .. } = self.facts;
        let (program, erase) = match &outcome {
            None => {
                let refused = (Verdict::Fail, Text::of("the driver refuses"));
                (refused.clone(), refused)
            }
            Some(found) => (
                judged(found.program_us, program_us, found.wrong, " bytes wrong"),
                judged(found.erase_us, erase_us, found.left, " bytes not erased"),
            ),
        };
        for (name, (verdict, measured), most) in
            [("program", program, program_us), ("erase", erase, erase_us)]
        {
            let limit = Text::of("at most ").number(most).text(" us for ").number(page).text(" bytes");
            self.report.row(name, verdict, &measured, &limit).await;
        }
    }

    /// Stops feeding. It comes back only where nothing bites.
    async fn bite(&mut self) {
        self.begin(Step::Watchdog);
        let begin = BoardClock.now();
        let most = self.facts.watchdog_us.1;
        loop {
            let elapsed = since(begin);
            if elapsed > most.saturating_mul(2) {
                break;
            }
            self.keep(Step::Watchdog, elapsed);
            BoardClock.wait_until(BoardClock.now() + NOTING).await;
        }
        self.watchdog.feed();
        let measured = Text::of("no reset within ").number(most.saturating_mul(2)).text(" us");
        self.report.row(Step::Watchdog.name(), Verdict::Fail, &measured, &self.watchdog_limit()).await;
    }

    /// The report goes on behind a reset.
    async fn after_reset(
        &mut self,
        [step, elapsed, pass, fail, skipped]: [u32; reset::KEPT],
        cause: ResetCause,
    ) {
        self.report.counts = Counts { pass, fail, skipped };
        let Some(step) = Step::of(step) else { return };
        if step != Step::Watchdog {
            let measured = Text::of("reset in it: ").text(name(cause));
            self.report.row(step.name(), Verdict::Fail, &measured, &Text::of("no reset")).await;
            return;
        }
        let (least, most) = self.facts.watchdog_us;
        let verdict = Verdict::of(cause == ResetCause::Watchdog && (least..=most).contains(&elapsed));
        let measured = Text::of("reset by ").text(name(cause)).text(" after ").number(elapsed).text(" us");
        self.report.row(step.name(), verdict, &measured, &self.watchdog_limit()).await;
    }

    fn watchdog_limit(&self) -> Text {
        let (least, most) = self.facts.watchdog_us;
        Text::of("its reset after ").number(least).text(" to ").number(most).text(" us")
    }
}

/// Whether it was quick enough and without an error; an error is said first.
fn judged(took_us: u32, most_us: u32, errors: u32, of_what: &str) -> (Verdict, Text) {
    let measured = Text::of("").number(took_us).text(" us");
    match errors {
        0 => (Verdict::of(took_us <= most_us), measured),
        _ => (Verdict::Fail, measured.text(", ").number(errors).text(of_what)),
    }
}

/// Microseconds since `begin` (ns).
fn since(begin: u64) -> u32 {
    u32::try_from(BoardClock.now().saturating_sub(begin) / 1000).unwrap_or(u32::MAX)
}

/// Id and checksum of the stored configuration.
async fn stored(storage: &mut impl Storage, room: &mut Option<NodeConfig>) -> Option<(u8, u32)> {
    storage.load(room).await;
    room.as_ref().map(|config| (config.id, config.checksum()))
}

const fn name(cause: ResetCause) -> &'static str {
    match cause {
        ResetCause::Unknown => "an unknown cause",
        ResetCause::PowerOn => "power-on",
        ResetCause::BrownOut => "brown-out",
        ResetCause::Pin => "its pin",
        ResetCause::Watchdog => "the watchdog",
        ResetCause::Software => "software",
        ResetCause::Panic => "a panic",
        ResetCause::HardFault => "a hard fault",
    }
}
