"""A board with a host at its service line, and what tests ask of it."""

from fdcan import Frame
from stm32 import LineIn
from words import IDENTITY, IMAGES, read

STEP_NS = 100e3
MS = 1e6


def kind(frame):
    """Of a frame as it is on the wire: never zero, so COBS leaves it at the second place."""
    return frame[1]


class Board:
    """A chip, its line, and what it has said. Subclasses say which chip."""

    # Of its CAN frames: classic ones, or "fd".
    format = "can"

    def __init__(self, core, uart, baud, storage):
        self.core, self.uart = core, uart
        self.line = LineIn(core, uart, baud)
        # Lines to neighbours: the UART, and what comes there.
        self.peers = []
        core.on_reset = self.on_reset
        if storage is not None:
            core.uc.mem_write(self.storage_at[0], storage)

    @classmethod
    def path(cls, image):
        path = IMAGES / (image or cls.image)
        if not path.is_file():
            raise SystemExit(f"no image {path}: ./ci.sh boards")
        return path

    @classmethod
    def booted(cls, *arguments, **options):
        board = cls(*arguments, **options)
        board.ms(cls.boot_ms)
        # The nRF52840 restarts once by itself where its reset pin is not configured yet.
        board.core.resets = 0
        return board

    def on_reset(self, cause):
        """The chip has been reset."""
        self.rcc.cause = self.rcc.CAUSES[cause]

    def add_line(self, uart, baud):
        """A line to a neighbour."""
        self.peers.append((uart, LineIn(self.core, uart, baud)))

    # --- time

    def ms(self, count):
        self.run(count * MS)

    def run(self, ns):
        end = self.core.ns + ns
        while self.core.ns < end:
            lines = [self.line, *(line for _, line in self.peers)]
            arrivals = [at for line in lines if (at := line.next_event()) is not None]
            self.core.run_until(max(min([end, *arrivals]), self.core.ns + 1000))
            for line in lines:
                line.deliver()

    # --- words

    def tell(self, text):
        self.line.push(bytes.fromhex(text))

    def frame(self, word):
        """A CAN frame of the words as a controller has it."""
        return Frame(word[self.format]["id"], bytes.fromhex(word[self.format]["data"]), is_fd=self.format == "fd")

    def frames(self):
        """Whole frames that it has said."""
        said = bytes(self.uart.said)
        return [frame for frame in said[:said.rfind(b"\0") + 1].split(b"\0") if frame]

    def ask(self, text, wanted, within_ms=1000):
        """Says something and waits for a frame of this kind; what that says, or None."""
        heard, end = len(self.frames()), self.core.ns + within_ms * MS
        self.tell(text)
        while self.core.ns < end:
            self.run(STEP_NS)
            answers = [frame for frame in self.frames()[heard:] if kind(frame) == wanted]
            if answers:
                return read(answers[:1])[0]
        return None

    def identity(self, words):
        answer = self.ask(words["hello"], IDENTITY)
        return answer and answer["identity"]

    # --- storage

    def storage(self):
        start, size = self.storage_at
        return bytes(self.core.uc.mem_read(start, size))
