//! The node on an nRF52840-DK with both planes over the chip's own USB connector (J3), the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_nrf::usb::vbus_detect::{self, HardwareVbusDetect};
use embassy_nrf::{bind_interrupts, peripherals, usb};
use firmware::board::Parts;
use firmware::nrf::{self, Wdt};
use firmware::usb::{Device, OnUsb};

bind_interrupts!(struct Interrupts {
    USBD => usb::InterruptHandler<peripherals::USBD>;
    CLOCK_POWER => vbus_detect::InterruptHandler;
});

type Node = Parts<OnUsb, nrf::Storage, Wdt>;
type Usb = Device<usb::Driver<'static, HardwareVbusDetect>>;

#[embassy_executor::task]
async fn serve(usb: Usb) {
    usb.run().await
}

fn start() -> (Node, Usb) {
    let board = embassy_nrf::init(nrf::clocks());
    let chip = nrf::begin(board.WDT, board.TIMER2);
    let driver = usb::Driver::new(board.USBD, Interrupts, HardwareVbusDetect::new(Interrupts));
    // May panic: at the start, in embassy-usb, where a descriptor is longer than its memory.
    let usb = Device::new(driver, chip.uid);
    (Node { lines: OnUsb, storage: nrf::storage(board.NVMC), chip }, usb)
}

firmware::node!(start, Node, serve);
