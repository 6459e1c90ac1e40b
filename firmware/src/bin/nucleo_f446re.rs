//! The node on a Nucleo-F446RE: CAN 1 on PA11/PA12, USART 2 on the virtual COM port, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_stm32::can::{
    Can, Rx0InterruptHandler, Rx1InterruptHandler, SceInterruptHandler, TxInterruptHandler,
};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, peripherals};
use firmware::board::{OnCan, host_buffers};
use firmware::stm32::bxcan::{self, TakeFrames};
use firmware::stm32::line::{self, ERRORS, opened, service_plane};
use firmware::stm32::{f4, safety};

bind_interrupts!(struct Interrupts {
    CAN1_TX => TxInterruptHandler<peripherals::CAN1>;
    CAN1_RX0 => Rx0InterruptHandler<peripherals::CAN1>, TakeFrames;
    CAN1_RX1 => Rx1InterruptHandler<peripherals::CAN1>;
    CAN1_SCE => bxcan::CountErrors, SceInterruptHandler<peripherals::CAN1>;
    USART2 => line::CountErrors, usart::BufferedInterruptHandler<peripherals::USART2>;
});

fn start() -> f4::Node {
    safety::watch_the_start();
    let board = f4::begin();
    let chip = safety::begin(board.IWDG);
    let (transmit, receive) = host_buffers();
    let config = service_plane();
    let uart = BufferedUart::new(board.USART2, board.PA3, board.PA2, transmit, receive, Interrupts, config);
    let service = opened(uart);
    let can = f4::can(Can::new(board.CAN1, board.PA11, board.PA12, Interrupts));
    f4::Node { lines: OnCan { can, service, errors: &ERRORS }, storage: f4::storage(board.FLASH), chip }
}

firmware::node!(start, f4::Node);
