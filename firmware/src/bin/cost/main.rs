//! What things cost on the Cortex-M4F: instructions per call, counted by the emulator. Run by `./ci.sh cost`.
//!
//! Under `-icount shift=0` every instruction takes 1 ns of virtual time, so a timer counts instructions: the
//! same number on every host. They are not cycles: a division or square root is one instruction and 14
//! cycles. Prints a Markdown table; exits with 1 where a row exceeds its limit.
#![no_std]
#![no_main]
#![allow(unsafe_code)]

mod expression;
mod law;
mod meter;
mod node;

use core::panic::PanicInfo;

use cortex_m_rt::entry;
use defmt_semihosting as _;
use firmware::mps2::time;
use semihosting::{eprintln, process};

#[entry]
fn main() -> ! {
    time::start();
    meter::calibrate();
    let table = meter::Table::begin();
    law::laws(&table);
    node::ticks(&table);
    law::parts(&table);
    expression::evaluations(&table);
    node::frames(&table);
    node::checksum(&table);
    process::exit(i32::from(table.exceeded() > 0))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    eprintln!("{}", info);
    process::exit(firmware::panic::PANIC_EXIT_CODE)
}
