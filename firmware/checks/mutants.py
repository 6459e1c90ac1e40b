"""Small images with and without a fault, compiled from C: what the checks must find, and what they must let through."""

import pathlib
import subprocess
import tempfile

# Every image has these: a reset, an executor that polls tasks by a pointer, a task, a panic.
FRAME = """
typedef void (*call)(void);
extern void _ZN4core9panicking5panicE(void), _ZN8executor8Executor3runE(void), _TaskStorage4pollE(void);
void rust_begin_unwind(void) { for (;;); }
void _ZN4core9panicking5panicE(void) { rust_begin_unwind(); }
volatile call task = _TaskStorage4pollE;
void _ZN8executor8Executor3runE(void) { task(); __asm__ volatile(""); }
void Reset(void) { _ZN8executor8Executor3runE(); _ZN4core9panicking5panicE(); }
void handler(void) {}
extern unsigned _stack_start;
__attribute__((section(".vector_table"), used)) void *const table[16] =
    { &_stack_start, Reset, handler, handler, handler, handler, handler, handler, handler, handler, handler, handler, handler, handler, handler, handler };
"""
LAYOUT = """
SECTIONS {
  .vector_table 0x0 : { KEEP(*(.vector_table)) }
  .text : { *(.text) . = 0xe800; *(.text.far) }
  .rodata : { *(.rodata*) }
  .data 0x20000000 : { *(.data*) }
  .bss : { *(.bss*) }
  _stack_end = 0x20001000; _stack_start = 0x20004000;
}
"""


class Folder:
    """A folder of images; `image` compiles one from sources by their paths in it."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="mutants-")
        self.root = pathlib.Path(self.folder.name)
        self.write("layout.ld", LAYOUT)

    def write(self, path, text):
        place = self.root / path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
        return place

    def image(self, sources):
        files = [self.write(path, text) for path, text in {"frame.c": FRAME, **sources}.items()]
        out = self.root / "image"
        # The address of the entry of a lone function would be a small number that other words hold, too.
        subprocess.run(["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-g", "-O1", "-fno-optimize-sibling-calls", "-fno-inline", "-ffreestanding", "-nostdlib",
                        "-T", self.root / "layout.ld", "-e", "Reset", *files, "-o", out], check=True)
        return str(out)

    def close(self):
        self.folder.cleanup()
