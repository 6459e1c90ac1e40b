//! The report of a board: rows of a Markdown table, made without `core::fmt`, whose code can panic.

use embedded_io_async::Write;

/// Bytes of a cell at most; what is longer is cut off.
const ROOM: usize = 96;
/// Heads of the columns.
const HEAD: &str = "| board | check | verdict | measured | limit |\r\n|---|---|---|---|---|\r\n";

/// What a check says.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Within its limit.
    Pass,
    /// Outside of it.
    Fail,
    /// What it needs is not there; the row says what.
    Skipped,
}

impl Verdict {
    /// `Pass` where it is so.
    pub const fn of(is_good: bool) -> Self {
        if is_good { Self::Pass } else { Self::Fail }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Pass => "PASS",
            Self::Fail => "FAIL",
            Self::Skipped => "SKIPPED",
        }
    }
}

/// Text that is put together piece by piece.
#[derive(Clone)]
pub struct Text {
    bytes: [u8; ROOM],
    length: usize,
}

impl Text {
    /// It begins so.
    pub fn of(text: &str) -> Self {
        Self { bytes: [0; ROOM], length: 0 }.text(text)
    }

    /// Goes on so.
    #[must_use]
    pub fn text(mut self, text: &str) -> Self {
        text.bytes().for_each(|byte| self.push(byte));
        self
    }

    /// A decimal number, in groups of three digits.
    #[must_use]
    pub fn number(mut self, number: u32) -> Self {
        let mut unit = 1_000_000_000;
        let mut left = number;
        let mut has_begun = false;
        for place in (0..10_u32).rev() {
            let digit = left / unit;
            left %= unit;
            has_begun |= digit > 0 || place == 0;
            if has_begun {
                self.push(b'0'.saturating_add(digit as u8));
                if place % 3 == 0 && place > 0 {
                    self.push(b',');
                }
            }
            unit /= 10;
            unit = unit.max(1);
        }
        self
    }

    /// The last `digits` of a hexadecimal number.
    #[must_use]
    pub fn hex(mut self, number: u64, digits: u8) -> Self {
        for nibble in (0..digits).rev() {
            let digit = (number.wrapping_shr(4 * u32::from(nibble)) & 15) as u8;
            self.push(if digit < 10 { b'0' + digit } else { b'a' + digit - 10 });
        }
        self
    }

    fn push(&mut self, byte: u8) {
        if let Some(to) = self.bytes.get_mut(self.length) {
            *to = byte;
            self.length += 1;
        }
    }

    fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or(&[])
    }
}

/// How many rows said what.
#[derive(Clone, Copy, Default)]
pub struct Counts {
    /// Those that passed.
    pub pass: u32,
    /// Those that failed.
    pub fail: u32,
    /// Those that had nothing to check.
    pub skipped: u32,
}

/// The report on a line.
pub struct Report<W> {
    line: W,
    board: &'static str,
    /// Of the rows so far.
    pub counts: Counts,
}

impl<W: Write> Report<W> {
    /// Nothing is said yet.
    pub const fn new(line: W, board: &'static str) -> Self {
        Self { line, board, counts: Counts { pass: 0, fail: 0, skipped: 0 } }
    }

    /// The head of the table.
    pub async fn begin(&mut self) {
        self.say(HEAD.as_bytes()).await;
    }

    /// A row.
    pub async fn row(&mut self, check: &str, verdict: Verdict, measured: &Text, limit: &Text) {
        let count = match verdict {
            Verdict::Pass => &mut self.counts.pass,
            Verdict::Fail => &mut self.counts.fail,
            Verdict::Skipped => &mut self.counts.skipped,
        };
        *count = count.saturating_add(1);
        let cells = [
            self.board.as_bytes(),
            check.as_bytes(),
            verdict.name().as_bytes(),
            measured.bytes(),
            limit.bytes(),
        ];
        for cell in cells {
            self.say(b"| ").await;
            self.say(cell).await;
            self.say(b" ").await;
        }
        self.say(b"|\r\n").await;
        let _ = self.line.flush().await;
    }

    /// The last line.
    pub async fn end(&mut self) {
        let Counts { pass, fail, skipped } = self.counts;
        let counts = Text::of("DONE: ").number(pass).text(" PASS, ").number(fail).text(" FAIL, ");
        self.say(counts.number(skipped).text(" SKIPPED\r\n").bytes()).await;
        let _ = self.line.flush().await;
    }

    /// A line that takes nothing has no reader: the rest is lost.
    async fn say(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let Ok(written) = self.line.write(bytes).await else { return };
            bytes = bytes.get(written.max(1)..).unwrap_or(&[]);
        }
    }
}
