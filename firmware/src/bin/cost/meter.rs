//! Counts instructions and prints them as rows of a Markdown table.

use core::cell::Cell;
use core::hint::black_box;

use firmware::mps2::{CLOCK_HZ, time};
use semihosting::{eprintln, println, process};

/// Instructions (ns of virtual time) per count of the clock.
const PER_COUNT: u32 = 1_000_000_000 / CLOCK_HZ;
/// Calls in a row with each input: the clock's coarseness is divided by them.
pub const ROUNDS: u32 = 64;
/// Inputs per list.
pub const INPUTS: usize = 64;

/// `INPUTS` values spread evenly over a range, its start included.
pub fn spread(from: f32, to: f32) -> [f32; INPUTS] {
    core::array::from_fn(|i| from + (to - from) * i as f32 / INPUTS as f32)
}

/// Instructions of `ROUNDS` calls with each input, loop and all.
type Counts = [u32; INPUTS];

/// Calls `f` with each input, `ROUNDS` times in a row.
#[inline(never)]
fn count<I: Copy, R>(inputs: &[I; INPUTS], mut f: impl FnMut(I) -> R) -> Counts {
    let mut last = time::counts();
    core::array::from_fn(|i| {
        for _ in 0..ROUNDS {
            black_box(f(black_box(inputs[i])));
        }
        let begin = core::mem::replace(&mut last, time::counts());
        last.wrapping_sub(begin) * PER_COUNT
    })
}

/// Are these instructions? A hundred of them must be a hundred.
pub fn calibrate() {
    let empty = count(&[0; INPUTS], |input: u32| input);
    let nops = count(&[0; INPUTS], |input: u32| {
        // SAFETY: a hundred instructions that do nothing.
        unsafe { core::arch::asm!(".rept 100", "nop", ".endr", options(nomem, nostack, preserves_flags)) };
        input
    });
    let counted = (nops.iter().sum::<u32>() - empty.iter().sum::<u32>()) / (ROUNDS * INPUTS as u32);
    if !(99..=101).contains(&counted) {
        eprintln!("100 instructions took {} ns: run QEMU with -icount shift=0", counted);
        process::exit(1);
    }
}

/// The table that is printed.
#[derive(Default)]
pub struct Table {
    /// Rows over their limit.
    exceeded: Cell<u32>,
}

impl Table {
    /// Prints its head.
    pub fn begin() -> Self {
        println!("| on the Cortex-M4F | instructions | most | limit | what is counted |");
        println!("|---|---:|---:|---:|---|");
        Self::default()
    }

    /// A row: the instructions of `f`, on average over the inputs and with the costliest one, without the
    /// loop.
    pub fn row<I: Copy, R>(&self, name: &str, what: &str, inputs: &[I; INPUTS], f: impl FnMut(I) -> R) {
        self.print(name, None, what, &count(inputs, f), &count(inputs, |input| input));
    }

    /// A row whose average must not be above `limit`.
    pub fn limited<I: Copy, R>(
        &self,
        name: &str,
        limit: u32,
        what: &str,
        inputs: &[I; INPUTS],
        f: impl FnMut(I) -> R,
    ) {
        self.print(name, Some(limit), what, &count(inputs, f), &count(inputs, |input| input));
    }

    /// A row for something with a state, which `prepare` makes ready for each call of `f`; only `f` is
    /// counted. Gives the state in the end, so that the caller can see that it did what it was to do.
    pub fn stateful<S>(
        &self,
        name: &str,
        limit: Option<u32>,
        what: &str,
        new: impl Fn() -> S,
        [prepare, f]: [fn(&mut S); 2],
    ) -> S {
        let (mut alone, mut whole) = (new(), new());
        let without = count(&[(); INPUTS], |()| prepare(black_box(&mut alone)));
        let with = count(&[(); INPUTS], |()| {
            prepare(black_box(&mut whole));
            f(black_box(&mut whole));
        });
        self.print(name, limit, what, &with, &without);
        whole
    }

    /// How many rows were over their limit.
    pub fn exceeded(&self) -> u32 {
        self.exceeded.get()
    }

    fn print(&self, name: &str, limit: Option<u32>, what: &str, with: &Counts, without: &Counts) {
        let net = core::array::from_fn::<_, INPUTS, _>(|i| with[i].saturating_sub(without[i]));
        let calls = ROUNDS * INPUTS as u32;
        let mean_tenths = (net.iter().sum::<u32>() * 10 + calls / 2) / calls;
        let most = net.iter().max().map_or(0, |most| (most + ROUNDS / 2) / ROUNDS);
        let (whole, tenths) = (mean_tenths / 10, mean_tenths % 10);
        match limit {
            Some(limit) if mean_tenths > limit * 10 => {
                self.exceeded.set(self.exceeded.get() + 1);
                println!(
                    "| {} | **{}.{}** | {} | {} EXCEEDED | {} |",
                    name, whole, tenths, most, limit, what
                );
            }
            Some(limit) => println!("| {} | {}.{} | {} | {} | {} |", name, whole, tenths, most, limit, what),
            None => println!("| {} | {}.{} | {} | | {} |", name, whole, tenths, most, what),
        }
    }
}
