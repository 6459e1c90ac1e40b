"""uf2.py makes files that a boot loader takes, of images for its chips alone."""

import pathlib
import struct
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
import boards  # noqa: E402
import uf2  # noqa: E402

FLASH, STORAGE, SECTOR, FAMILY = 0x1000_0100, 0x1000_4000, 4096, 0xE48BFF56
FACTS = {
    "families": {
        "rp2040": {"target": "thumbv6m-none-eabi", "core": "M0+", "log": "RTT", "boot2": 256, "uf2": FAMILY, "sector": SECTOR},
        "g4": {"target": "thumbv7em-none-eabihf", "core": "M4F", "log": "RTT"},
    },
    "boards": [
        {"name": "pico", "family": "rp2040", "chip": "RP2040", "flash": [FLASH, 0x3F00], "storage": [STORAGE, 0x1000]},
        {"name": "nucleo", "family": "g4", "chip": "STM32G474RE", "flash": [0, 1]},
    ],
    "images": [
        {"name": "pico", "board": "pico"},
        {"name": "nucleo", "board": "nucleo"},
        {"name": "pico_boot", "board": "pico", "features": "boot-loader"},
        {"name": "pico_update", "board": "pico", "features": "update"},
        {"name": "pico_usb", "board": "pico", "features": "usb"},
    ],
}
BOARDS = boards.Boards(FACTS)
PICO = uf2.board_of(BOARDS, "pico")


def elf(*segments, machine=40):
    """An ELF file with these segments: address, bytes; and one that takes RAM and nothing of the file."""
    header, entry, count = 52, 32, len(segments) + 1
    at, table, data = header + entry * count, b"", b""
    for address, content in [*segments, (0x2000_0000, b"")]:
        table += struct.pack("<8I", 1, at + len(data), address, address, len(content), len(content) or 4096, 5, 4)
        data += content
    head = b"\x7fELF\x01\x01\x01" + bytes(9) + struct.pack("<2H5I6H", 2, machine, 1, FLASH, header, 0, 0, header, entry, count, 40, 0, 0)
    return head + table + data


def blocks(file):
    return list(struct.iter_unpack(uf2.BLOCK, file))


class Uf2(unittest.TestCase):
    def refusal(self, what, *arguments):
        with self.assertRaises(SystemExit) as end:
            what(*arguments)
        return str(end.exception)

    def test_every_block_is_numbered_and_of_the_family(self):
        file = blocks(uf2.uf2(elf((FLASH - 256, b"boot" * 64), (FLASH, b"x" * 5000)), PICO))
        self.assertEqual([block[5] for block in file], list(range(32)))
        for first, second, flags, _, size, _, count, family, _, end in file:
            self.assertEqual((first, second, end), (0x0A324655, 0x9E5D5157, 0x0AB16F30))
            self.assertEqual((flags, size, count, family), (0x2000, 256, 32, FAMILY))

    def test_a_file_that_is_cut_off_is_refused_wherever_it_is_cut(self):
        whole = elf((FLASH - 256, b"boot" * 64), (FLASH, b"x" * 5000))
        for length in [*range(6, 160, 7), len(whole) - 1500, len(whole) - 1]:
            self.assertRegex(self.refusal(uf2.uf2, whole[:length], PICO), "cut off|no ELF")
        self.assertIn("nothing that is flashed", self.refusal(uf2.uf2, elf(), PICO))

    def test_bytes_are_where_the_image_has_them_and_the_rest_of_each_sector_is_erased(self):
        file = blocks(uf2.uf2(elf((FLASH - 256, b"boot"), (FLASH + 2 * SECTOR, b"program")), PICO))
        self.assertEqual([block[3] for block in file], [start + 256 * page for start in (FLASH - 256, FLASH - 256 + 2 * SECTOR) for page in range(16)])
        flash = {block[3]: block[8][:256] for block in file}
        self.assertEqual(flash[FLASH - 256], b"boot" + b"\xff" * 252)
        self.assertEqual(flash[FLASH + 2 * SECTOR], b"program" + b"\xff" * 249)
        self.assertEqual(flash[FLASH + 2 * SECTOR + 256], b"\xff" * 256)

    def test_images_of_other_chips_and_unknown_ones_are_refused_by_name(self):
        self.assertEqual(self.refusal(uf2.board_of, BOARDS, "nucleo"),
                         "image nucleo is for STM32G474RE, which takes no UF2 file; images that become one: pico, pico_usb")
        self.assertIn("image is pica, which there is not; images that become a UF2 file: pico, pico_usb", self.refusal(uf2.board_of, BOARDS, "pica"))
        self.assertEqual(uf2.board_of(BOARDS, "pico_usb"), PICO)

    def test_parts_of_a_flash_with_updates_are_refused(self):
        for image in ("pico_boot", "pico_update"):
            self.assertRegex(self.refusal(uf2.board_of, BOARDS, image), f"image {image} is one of two .*; images that become a UF2 file: pico, pico_usb$")

    def test_what_is_not_for_the_flash_is_refused(self):
        self.assertIn("a segment is at 0x20000000 to 0x20000004, not in flash, 0x10000000 to 0x10004000", self.refusal(uf2.uf2, elf((0x2000_0000, b"code")), PICO))
        self.assertIn("no ELF file of 32 bits for ARM", self.refusal(uf2.uf2, elf((FLASH, b"code"), machine=243), PICO))
        self.assertIn("no ELF file of 32 bits for ARM", self.refusal(uf2.uf2, b"UF2\n", PICO))

    def test_a_sector_of_the_storage_is_refused(self):
        inside = {**PICO, "flash": [FLASH, 0x8000]}
        self.assertIn("the sector at 0x10004000 is in the storage", self.refusal(uf2.uf2, elf((STORAGE + 0x0F00, b"code")), inside))
        self.assertEqual(len(blocks(uf2.uf2(elf((STORAGE - 4, b"code")), inside))), 16)
        self.assertEqual(len(blocks(uf2.uf2(elf((STORAGE + 0x1000, b"code")), inside))), 16)


if __name__ == "__main__":
    unittest.main()
