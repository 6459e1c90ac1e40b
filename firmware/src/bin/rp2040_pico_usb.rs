//! The node on a Raspberry Pi Pico without an adapter: both planes over its USB connector, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_rp::{bind_interrupts, peripherals, usb};
use firmware::board::Parts;
use firmware::rp::{self, Timer};
use firmware::usb::{Device, OnUsb};

bind_interrupts!(struct Interrupts {
    USBCTRL_IRQ => usb::InterruptHandler<peripherals::USB>;
});

type Node = Parts<OnUsb, rp::Storage, Timer>;
type Usb = Device<usb::Driver<'static, peripherals::USB>>;

#[embassy_executor::task]
async fn serve(usb: Usb) {
    usb.run().await
}

fn start() -> (Node, Usb) {
    let board = embassy_rp::init(Default::default());
    let (chip, storage) = rp::begin(board.FLASH, board.WATCHDOG);
    // May panic: at the start, in embassy-usb, where a descriptor is longer than its memory.
    let usb = Device::new(usb::Driver::new(board.USB, Interrupts), chip.uid);
    (Node { lines: OnUsb, storage, chip }, usb)
}

firmware::node!(start, Node, serve);
