//! What an ELF file of 32 bits for ARM puts into flash.

/// Bytes, and the address that they are flashed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Segment<'a> {
    pub address: u32,
    pub bytes: &'a [u8],
}

/// Class of 32 bits, little endian, in the identification.
const CLASS_AND_ORDER: [u8; 2] = [1, 1];
/// Number of the machine.
const ARM: u16 = 40;
/// Type of a segment that is loaded.
const LOAD: u32 = 1;
/// Bytes of the header of the file and of a segment.
const HEADER: usize = 52;
const SEGMENT_HEADER: usize = 32;

/// The segments that are flashed; `None` where the file is no ELF file at all.
///
/// # Errors
/// It is one of another machine, or cut off.
pub(super) fn segments(file: &[u8]) -> Result<Option<Vec<Segment<'_>>>, String> {
    if !file.starts_with(b"\x7fELF") {
        return Ok(None);
    }
    let cut_off = || "is an ELF file that is cut off".to_owned();
    if file.len() < HEADER {
        return Err(cut_off());
    }
    if file.get(4..6) != Some(&CLASS_AND_ORDER[..]) || half(file, 18) != Some(ARM) {
        return Err("is an ELF file, but not for an ARM of 32 bits".to_owned());
    }
    let (start, size, count) = (word(file, 28), half(file, 42), half(file, 44));
    let (Some(start), Some(size), Some(count)) = (start, size, count) else { return Err(cut_off()) };
    if usize::from(size) < SEGMENT_HEADER || count == 0 {
        return Err("is an ELF file without segments: it is not linked".to_owned());
    }
    let mut found = Vec::new();
    for n in 0..usize::from(count) {
        let header = start as usize + n * usize::from(size);
        let fields = [0, 4, 12, 16].map(|offset| word(file, header + offset));
        let [Some(kind), Some(offset), Some(address), Some(length)] = fields else { return Err(cut_off()) };
        if kind == LOAD && length > 0 {
            let end = (offset as usize).saturating_add(length as usize);
            let bytes = file.get(offset as usize..end).ok_or_else(cut_off)?;
            found.push(Segment { address, bytes });
        }
    }
    Ok(Some(found))
}

fn word(file: &[u8], at: usize) -> Option<u32> {
    file.get(at..at.checked_add(4)?)?.try_into().ok().map(u32::from_le_bytes)
}

fn half(file: &[u8], at: usize) -> Option<u16> {
    file.get(at..at.checked_add(2)?)?.try_into().ok().map(u16::from_le_bytes)
}
