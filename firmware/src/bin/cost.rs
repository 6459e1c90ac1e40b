//! What things cost on the Cortex-M4F: instructions per call, counted by the emulator. Run by `./ci.sh cost`.
//!
//! Under `-icount shift=0` every instruction takes 1 ns of virtual time, so a timer counts instructions: the
//! same number on every host. They are not cycles: a division or square root is one instruction and 14
//! cycles. Prints lines of name, instructions, and what it is.
#![no_std]
#![no_main]
#![allow(unsafe_code)]

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use defmt_semihosting as _;
use firmware::mps2::{CLOCK_HZ, time};
use semihosting::{eprintln, println, process};

/// Instructions (ns of virtual time) per count of the clock.
const PER_COUNT: u32 = 1_000_000_000 / CLOCK_HZ;
/// Times that each list of inputs is gone through. The clock's coarseness is divided by this and by the
/// inputs.
const ROUNDS: u32 = 64;
/// Inputs per list.
const INPUTS: usize = 64;

/// `INPUTS` values spread evenly over a range, its start included.
fn spread(from: f32, to: f32) -> [f32; INPUTS] {
    core::array::from_fn(|i| from + (to - from) * i as f32 / INPUTS as f32)
}

/// Instructions that it takes to call `f` with each input, `ROUNDS` times, loop and all.
#[inline(never)]
fn total<I: Copy, R>(inputs: &[I; INPUTS], mut f: impl FnMut(I) -> R) -> u32 {
    let start = time::counts();
    for _ in 0..ROUNDS {
        for &input in inputs {
            black_box(f(black_box(input)));
        }
    }
    time::counts().wrapping_sub(start) * PER_COUNT
}

/// Prints a row: the instructions of `f` on average over the inputs, without the loop around it.
fn row<I: Copy, R>(name: &str, what: &str, inputs: &[I; INPUTS], f: impl FnMut(I) -> R) {
    let calls = ROUNDS * INPUTS as u32;
    let net = total(inputs, f).saturating_sub(total(inputs, |input| input));
    let tenths = (net * 10 + calls / 2) / calls;
    println!("{:<20} {:>5}.{}  {}", name, tenths / 10, tenths % 10, what);
}

/// Are these instructions? A hundred of them must be a hundred.
fn calibrate() {
    let calls = ROUNDS * INPUTS as u32;
    let empty = total(&[0u32; INPUTS], |input| input);
    let nops = total(&[0u32; INPUTS], |input| {
        // SAFETY: a hundred instructions that do nothing.
        unsafe { core::arch::asm!(".rept 100", "nop", ".endr", options(nomem, nostack, preserves_flags)) };
        input
    });
    let counted = nops.wrapping_sub(empty) / calls;
    if !(99..=101).contains(&counted) {
        eprintln!("100 instructions took {} ns: run QEMU with -icount shift=0", counted);
        process::exit(1);
    }
}

/// Parameters and state of the law in C, see cost/law.c.
#[repr(C)]
#[derive(Clone, Copy)]
struct Law {
    start: f32,
    end: f32,
    rate: f32,
    kappa: f32,
    slope: f32,
    offset: f32,
    period: f32,
    x: f32,
}

const LAW: Law =
    Law { start: 40.0, end: 2.0, rate: 1.0, kappa: 1.0, slope: -1.0, offset: 0.5, period: 1e-3, x: 0.0 };

// SAFETY: defined in cost/law.c with these types; they keep no state of their own and `law_in_c` only writes
// `x`.
unsafe extern "C" {
    safe fn law_in_c(law: &mut Law, t: f32, nu: f32) -> f32;
    safe fn expf_in_c(x: f32) -> f32;
}

/// The same formula in Rust, with libm's `expf`.
#[inline(never)]
fn law_in_rust(law: &mut Law, t: f32, nu: f32) -> f32 {
    let psi = (law.start - law.end) * libm::expf(-law.rate * t) + law.end;
    let s = (nu / psi).clamp(-0.999, 0.999);
    let u = law.kappa * s / (1.0 - s.abs());
    law.x += law.period * (law.slope * law.x + law.offset + u);
    u
}

/// The M4F's own square root, with two moves: rustc refuses `sreg` operands, since it takes them to need a
/// double unit.
fn vsqrt(x: f32) -> f32 {
    let mut bits = x.to_bits();
    // SAFETY: register to register; the one that is overwritten is named.
    unsafe {
        core::arch::asm!("vmov s0, {0}", "vsqrt.f32 s0, s0", "vmov {0}, s0", inout(reg) bits, out("s0") _,
            options(pure, nomem, nostack));
    }
    f32::from_bits(bits)
}

fn arithmetic() {
    let positive = spread(0.001, 40.0);
    row("f32_division", "1 / x", &positive, |x| 1.0 / x);
    row(
        "u64_multiplication",
        "wrapping",
        &core::array::from_fn(|i| i as u64 * 0x9E37_79B9_7F4A_7C15),
        |x: u64| x.wrapping_mul(black_box(0xBF58_476D_1CE4_E5B9)),
    );
    row("u64_constant", "black box of one, part of the row above", &[0u64; INPUTS], |_| {
        black_box(0xBF58_476D_1CE4_E5B9u64)
    });
    row("vsqrt", "inline assembly, and two moves", &positive, vsqrt);
    row("f64_multiplication", "software", &positive.map(f64::from), |x| x * x);
}

fn functions() {
    let positive = spread(0.001, 40.0);
    row("libm_sqrtf", "0 to 40", &positive, libm::sqrtf);
    row("libm_expf", "-20 to 0", &spread(-20.0, 0.0), libm::expf);
    row("newlib_expf", "-20 to 0", &spread(-20.0, 0.0), |x| expf_in_c(x));
    row("libm_expm1f", "-20 to 0", &spread(-20.0, 0.0), libm::expm1f);
    row("libm_logf", "0 to 40", &positive, libm::logf);
    row("libm_sinf_small", "-0.7 to 0.7", &spread(-0.7, 0.7), libm::sinf);
    row("libm_sinf", "-6 to 6", &spread(-6.0, 6.0), libm::sinf);
    row("libm_sinf_large", "100 to 10,000", &spread(100.0, 10_000.0), libm::sinf);
}

fn laws() {
    let times = spread(0.0, 5.0);
    let mut law = LAW;
    row("law_explicit_c", "gcc -O3, newlib; nu given", &times, |t| law_in_c(&mut law, t, 1.0));
    let in_c = law.x;
    let mut law = LAW;
    row("law_explicit_rust", "libm; nu given", &times, |t| law_in_rust(&mut law, t, 1.0));
    assert!((law.x - in_c).abs() < 1e-5, "the law gives {} in Rust and {} in C", law.x, in_c);
}

#[entry]
fn main() -> ! {
    time::start();
    calibrate();
    arithmetic();
    functions();
    laws();
    process::exit(0)
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    eprintln!("{}", info);
    process::exit(firmware::panic::PANIC_EXIT_CODE)
}
