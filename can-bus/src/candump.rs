//! Lines as `candump -L` writes them.

use crate::record::{ERROR, EXTENDED, REMOTE, Record};
use std::fmt;

const NS_PER_S: u64 = 1_000_000_000;
const NS_PER_US: u64 = 1000;

/// A record as a line of a log, without its end. Times are cut to microseconds.
#[derive(Clone, Copy, Debug)]
pub struct Line<'a> {
    /// Name of the interface, such as `can0`.
    pub interface: &'a str,
    /// What happened there.
    pub record: &'a Record,
}

impl fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Record { at, id, fd, length, .. } = *self.record;
        write!(f, "({:010}.{:06}) {} ", at / NS_PER_S, at % NS_PER_S / NS_PER_US, self.interface)?;
        let plain = id & !(EXTENDED | REMOTE);
        // An error has its flag in the identifier, and eight digits.
        if id & (EXTENDED | ERROR) == 0 {
            write!(f, "{plain:03X}#")?
        } else {
            write!(f, "{plain:08X}#")?
        }
        match fd {
            Some(flags) => write!(f, "#{flags:X}")?,
            None if id & REMOTE == 0 => {}
            None if length == 0 => write!(f, "R")?,
            None => write!(f, "R{length}")?,
        }
        self.record.bytes().iter().try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counters::{Counters, Mode};
    use crate::event::{Event, What};
    use crate::frame::{Frame, Id};
    use crate::reader::ErrorKind;
    use crate::wire::Field;

    const AT: u64 = 1_700_000_000_000_123_999;

    fn line(record: &Record) -> String {
        Line { interface: "can0", record }.to_string()
    }

    fn of_frame(frame: Frame, passive: bool) -> String {
        line(&Record::of_frame(AT, &frame, passive))
    }

    fn of_event(what: What) -> String {
        line(&Record::of_event(&Event { at: AT, node: 0, what }).unwrap())
    }

    #[test]
    fn frames_of_every_kind() {
        let time = "(1700000000.000123) can0 ";
        for (frame, passive, text) in [
            (Frame::data(Id::Base(0x185), &[0, 0, 0xC0, 0x3F, 0xE8]), false, "185#0000C03FE8"),
            (Frame::data(Id::Base(5), &[]), true, "005#"),
            (Frame::data(Id::Extended(0x185), &[1]), false, "00000185#01"),
            (Frame::remote(Id::Base(0x7FF), 0), false, "7FF#R"),
            (Frame::remote(Id::Extended(0x1FFF_FFFF), 8), false, "1FFFFFFF#R8"),
            (Frame::fd(Id::Base(0x585), &[1, 2], true), false, "585##50102"),
            (Frame::fd(Id::Extended(1), &[], false), true, "00000001##6"),
        ] {
            assert_eq!(of_frame(frame.unwrap(), passive), format!("{time}{text}"));
        }
    }

    #[test]
    fn a_time_near_zero_has_ten_digits_as_candump_writes_them() {
        let record = Record::of_frame(1_500_000, &Frame::data(Id::Base(1), &[]).unwrap(), false);
        assert_eq!(line(&record), "(0000000000.001500) can0 001#");
    }

    /// Classes and bytes of linux/can/error.h.
    #[test]
    fn errors_and_modes() {
        let counters = Counters { transmit: 256, receive: 17 };
        let error = |kind, field, sender| of_event(What::Error { kind, field, sender, counters });
        let end = |text: String| text.split(' ').next_back().unwrap().to_owned();
        assert_eq!(
            end(error(ErrorKind::Acknowledgement, Field::Acknowledgement, true)),
            "200002A0#000000190000FF11"
        );
        assert_eq!(end(error(ErrorKind::Bit, Field::Data, true)), "20000288#0000810A0000FF11");
        assert_eq!(end(error(ErrorKind::Stuff, Field::Data, false)), "20000288#0000040A0000FF11");
        assert_eq!(
            end(error(ErrorKind::Checksum, Field::AcknowledgementDelimiter, false)),
            "20000288#000000080000FF11"
        );
        let mode =
            |mode, transmit| end(of_event(What::Mode { mode, counters: Counters { transmit, receive: 1 } }));
        assert_eq!(mode(Mode::Off, 256), "20000240#000000000000FF01");
        assert_eq!(mode(Mode::Passive, 128), "20000204#0020000000008001");
        assert_eq!(mode(Mode::Passive, 0), "20000204#0010000000000001");
        assert_eq!(mode(Mode::Active, 0), "20000204#0040000000000001");
    }
}
