//! A line to the host over USB: a CDC-ACM device, which every computer shows as a serial port without a driver of its own.
//!
//! The node reads and writes queues; [`Device::run`], a task of its own, moves packets between them and the endpoints. So a host that does not read, a cable that
//! is pulled, or enumeration never holds up a node: a frame for which the queue has no room is dropped as a whole and counted. A host that sends faster than the node takes
//! has to wait, which USB has a handshake for; nothing is lost in this direction.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_usb::class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State};
use embassy_usb::driver::{Driver, EndpointError};
use embassy_usb::{Builder, Config, UsbDevice};
use embedded_io_async::{ErrorType, Read, Write};
use funnelnet_app::link::serial::Serial;
use static_cell::StaticCell;

use crate::board::Lines;

/// Vendor pid.codes, product "test": nobody has asked for a number of this project's own. It is for trying and not for devices that are handed on. The host
/// does not look at it: it asks every serial port who is there.
const VENDOR_AND_PRODUCT: (u16, u16) = (0x1209, 0x0001);
/// What a Pico draws at most without anything at its pins is less.
const MAX_POWER_MA: u16 = 100;

/// Bytes of a packet at full speed.
const PACKET: usize = 64;
/// Bytes that wait for the host: some 40 ticks of a node with one component and telemetry.
const FOR_HOST: usize = 1024;
/// Bytes that wait for the node. The host is told to wait where there are more.
const FOR_NODE: usize = 512;

type Queue<const N: usize> = Pipe<CriticalSectionRawMutex, N>;

static TO_HOST: Queue<FOR_HOST> = Pipe::new();
static TO_NODE: Queue<FOR_NODE> = Pipe::new();
/// Frames that never went to the host, saturating.
static UNSAID: AtomicU32 = AtomicU32::new(0);

/// The line, to the node.
pub struct HostLine;

impl ErrorType for HostLine {
    type Error = Infallible;
}

impl Read for HostLine {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        Ok(TO_NODE.read(bytes).await)
    }
}

impl Write for HostLine {
    /// Takes a frame as a whole, or drops and counts it. It never waits.
    async fn write(&mut self, frame: &[u8]) -> Result<usize, Infallible> {
        if TO_HOST.free_capacity() < frame.len() {
            note_unsaid(1);
        } else {
            put(frame);
        }
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Puts bytes for which there is room behind those that wait.
fn put(mut bytes: &[u8]) {
    // In two parts where they go over the end of the ring.
    while let Ok(count @ 1..) = TO_HOST.try_write(bytes) {
        bytes = bytes.get(count..).unwrap_or(&[]);
        if bytes.is_empty() {
            return;
        }
    }
}

fn note_unsaid(frames: u32) {
    let before = UNSAID.load(Ordering::Relaxed);
    UNSAID.store(before.saturating_add(frames), Ordering::Relaxed);
}

/// The USB line of a board, for both planes.
pub struct OnUsb;

impl Lines for OnUsb {
    type Link = Serial<HostLine>;

    fn link(self, place: &'static StaticCell<Self::Link>) -> &'static mut Self::Link {
        place.init_with(|| Serial::new(HostLine).with_unsaid(&UNSAID))
    }
}

/// The device on the bus.
pub struct Device<D: Driver<'static>> {
    usb: UsbDevice<'static, D>,
    class: CdcAcmClass<'static, D>,
}

impl<D: Driver<'static>> Device<D> {
    /// A device whose serial number is `uid`, written as the bench file and `bench --list` write it.
    ///
    /// # Panics
    /// It is made twice.
    pub fn new(driver: D, uid: u64) -> Self {
        static MEMORY: StaticCell<Memory> = StaticCell::new();
        // May panic: at the start, where it is asked for twice.
        let Memory { serial, configuration, bos, control, state } = MEMORY.init_with(Memory::new);
        // May panic: at the start, where a descriptor is longer than its memory.
        let mut builder = Builder::new(driver, config(uid, serial), configuration, bos, &mut [], control);
        // May panic: the same.
        let class = CdcAcmClass::new(&mut builder, state, PACKET as u16);
        // May panic: the same.
        Self { usb: builder.build(), class }
    }

    /// Serves the host, for ever.
    pub async fn run(self) -> ! {
        let Self { mut usb, class } = self;
        let (sender, receiver, control) = class.split_with_control();
        join(usb.run(), join(receive(receiver), send(sender, control))).await.0
    }
}

/// What the device keeps, as long as there is power.
struct Memory {
    serial: [u8; 16],
    configuration: [u8; 128],
    bos: [u8; 16],
    control: [u8; PACKET],
    state: State<'static>,
}

impl Memory {
    const fn new() -> Self {
        Self {
            serial: [0; 16],
            configuration: [0; 128],
            bos: [0; 16],
            control: [0; PACKET],
            state: State::new(),
        }
    }
}

fn config(uid: u64, serial: &'static mut [u8; 16]) -> Config<'static> {
    let (vendor, product) = VENDOR_AND_PRODUCT;
    let mut config = Config::new(vendor, product);
    config.manufacturer = Some("Funnelnet");
    config.product = Some("Funnelnet node");
    config.serial_number = Some(hexadecimal(uid, serial));
    config.max_power = MAX_POWER_MA;
    config
}

/// Sixteen digits, as `{:016x}` gives them, without what formatting takes of flash.
fn hexadecimal(number: u64, digits: &mut [u8; 16]) -> &str {
    for (place, digit) in digits.iter_mut().rev().enumerate() {
        let value = (number >> (4 * place)) as u8 & 0xF;
        *digit = value + if value < 10 { b'0' } else { b'a' - 10 };
    }
    core::str::from_utf8(digits).unwrap_or_default()
}

/// Packets of the host, to the node. None is asked for while the last one waits.
async fn receive<D: Driver<'static>>(mut receiver: Receiver<'static, D>) -> ! {
    let mut packet = [0; PACKET];
    loop {
        receiver.wait_connection().await;
        while let Ok(count) = receiver.read_packet(&mut packet).await {
            TO_NODE.write_all(packet.get(..count).unwrap_or(&[])).await;
        }
    }
}

/// What waits, to the host, as long as it is connected.
async fn send<D: Driver<'static>>(mut sender: Sender<'static, D>, control: ControlChanged<'static>) -> ! {
    let mut packet = Packet::new();
    loop {
        sender.wait_connection().await;
        match select(pass(&mut sender, &mut packet), opened(&control)).await {
            // The endpoint is off: unplugged, or set up anew.
            Either::First(_) => {}
            Either::Second(()) => forget(&mut packet),
        }
    }
}

/// Bytes that the endpoint has not taken yet.
struct Packet {
    bytes: [u8; PACKET],
    count: usize,
    /// The byte before them was part of a frame.
    in_frame: bool,
}

impl Packet {
    const fn new() -> Self {
        Self { bytes: [0; PACKET], count: 0, in_frame: false }
    }

    fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.count).unwrap_or(&[])
    }

    /// Waits for bytes for the host; takes those that there are now, up to a packet.
    async fn fill(&mut self) {
        self.count = TO_HOST.read(&mut self.bytes).await;
        // The rest of them, where they go over the end of the ring.
        let rest = self.bytes.get_mut(self.count..).filter(|rest| !rest.is_empty());
        self.count += rest.and_then(|rest| TO_HOST.try_read(rest).ok()).unwrap_or(0);
    }

    /// Takes what there is; whether there was anything.
    fn refill(&mut self) -> bool {
        self.count = TO_HOST.try_read(&mut self.bytes).unwrap_or(0);
        self.count > 0
    }

    /// Frames that end in it. A zero behind another one ends none.
    fn ends(&self) -> u32 {
        let mut in_frame = self.in_frame;
        let mut ends = 0;
        for &byte in self.bytes() {
            ends += u32::from(in_frame && byte == 0);
            in_frame = byte != 0;
        }
        ends
    }

    /// Its bytes are gone.
    fn clear(&mut self) {
        self.in_frame = self.bytes().last().map_or(self.in_frame, |&last| last != 0);
        self.count = 0;
    }
}

/// Sends packets as full as what waits allows, until one cannot be sent.
async fn pass<D: Driver<'static>>(
    sender: &mut Sender<'static, D>,
    packet: &mut Packet,
) -> Result<Infallible, EndpointError> {
    loop {
        if packet.count == 0 {
            packet.fill().await;
        }
        sender.write_packet(packet.bytes()).await?;
        let full = packet.count == PACKET;
        packet.clear();
        // A host takes a full packet for the first part of more, and keeps it from its program.
        if full && TO_HOST.is_empty() {
            sender.write_packet(&[]).await?;
        }
    }
}

/// Waits until a program opens the port (DTR goes up).
async fn opened(control: &ControlChanged<'static>) {
    while control.dtr() {
        control.control_changed().await;
    }
    while !control.dtr() {
        control.control_changed().await;
    }
}

/// Drops what was said before anybody listened, and counts it. The zero ends a frame that was cut off.
fn forget(packet: &mut Packet) {
    note_unsaid(packet.ends());
    packet.clear();
    while packet.refill() {
        note_unsaid(packet.ends());
        packet.clear();
    }
    put(&[0]);
}
