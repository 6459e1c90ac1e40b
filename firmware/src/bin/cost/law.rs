//! The law and its parts: the implicit law of the core beside the explicit formula in C and in Rust.

use core::hint::black_box;

use funnelnet_law::field::midpoint_step;
use funnelnet_law::funnel::SampledFunnel;
use funnelnet_law::gain::{Algebraic, GainFunction, LocallyLinear, Logarithmic, Reciprocal, Solution};
use funnelnet_law::law::node_wise::{Memory, NodeWise, THETA};
use funnelnet_law::{AffineSines, Real, VectorField};
use funnelnet_protocol::config::{Field, Funnel, Shape, Sine};

use crate::meter::{INPUTS, Table, spread};

/// Tick period, s.
pub const TICK: f64 = 1e-3;
/// `2 + 38 e^-t`.
pub const FUNNEL: Funnel<f32> =
    Funnel { factor: 1.0, shape: Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 } };

/// Tick number, its time in s, and a diffusive term: ratios from -0.95 to 0.95 along the first five seconds.
type Input = (u32, f32, f32);

fn inputs() -> [Input; INPUTS] {
    let funnel = SampledFunnel::<f32>::new(&FUNNEL, TICK, THETA);
    let ratios = spread(-0.95, 0.95);
    core::array::from_fn(|i| {
        let k = i as u32 * 5000 / INPUTS as u32;
        // Neighbouring times with ratios that are far apart.
        (k, k as f32 * TICK as f32, ratios[i * 27 % INPUTS] * funnel.widths(k).now)
    })
}

/// The law alone, as `Node` calls it.
struct Law<G> {
    funnel: SampledFunnel<f32>,
    law: NodeWise<f32, G>,
    memory: Memory<f32>,
}

impl<G: GainFunction<f32>> Law<G> {
    fn new(gain: G) -> Self {
        let (funnel, law) = (SampledFunnel::new(&FUNNEL, TICK, THETA), NodeWise::new(gain, TICK, 4.0));
        black_box(Self { funnel, law, memory: Memory::default() })
    }

    #[inline(never)]
    fn tick(&mut self, k: u32, nu: f32) -> (f32, Solution<f32>) {
        let psi = self.funnel.widths(k);
        (nu.abs() / psi.now, self.law.step(&mut self.memory, nu, 0.01 * nu, psi))
    }
}

/// Parameters and state of the law in C, see cost/law.c.
#[repr(C)]
#[derive(Clone, Copy)]
struct Explicit {
    start: f32,
    end: f32,
    rate: f32,
    kappa: f32,
    slope: f32,
    offset: f32,
    period: f32,
    x: f32,
}

const EXPLICIT: Explicit =
    Explicit { start: 40.0, end: 2.0, rate: 1.0, kappa: 1.0, slope: -1.0, offset: 0.5, period: 1e-3, x: 0.0 };

// SAFETY: defined in cost/law.c with these types; they keep no state of their own and `law_in_c` only writes
// `x`.
unsafe extern "C" {
    safe fn law_in_c(law: &mut Explicit, t: f32, nu: f32) -> f32;
    safe fn expf_in_c(x: f32) -> f32;
}

/// The same formula in Rust, with libm's `expf`.
#[inline(never)]
fn law_in_rust(law: &mut Explicit, t: f32, nu: f32) -> f32 {
    let psi = (law.start - law.end) * libm::expf(-law.rate * t) + law.end;
    let s = (nu / psi).clamp(-0.999, 0.999);
    let u = law.kappa * s / (1.0 - s.abs());
    law.x += law.period * (law.slope * law.x + law.offset + u);
    u
}

/// The law: what the issue limits, and what it is compared with.
pub fn laws(table: &Table) {
    let inputs = inputs();
    let mut law = Law::new(Reciprocal { scale: 1.0 });
    let what = "funnel, ratio, (*) with the reciprocal gain in closed form";
    table.limited("law alone", 250, what, &inputs, |(k, _, nu)| law.tick(k, nu));
    let mut law = Law::new(Logarithmic { scale: 1.0 });
    let what = "the same with the logarithmic gain, by Newton";
    table.limited("law alone, logarithmic", 900, what, &inputs, |(k, _, nu)| law.tick(k, nu));
    let mut law = Law::new(LocallyLinear { bound: 1.0 });
    let what = "the same with the locally linear gain";
    table.limited("law alone, locally linear", 500, what, &inputs, |(k, _, nu)| law.tick(k, nu));
    let mut law = Law::new(Algebraic { scale: 1.0 });
    let what = "the same with the algebraic gain, by Newton";
    table.limited("law alone, algebraic", 1200, what, &inputs, |(k, _, nu)| law.tick(k, nu));
    explicit_laws(table, &inputs);
}

fn explicit_laws(table: &Table, inputs: &[Input; INPUTS]) {
    let mut law = EXPLICIT;
    let what = "gcc -O3, newlib: funnel, clamped ratio, `mu`, Euler step; unstable in narrow funnels";
    table.row("explicit law in C", what, inputs, |(_, t, nu)| law_in_c(&mut law, t, nu));
    let in_c = law.x;
    let mut law = EXPLICIT;
    table.row("explicit law in Rust", "the same", inputs, |(_, t, nu)| law_in_rust(&mut law, t, nu));
    assert!((law.x - in_c).abs() < 1e-4, "the law gives {} in Rust and {} in C", law.x, in_c);
}

/// `f = -x + 1` and three sines, as an agent of the paper's Example 3 has.
pub fn field(sines: usize) -> Field<f32> {
    let sine =
        |i: usize| Sine { component: 0, amplitude: 10.0, frequency: 1.0 + i as f64, phase: 0.3 * i as f64 };
    Field::scalar(-1.0, 1.0, (0..sines).map(sine))
}

/// The node's own dynamics, and the functions that they and the law stand on.
pub fn parts(table: &Table) {
    let ticks = core::array::from_fn(|i| i as u32 * 97);
    for (name, sines) in [("field step, affine", 0), ("field step, affine and 3 sines", 3)] {
        let own = black_box(AffineSines::<f32>::new(&field(sines), TICK));
        let (mut x, mut carry) = (0.5, 0.0);
        let what = "midpoint step: two evaluations, compensated sum";
        table.row(name, what, &ticks, |k| step(&own, k, &mut x, &mut carry));
    }
    functions(table);
}

#[inline(never)]
fn step(own: &impl VectorField<f32>, k: u32, x: &mut f32, carry: &mut f32) {
    midpoint_step(own, TICK as f32, u64::from(k), x, carry, 0.25);
}

fn functions(table: &Table) {
    let (positive, negative) = (spread(0.001, 40.0), spread(-20.0, 0.0));
    let turns = core::array::from_fn(|i| i as u64 * 0x0412_3456_789A_BCDE);
    table.row("sine", "our own, f32, of a phase in turns", &turns, f32::sin_turns);
    table.row("`libm::sinf`", "-6 to 6; in software f64", &spread(-6.0, 6.0), libm::sinf);
    table.row("`libm::sinf`, large", "100 to 10,000", &spread(100.0, 10_000.0), libm::sinf);
    table.row("`libm::sqrtf`", "0 to 40", &positive, libm::sqrtf);
    table.row("`vsqrt`", "the M4F's own, and two moves; needs `unsafe`", &positive, vsqrt);
    table.row("`libm::expf`", "-20 to 0", &negative, libm::expf);
    table.row("newlib `expf`", "-20 to 0", &negative, |x| expf_in_c(x));
    table.row("`libm::expm1f`", "-20 to 0", &negative, libm::expm1f);
    table.row("f64 multiplication", "software", &positive.map(f64::from), |x| x * x);
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
