"""A Cortex-M4F with its interrupts on unicorn, and the peripherals that a board puts around it. Time is virtual: the same every time.

Of the core's own peripherals it has what the images use: NVIC, vector table, reset request. All interrupts have the same priority
(firmware/src/priority.rs), so none interrupts another; an NMI and a hard fault do.

Instructions run in slices of SLICE, and time goes on by a slice: an event is seen up to 12.5 us late at 160 MHz, so no figure here is finer, unless
a test asks for shorter ones (`slice_length`).
"""

import struct

from elftools.elf.elffile import ELFFile
from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_HOOK_INTR, UC_HOOK_MEM_INVALID, UC_HOOK_MEM_WRITE, UC_MODE_MCLASS, UC_MODE_THUMB, Uc, UcError
from unicorn.arm_const import (
    UC_ARM_REG_FPSCR, UC_ARM_REG_IPSR, UC_ARM_REG_LR, UC_ARM_REG_PC, UC_ARM_REG_PRIMASK, UC_ARM_REG_R0, UC_ARM_REG_R1,
    UC_ARM_REG_R2, UC_ARM_REG_R3, UC_ARM_REG_R12, UC_ARM_REG_S0, UC_ARM_REG_SP, UC_ARM_REG_XPSR, UC_CPU_ARM_CORTEX_M4)

SLICE = 2000
WFI, WFE, SEV = 0xBF30, 0xBF20, b"\x40\xbf"
SCS = 0xE000E000
NMI, HARD_FAULT, FIRST_IRQ = 2, 3, 16
# An exception's return to where a frame with floating-point registers was stacked: into another handler, and into the program.
TO_HANDLER, TO_THREAD = 0xFFFFFFE1, 0xFFFFFFE9
STACKED = (UC_ARM_REG_R0, UC_ARM_REG_R1, UC_ARM_REG_R2, UC_ARM_REG_R3, UC_ARM_REG_R12, UC_ARM_REG_LR)
FRAME = 0x68
# Cycles of an exception's entry or return, with some for what its slice did not use.
EXCEPTION_CYCLES = 200
# What unicorn calls an exception's return, and an access that no memory answers.
UC_EXCEPTION_EXIT = 8
MMIO = ((0x40000000, 0x30000), (0x48000000, 0x2000), (0x50000000, 0x2000), (0xE0000000, 0x100000))


# The mode of RTT that a debugger sets.
LOG_WAITS = 2


class Fault(Exception):
    """The program has done what no board can: it has left its memory, or unicorn does not know what."""


class PowerCut(Exception):
    """The supply is gone in the middle of a flash operation."""


class Peripheral:
    """Registers that hold what is written. What does more derives from it."""

    def __init__(self, core, base, size=0x400):
        self.core, self.base, self.size = core, base, size
        self.held = {}

    def reset(self):
        """As after a reset of the chip."""
        self.held.clear()

    def get(self, offset):
        return self.held.get(offset, 0)

    def read(self, offset):
        return self.get(offset)

    def write(self, offset, value):
        self.held[offset] = value

    def advance(self, before, after):
        """Time has gone on, ns."""

    def next_event(self):
        """Time of what happens next by itself, ns; None where nothing does."""


class Core:
    """Memory, registers and exceptions of one chip, with an image flashed."""

    def __init__(self, image, hz, flash, flash_size, ram_size, info=()):
        self.hz, self.flash, self.flash_size, self.slice_length = hz, flash, flash_size, SLICE
        self.uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        for base, size in ((flash, flash_size), (0x20000000, ram_size), (0xFFFFF000, 0x1000), *info):
            self.uc.mem_map(base, size)
        for base, size in MMIO:
            self.uc.mmio_map(base, size, self.on_read, base, self.on_write, base)
        self.load(image)
        self.uc.hook_add(UC_HOOK_INTR, self.on_interrupt)
        self.uc.hook_add(UC_HOOK_MEM_INVALID, self.on_invalid)
        self.ns, self.resets, self.stop_reason = 0.0, 0, None
        self.on_reset = lambda cause: None
        self.peripherals, self.by_page = [], {}
        self.other = Peripheral(self, 0, 1 << 32)
        self.is_barking, self.stalled = False, 0.0
        self.is_finishing, self.nmi_delay, self.nmis = False, 0, 0
        self.clear()

    def load(self, image):
        with open(image, "rb") as file:
            elf = ELFFile(file)
            self.symbols = {each.name: each["st_value"] for each in elf.get_section_by_name(".symtab").iter_symbols()}
            self.uc.mem_write(self.flash, b"\xff" * self.flash_size)
            self.segments = [(each["p_paddr"], each.data()) for each in elf.iter_segments()
                             if each["p_type"] == "PT_LOAD" and each["p_filesz"]]
        for start, data in self.segments:
            self.uc.mem_write(start, data)
            self.hear_events(start, data)

    def flash_anew(self, is_flat):
        """Writes the image over what is in flash: by its segments, or as a file without addresses, whose gaps are zeros."""
        parts = [(self.flash, self.flat())] if is_flat else self.segments
        for start, data in parts:
            self.uc.mem_write(start, data)

    def flat(self):
        """The image as a `.bin`."""
        end = max(start + len(data) for start, data in self.segments)
        file = bytearray(end - self.flash)
        for start, data in self.segments:
            file[start - self.flash:start - self.flash + len(data)] = data
        return bytes(file)

    def hear_events(self, start, data):
        """An SEV sets the event register, which unicorn has not; words that only look like one are never executed."""
        for at in range(0, len(data) - 1, 2):
            if data[at:at + 2] == SEV:
                self.uc.hook_add(UC_HOOK_CODE, self.on_event, begin=start + at, end=start + at)

    def on_event(self, *_):
        self.has_event = True

    def add(self, peripheral):
        peripheral.reset()
        self.peripherals.append(peripheral)
        for page in range(peripheral.base, peripheral.base + peripheral.size, 0x400):
            self.by_page[page] = peripheral
        return peripheral

    def on_flash_write(self, handler):
        self.uc.hook_add(UC_HOOK_MEM_WRITE, handler, begin=self.flash, end=self.flash + self.flash_size - 1)

    # --- reset

    def clear(self):
        self.enabled, self.pending, self.levels, self.active = set(), set(), set(), []
        # The event register: set by SEV and by each return from an exception, cleared by the WFE that it lets through.
        self.has_event = False
        self.vectors = self.flash
        self.scs = {}
        for peripheral in [*self.peripherals, self.other]:
            peripheral.reset()
        stack, start = struct.unpack("<II", self.uc.mem_read(self.flash, 8))
        for register, value in ((UC_ARM_REG_PRIMASK, 0), (UC_ARM_REG_XPSR, 1 << 24), (UC_ARM_REG_IPSR, 0), (UC_ARM_REG_SP, stack)):
            self.uc.reg_write(register, value)
        self.pc = start | 1

    def reset(self, cause):
        """What a reset request and a watchdog do: everything but RAM and time begins anew."""
        self.resets += 1
        self.clear()
        self.on_reset(cause)

    # --- memory

    def on_read(self, uc, offset, size, base):
        address = base + offset
        return (self.word(address & ~3) >> 8 * (address & 3)) & ((1 << 8 * size) - 1)

    def word(self, address):
        if SCS <= address < SCS + 0x1000:
            return self.read_scs(address - SCS)
        peripheral = self.by_page.get(address & ~0x3FF, self.other)
        return peripheral.read(address - peripheral.base) & 0xFFFFFFFF

    def on_write(self, uc, offset, size, value, base):
        address = base + offset
        value &= (1 << 8 * size) - 1
        if SCS <= address < SCS + 0x1000:
            self.write_scs(address - SCS, value)
            return
        peripheral = self.by_page.get(address & ~0x3FF, self.other)
        at = (address & ~3) - peripheral.base
        if size < 4:
            shift = 8 * (address & 3)
            mask = ((1 << 8 * size) - 1) << shift
            value = peripheral.get(at) & ~mask & 0xFFFFFFFF | value << shift
        peripheral.write(at, value)

    # --- NVIC and SCB

    def read_scs(self, offset):
        if 0x100 <= offset < 0x120:
            first = (offset - 0x100) * 8
            return sum(1 << number - first for number in self.enabled if first <= number < first + 32)
        return {0xD00: 0x410FC241, 0xD04: 0, 0xD08: self.vectors}.get(offset, self.scs.get(offset, 0))

    def write_scs(self, offset, value):
        bits = lambda base: {(offset - base) * 8 + bit for bit in range(32) if value >> bit & 1}
        if 0x100 <= offset < 0x120:
            self.enabled |= bits(0x100)
        elif 0x180 <= offset < 0x1A0:
            self.enabled -= bits(0x180)
        elif 0x200 <= offset < 0x220:
            self.pending |= bits(0x200)
        elif 0x280 <= offset < 0x2A0:
            self.pending = self.pending - bits(0x280) | self.levels - set(self.active)
        elif offset == 0xD08:
            self.vectors = value
        elif offset == 0xD0C and value & 4:
            self.stop("reset request")
        else:
            self.scs[offset] = value

    def irq(self, number, is_up):
        """A peripheral's interrupt line; it latches as it rises."""
        if is_up and number not in self.levels:
            self.levels.add(number)
            self.pending.add(number)
        elif not is_up:
            self.levels.discard(number)

    # --- exceptions

    def stop(self, reason):
        self.stop_reason = reason
        self.uc.emu_stop()

    def on_interrupt(self, uc, number, data):
        self.stop("return" if number == UC_EXCEPTION_EXIT else f"exception {number}")

    def on_invalid(self, uc, access, address, size, value, data):
        self.stop("return" if address >= 0xFFFFFFE0 else f"no memory at {address:#x}")
        return False

    def take_interrupt(self):
        ready = self.pending & self.enabled
        if not ready or self.active or self.uc.reg_read(UC_ARM_REG_PRIMASK) & 1:
            return False
        number = min(ready)
        self.pending.discard(number)
        self.enter(FIRST_IRQ + number)
        return True

    def enter(self, exception):
        """Stacks what the processor stacks, floating-point registers included, and goes on at the handler."""
        uc = self.uc
        stack, psr = uc.reg_read(UC_ARM_REG_SP), uc.reg_read(UC_ARM_REG_XPSR)
        frame = (stack - FRAME) & ~7
        aligned = 0x200 if (stack - FRAME) & 4 else 0
        words = [uc.reg_read(register) for register in STACKED] + [self.pc & ~1, psr & ~0x200 | 1 << 24 | aligned]
        floats = [uc.reg_read(UC_ARM_REG_S0 + i) & 0xFFFFFFFF for i in range(16)]
        uc.mem_write(frame, struct.pack("<26I", *words, *floats, uc.reg_read(UC_ARM_REG_FPSCR), 0))
        uc.reg_write(UC_ARM_REG_SP, frame)
        uc.reg_write(UC_ARM_REG_LR, TO_HANDLER if self.active else TO_THREAD)
        uc.reg_write(UC_ARM_REG_IPSR, exception)
        self.active.append(exception - FIRST_IRQ)
        self.pc = struct.unpack("<I", uc.mem_read(self.vectors + 4 * exception, 4))[0] | 1

    def leave(self):
        uc = self.uc
        stack = uc.reg_read(UC_ARM_REG_SP)
        words = struct.unpack("<26I", uc.mem_read(stack, FRAME))
        for register, value in zip(STACKED, words):
            uc.reg_write(register, value)
        for i in range(16):
            uc.reg_write(UC_ARM_REG_S0 + i, words[8 + i])
        uc.reg_write(UC_ARM_REG_FPSCR, words[24])
        uc.reg_write(UC_ARM_REG_SP, (stack + FRAME) | (4 if words[7] & 0x200 else 0))
        number = self.active.pop()
        self.has_event = True
        uc.reg_write(UC_ARM_REG_XPSR, words[7] & ~0x3FF | 1 << 24)
        uc.reg_write(UC_ARM_REG_IPSR, self.active[-1] + FIRST_IRQ if self.active else 0)
        self.pc = words[6] | 1
        if number in self.levels:
            self.pending.add(number)

    def fault(self):
        """The program takes a hard fault where it is."""
        self.enter(HARD_FAULT)

    def finish_load(self):
        """The load that raises an NMI completes first, and `nmi_delay` more instructions: a bus error is asynchronous."""
        self.is_finishing = True
        self.uc.emu_start(self.uc.reg_read(UC_ARM_REG_PC) | 1, 0xFFFFFFFE, count=1 + self.nmi_delay)
        self.is_finishing = False
        self.pc = self.uc.reg_read(UC_ARM_REG_PC) | 1

    # --- time

    def run_until(self, end):
        while self.ns < end:
            self.slice(end)

    def slice(self, end):
        taken = self.take_interrupt()
        # Masked interrupts are taken as soon as they are unmasked: one by one until then.
        count = 1 if not taken and not self.active and self.pending & self.enabled else self.slice_length
        self.stop_reason = None
        try:
            self.uc.emu_start(self.pc, 0xFFFFFFFE, count=count)
        except UcError as error:
            # unicorn gives a WFE up, behind it.
            self.stop_reason = self.stop_reason or (None if self.last() == WFE else str(error))
        self.after(count, end)

    def after(self, count, end):
        reason, before = self.stop_reason, self.ns
        if reason == "reset request":
            self.reset(reason)
            return
        if reason == "power cut":
            raise PowerCut
        if reason == "return":
            self.leave()
            step = self.cycles(EXCEPTION_CYCLES)
        elif reason == "NMI":
            self.finish_load()
            self.enter(NMI)
            step = self.cycles(EXCEPTION_CYCLES)
        elif reason:
            raise Fault(f"{reason}, pc {self.uc.reg_read(UC_ARM_REG_PC):#x}, {self.ns / 1e6} ms")
        else:
            self.pc = self.uc.reg_read(UC_ARM_REG_PC) | 1
            step = self.step(count, end)
        self.ns += step + self.stalled
        self.stalled = 0.0
        for peripheral in self.peripherals:
            peripheral.advance(before, self.ns)
        if self.is_barking:
            self.is_barking = False
            self.reset("watchdog")

    def stall(self, ns):
        """The core stands still, as while its flash is erased; time goes on."""
        self.stalled += ns

    @property
    def time(self):
        """With what the present slice has stood still until now, ns."""
        return self.ns + self.stalled

    def cycles(self, count):
        return count * 1e9 / self.hz

    def last(self):
        """The instruction behind which the program stands, if it has two bytes."""
        return struct.unpack("<H", self.uc.mem_read((self.uc.reg_read(UC_ARM_REG_PC) & ~1) - 2, 2))[0]

    def step(self, count, end):
        """Time that goes on in a slice that nothing but a WFI, a WFE or its length has ended."""
        last = self.last()
        if last == WFE and self.has_event:
            self.has_event = False
            return self.cycles(EXCEPTION_CYCLES)
        return self.sleep(end) if last in (WFI, WFE) else self.cycles(count)

    def sleep(self, end):
        """Up to what happens next; a pending interrupt wakes even where it is masked."""
        if self.pending & self.enabled:
            return self.cycles(EXCEPTION_CYCLES)
        events = [event for each in self.peripherals if (event := each.next_event()) is not None]
        return max(min([end, *events]) - self.ns, 1000.0)

    # --- for tests

    def hang(self):
        """The program stays where it is, while interrupts go on: `wfi; b .-2` in RAM that nothing uses."""
        self.execute(WFI, 0xE7FD)

    def execute(self, *half_words):
        at = self.symbols["_stack_end"]
        self.uc.mem_write(at, struct.pack(f"<{len(half_words)}H", *half_words))
        self.uc.reg_write(UC_ARM_REG_PRIMASK, 0)
        self.pc = at | 1

    @property
    def log_channel(self):
        """Of the log (defmt over RTT): name, buffer, size, where it ends, where it is read, flags."""
        return self.symbols["_SEGGER_RTT"] + 24

    def log_words(self):
        """Of the log's ring: size, where it ends, where it is read."""
        return struct.unpack("<3I", self.uc.mem_read(self.log_channel + 8, 12))

    def leave_debugger(self):
        """A debugger has asked for a log that waits where there is no room, and was unplugged: there is none, and nobody reads."""
        size, end, _ = self.log_words()
        self.uc.mem_write(self.log_channel + 16, struct.pack("<2I", (end + 1) % size, LOG_WAITS))

    def log(self):
        """What the log holds, as bytes for a decoder."""
        channel = self.log_channel
        buffer, size, end, start = struct.unpack("<4I", self.uc.mem_read(channel + 4, 16))
        ring = bytes(self.uc.mem_read(buffer, size))
        self.uc.mem_write(channel + 16, struct.pack("<I", end))
        return ring[start:end] if start <= end else ring[start:] + ring[:end]
