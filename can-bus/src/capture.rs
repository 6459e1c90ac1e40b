//! Captures in pcapng, as Wireshark reads them.

use crate::record::Record;
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketBlock;
use pcap_file::pcapng::blocks::interface_description::{
    InterfaceDescriptionBlock, InterfaceDescriptionOption,
};
use pcap_file::pcapng::{PcapNgBlock as _, PcapNgWriter};
use pcap_file::{DataLink, Endianness, PcapError};
use std::borrow::Cow;
use std::io::{self, Write};
use std::time::Duration;

/// LINKTYPE_CAN_SOCKETCAN.
const CAN: u32 = 227;
/// Times are in units of 10^-9 s. `pcap-file` writes nanoseconds whatever an interface says, and readers take
/// them for microseconds without this.
const NANOSECONDS: u8 = 9;
/// Identifier, length, flags and two reserved bytes.
const HEADER: usize = 8;

/// A capture that is being written.
pub struct Capture<W: Write> {
    writer: PcapNgWriter<W>,
}

impl<W: Write> Capture<W> {
    /// Begins a capture of interfaces of these names.
    ///
    /// # Errors
    ///
    /// The writer's.
    pub fn new(writer: W, interfaces: &[&str]) -> io::Result<Self> {
        // The same bytes on every machine.
        let mut writer = PcapNgWriter::with_endianness(writer, Endianness::Little).map_err(plain)?;
        for &interface in interfaces {
            let options = vec![
                InterfaceDescriptionOption::IfName(Cow::Borrowed(interface)),
                InterfaceDescriptionOption::IfTsResol(NANOSECONDS),
            ];
            let description =
                InterfaceDescriptionBlock { linktype: DataLink::from(CAN), snaplen: 0, options };
            writer.write_block(&description.into_block()).map_err(plain)?;
        }
        Ok(Self { writer })
    }

    /// Adds a frame or an error of an interface, by its index.
    ///
    /// # Errors
    ///
    /// The writer's.
    pub fn write(&mut self, interface: u32, record: &Record) -> io::Result<()> {
        let packet = packet(record);
        let block = EnhancedPacketBlock {
            interface_id: interface,
            timestamp: Duration::from_nanos(record.at),
            original_len: packet.len() as u32,
            data: Cow::Owned(packet),
            options: Vec::new(),
        };
        self.writer.write_block(&block.into_block()).map_err(plain)?;
        Ok(())
    }

    /// The writer.
    pub fn into_inner(self) -> W {
        self.writer.into_inner()
    }
}

fn packet(record: &Record) -> Vec<u8> {
    let mut packet = Vec::with_capacity(HEADER + record.bytes().len());
    packet.extend(record.id.to_be_bytes());
    packet.extend([record.length, record.fd.unwrap_or(0), 0, 0]);
    packet.extend(record.bytes());
    packet
}

fn plain(error: PcapError) -> io::Error {
    match error {
        PcapError::IoError(error) => error,
        other => io::Error::other(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Frame, Id};
    use pcap_file::pcapng::{Block, PcapNgReader};

    #[test]
    fn what_is_written_is_read_with_its_nanoseconds() {
        let mut capture = Capture::new(Vec::new(), &["can0"]).unwrap();
        let frames = [
            Frame::data(Id::Extended(0x1234), &[1, 2, 3]).unwrap(),
            Frame::remote(Id::Base(5), 8).unwrap(),
            Frame::fd(Id::Base(6), &[0xAB; 12], true).unwrap(),
        ];
        for (at, frame) in frames.iter().enumerate() {
            capture.write(0, &Record::of_frame(1_000_000_007 + at as u64, frame, false)).unwrap();
        }
        let bytes = capture.into_inner();
        let mut reader = PcapNgReader::new(bytes.as_slice()).unwrap();
        let Block::InterfaceDescription(interface) = reader.next_block().unwrap().unwrap() else { panic!() };
        assert_eq!(u32::from(interface.linktype), CAN);
        assert!(interface.options.contains(&InterfaceDescriptionOption::IfTsResol(9)));
        let mut packets = Vec::new();
        while let Some(block) = reader.next_block() {
            let Block::EnhancedPacket(packet) = block.unwrap() else { panic!() };
            packets.push((packet.timestamp.as_nanos(), packet.data.to_vec()));
        }
        assert_eq!(packets[0], (1_000_000_007, vec![0x80, 0, 0x12, 0x34, 3, 0, 0, 0, 1, 2, 3]));
        assert_eq!(packets[1], (1_000_000_008, vec![0x40, 0, 0, 5, 8, 0, 0, 0]));
        assert_eq!(packets[2].1[..8], [0, 0, 0, 6, 12, 5, 0, 0]);
        assert_eq!((packets[2].1.len(), packets[2].1[19]), (20, 0xAB));
    }
}
