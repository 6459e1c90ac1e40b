//! The program of a node as a file has it, and whether it is one for this memory.

mod elf;

use crate::printable::printable;
use funnelnet_protocol::update::{Checksum, Image, board_number};
use std::fs;
use std::ops::Range;
use std::path::Path;

/// A board whose programs can be swapped, as in `firmware/Cargo.toml`.
#[derive(Debug, PartialEq, Eq)]
pub struct Board {
    /// By which its number is made.
    pub name: &'static str,
    /// For readers.
    pub title: &'static str,
    /// Where the program is that runs.
    pub active: Range<u32>,
    /// Its RAM.
    pub ram: Range<u32>,
}

/// All of them: only this one has a boot loader.
pub static PICO: Board = Board {
    name: "rp2040-pico",
    title: "Raspberry Pi Pico",
    active: 0x1000_8000..0x1004_8000,
    ram: 0x2000_0000..0x2004_2000,
};

/// What the way out is.
const ADVICE: &str = "`./ci.sh update` builds one that can be sent: firmware/target/thumbv6m-none-eabi/release/rp2040_pico_update";
/// Where the first two vectors are: stack pointer, and first instruction.
const VECTORS: u32 = 8;
/// What a byte of flash is that no segment has.
const ERASED: u8 = 0xFF;

/// A program, from its first byte in flash to its last one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    bytes: Vec<u8>,
}

impl Program {
    /// Reads an ELF file, or the bytes as they are in flash.
    ///
    /// # Errors
    /// What is wrong with it, in a sentence that names the file.
    pub fn load(path: &Path) -> Result<Self, String> {
        let name = printable(&path.display().to_string()).into_owned();
        let bytes = fs::read(path).map_err(|error| format!("cannot read {name}: {error}"))?;
        Self::of(&bytes).map_err(|why| format!("{name}: {why}. {ADVICE}"))
    }

    /// The same of a file that is in memory.
    ///
    /// # Errors
    /// What is wrong with it, without the file's name.
    pub fn of(file: &[u8]) -> Result<Self, String> {
        let board = &PICO;
        if file.starts_with(b"UF2\n") {
            return Err("is a UF2 file; give the ELF file that it was made of".to_owned());
        }
        let bytes = match elf::segments(file)? {
            Some(segments) => flat(&segments, board)?,
            None => file.to_vec(),
        };
        let room = length(&board.active);
        if bytes.len() as u64 > u64::from(room) {
            return Err(format!(
                "has {} bytes, and a program of a {} has room for {room}",
                bytes.len(),
                board.title
            ));
        }
        check_vectors(&bytes, board)?;
        Ok(Self { bytes })
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What is announced to a node.
    pub fn image(&self) -> Image {
        // Within the room of the board.
        let length = self.bytes.len() as u32;
        Image { board: board_number(PICO.name), length, crc: Checksum::of(&self.bytes) }
    }
}

/// Segments as one piece of flash.
fn flat(segments: &[elf::Segment<'_>], board: &Board) -> Result<Vec<u8>, String> {
    let Range { start, end } = board.active;
    let mut flat = Vec::new();
    for &elf::Segment { address, bytes } in segments {
        let last = u64::from(address) + bytes.len() as u64;
        if address < start || last > u64::from(end) {
            return Err(format!(
                "has a segment at {address:#010x} to {last:#010x}, and a program of a {} that is swapped is at {start:#010x} to {end:#010x}: \
                 this is the image of another board, a boot loader, or an image without the feature `update`",
                board.title
            ));
        }
        let (from, to) = ((address - start) as usize, (last - u64::from(start)) as usize);
        if flat.len() < to {
            flat.resize(to, ERASED);
        }
        flat[from..to].copy_from_slice(bytes);
    }
    Ok(flat)
}

/// A program begins with its vectors: a stack in RAM, and a first instruction within itself.
fn check_vectors(bytes: &[u8], board: &Board) -> Result<(), String> {
    let word = |at: usize| {
        let word = bytes.get(at..at + 4).and_then(|word| word.try_into().ok());
        word.map(u32::from_le_bytes)
    };
    let (Some(stack), Some(reset)) = (word(0), word(4)) else {
        return Err(format!("has {} bytes, and no program is shorter than {VECTORS}", bytes.len()));
    };
    if stack <= board.ram.start || stack > board.ram.end || !stack.is_multiple_of(4) {
        let ram = &board.ram;
        return Err(format!(
            "is no program of a {}: its first word, {stack:#010x}, is no stack in its RAM, {:#010x} to {:#010x}",
            board.title, ram.start, ram.end
        ));
    }
    let code = board.active.start + VECTORS..board.active.start + bytes.len() as u32;
    if reset % 2 == 0 || !code.contains(&(reset - 1)) {
        return Err(format!(
            "is no program of a {} that is swapped: its first instruction, {reset:#010x}, is not within it, {:#010x} to {:#010x}",
            board.title, board.active.start, code.end
        ));
    }
    Ok(())
}

fn length(range: &Range<u32>) -> u32 {
    range.end - range.start
}

#[cfg(test)]
mod tests;
