//! The node on a Nucleo-G474RE: FDCAN 1 on PA11/PA12, LPUART 1 on the virtual COM port, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_stm32::can::{CanConfigurator, IT0InterruptHandler, IT1InterruptHandler};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, peripherals};
use firmware::board::{OnCan, host_buffers};
use firmware::stm32::fdcan::TakeFrames;
use firmware::stm32::line::{CountErrors, ERRORS, opened, service_plane};
use firmware::stm32::{g4, safety};

bind_interrupts!(struct Interrupts {
    FDCAN1_IT0 => IT0InterruptHandler<peripherals::FDCAN1>, TakeFrames;
    FDCAN1_IT1 => IT1InterruptHandler<peripherals::FDCAN1>;
    LPUART1 => CountErrors, usart::BufferedInterruptHandler<peripherals::LPUART1>;
});

fn start() -> g4::Node {
    safety::watch_the_start();
    let board = embassy_stm32::init(g4::clocks());
    let chip = safety::begin(board.IWDG);
    let (transmit, receive) = host_buffers();
    let config = service_plane();
    let uart = BufferedUart::new(board.LPUART1, board.PA3, board.PA2, transmit, receive, Interrupts, config);
    // Not PB8, which the Nucleo's Arduino header calls D15: it is also BOOT0, and a transceiver drives it high.
    let can = g4::can(CanConfigurator::new(board.FDCAN1, board.PA11, board.PA12, Interrupts));
    let lines = OnCan { can, service: opened(uart), errors: &ERRORS };
    g4::Node { lines, storage: g4::storage(board.FLASH), chip }
}

firmware::node!(start, g4::Node);
