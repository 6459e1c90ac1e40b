use super::*;

const START: u32 = 0x1000_8000;

/// A program of so many bytes, as it is in flash.
fn program(length: usize) -> Vec<u8> {
    let mut bytes: Vec<u8> = (0..length).map(|i| (i * 7 + i / 256) as u8).collect();
    bytes[..4].copy_from_slice(&0x2000_8000_u32.to_le_bytes());
    bytes[4..8].copy_from_slice(&(START + 0x41).to_le_bytes());
    bytes
}

/// An ELF file of these segments.
fn elf(segments: &[(u32, &[u8])]) -> Vec<u8> {
    let mut file = b"\x7fELF\x01\x01\x01".to_vec();
    file.resize(52, 0);
    file[18..20].copy_from_slice(&40_u16.to_le_bytes());
    file[28..32].copy_from_slice(&52_u32.to_le_bytes());
    file[42..44].copy_from_slice(&32_u16.to_le_bytes());
    file[44..46].copy_from_slice(&(segments.len() as u16).to_le_bytes());
    let mut offset = 52 + 32 * segments.len();
    for (address, bytes) in segments {
        let words = [1, offset as u32, 0x2000_0000, *address, bytes.len() as u32, 0, 0, 0];
        words.iter().for_each(|word| file.extend(word.to_le_bytes()));
        offset += bytes.len();
    }
    segments.iter().for_each(|(_, bytes)| file.extend_from_slice(bytes));
    file
}

fn refused(file: &[u8], words: &str) {
    let why = Program::of(file).unwrap_err();
    assert!(why.contains(words), "no '{words}' in: {why}");
}

#[test]
fn an_elf_file_and_its_flat_bytes_are_the_same_program() {
    let whole = program(1_000);
    // As the linker has them: vectors and code, and what is brought to RAM; between them a gap.
    let (code, data) = whole.split_at(600);
    let at = START + 600 + 40;
    let found = Program::of(&elf(&[(at, data), (START, code), (0, &[])])).unwrap();
    let expected = [code, &[0xFF; 40], data].concat();
    assert_eq!(found.bytes(), expected);
    assert_eq!(Program::of(&expected).unwrap(), found);
    let image = found.image();
    assert_eq!((image.length, image.crc), (1_040, Checksum::of(&expected)));
    assert_eq!(image.board, board_number("rp2040-pico"));
}

#[test]
fn a_program_for_other_addresses_is_refused() {
    let whole = program(1_000);
    let segment = "has a segment at 0x10000100 to 0x100004e8, and a program of a Raspberry Pi Pico that is swapped is at 0x10008000 to 0x10048000";
    refused(&elf(&[(0x1000_0100, &whole)]), segment);
    refused(&elf(&[(0x0800_0000, &whole)]), "has a segment at 0x08000000");
    // Its last byte is where the next program goes.
    refused(&elf(&[(START, &whole), (0x1004_8000 - 1, &[1, 2])]), "has a segment at 0x10047fff");
    assert!(Program::of(&elf(&[(START, &whole), (0x1004_8000 - 2, &[1, 2])])).is_ok());
    refused(&elf(&[(u32::MAX, &[1, 2])]), "has a segment at 0xffffffff to 0x100000001");
}

#[test]
fn a_program_that_is_too_long_is_refused() {
    let room = 256 << 10;
    assert!(Program::of(&program(room)).is_ok());
    refused(&program(room + 1), "has 262145 bytes, and a program of a Raspberry Pi Pico has room for 262144");
}

#[test]
fn what_is_no_program_is_refused() {
    refused(b"", "has 0 bytes");
    refused(&program(8)[..7], "has 7 bytes");
    refused(b":10000000", "its first word, 0x3030313a, is no stack in its RAM");
    refused(&[0xFF; 1_000], "is no stack");
    refused(&[0; 1_000], "is no stack");
    refused(b"UF2\n and more", "is a UF2 file; give the ELF file");
    let mut flat = program(1_000);
    // Past its end, before its beginning, in its vectors, and no Thumb instruction.
    for reset in [START + 1_001, START - 1, START + 1, START + 0x40] {
        flat[4..8].copy_from_slice(&reset.to_le_bytes());
        refused(&flat, "its first instruction");
    }
}

#[test]
fn an_elf_file_of_another_machine_or_a_part_of_one_is_refused() {
    let whole = elf(&[(START, &program(1_000))]);
    for length in [4, 51, 60, 83, whole.len() - 1] {
        refused(&whole[..length], "is an ELF file that is cut off");
    }
    let with = |at: usize, byte: u8| {
        let mut file = whole.clone();
        file[at] = byte;
        file
    };
    // 64 bits, big endian, x86-64.
    for (at, byte) in [(4, 2), (5, 2), (18, 62)] {
        refused(&with(at, byte), "not for an ARM of 32 bits");
    }
    refused(&with(44, 0), "without segments");
    refused(&elf(&[]), "without segments");
}

#[test]
fn the_map_is_that_of_the_firmware() {
    let text = include_str!("../../../firmware/Cargo.toml");
    let board =
        text.split("[[package.metadata.boards]]").find(|board| board.contains("name = \"rp2040-pico\""));
    let number = |word: &str| match word.trim().replace('_', "") {
        word if word.starts_with("0x") => u32::from_str_radix(&word[2..], 16).unwrap(),
        word => word.parse().unwrap(),
    };
    let region = |key: &str| {
        let list = board.unwrap().split_once(&format!("{key} = [")).unwrap().1.split_once(']').unwrap().0;
        let (start, size) = list.split_once(',').unwrap();
        number(start)..number(start) + number(size)
    };
    assert_eq!((region("active"), region("ram")), (PICO.active.clone(), PICO.ram.clone()));
}
