"""What the metadata of Cargo.toml says of boards and images, for ./ci.sh and for the book.

usage: boards.py boards | images | check BOOK | write BOOK STACK

`boards` and `images` print rows for the shell. `check` compares the tables of the book's page with the metadata, `write` writes them; STACK is what
`./ci.sh stack` has printed, whose table the book has, too.
"""

import json
import pathlib
import re
import subprocess
import sys

MANIFEST = pathlib.Path(__file__).with_name("Cargo.toml")
# Features whose images are in a part of flash, as a board's `update` has it.
PARTS = {"update": "active", "boot-loader": "boot"}
STACK_HEAD = ["image", "program and tasks", "interrupt", "NMI", "fault's frame", "together, bytes", "fault", "budget", "room"]


def metadata():
    """By cargo, which reads its manifest whatever Python's age."""
    command = ["cargo", "metadata", "--no-deps", "--format-version", "1", "--manifest-path", MANIFEST]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["packages"][0]["metadata"]


class Boards:
    """Families, boards and images, in their order."""

    def __init__(self, facts):
        self.boards = [{**facts["families"][board["family"]], **board} for board in facts["boards"]]
        self.images = facts["images"]
        names = [board["name"] for board in self.boards]
        for image in self.images:
            if image["board"] not in names:
                sys.exit(f"{MANIFEST}: image {image['name']}: board is {image['board']}, not one of {', '.join(names)}")

    def board_rows(self):
        """Name as that of the binary, target, flash, RAM, boot loader's bytes, storage."""
        for board in self.boards:
            yield (board["name"].replace("-", "_"), board["target"], *board["flash"], *board["ram"], board.get("boot2", 0), *board.get("storage", ()))

    def image_rows(self):
        """Name, board, binary, features, budgets, whether firmware/emulated runs it, where its program is, and the bytes of a boot loader of the chip in front of it."""
        by_name = {board["name"]: board for board in self.boards}
        for image in self.images:
            budgets = (image[key] for key in ("flash", "ram", "stack"))
            board, features = by_name[image["board"]], image.get("features", "-")
            part = PARTS.get(features)
            place = board["update"][part] if part else board["flash"]
            yield (image["name"], image["board"].replace("-", "_"), image.get("binary", image["name"]), features,
                   *budgets, "emulated" if image.get("emulated") else "-", *place, 0 if part == "active" else board.get("boot2", 0))

    # --- tables of the book

    def tables(self):
        return {"boards": self.of_boards(), "flashing": self.of_flashing(), "storage": self.of_storage()}

    def of_boards(self):
        yield ["board, feature", "chip", "real-time plane", "service plane", "log", "in CI"]
        emulated = {image["board"] for image in self.images if image.get("emulated")}
        for board in self.boards:
            chip = ", ".join(filter(None, (board.get("chip"), board["core"])))
            default = " (default)" if board is self.boards[0] else ""
            yield [f"`{board['name']}`{default}", chip, board["real-time"], board["service"], board["log"],
                   "runs in QEMU" if default else "runs on an emulator" if board["name"] in emulated else "linked only"]

    def of_flashing(self):
        yield ["board", "command"]
        host = self.boards[0]["target"]
        for board in self.boards:
            if "probe" in board:
                target = "" if board["target"] == host else f" --target {board['target']}"
                binary = board["name"].replace("-", "_")
                yield [board["title"], f"`PROBE_RS_CHIP={board['probe']} cargo run --release{target} --no-default-features --features {board['name']} --bin {binary}`"]

    def of_storage(self):
        yield ["board", "region", "pages", "while a page is erased"]
        for board in self.boards:
            start, size = board.get("storage", (0, 0))
            region = f"{size // 1024} KiB at 0x{start:08X}" if size else "none"
            yield [board.get("title", f"`{board['name']}`"), region, *(cell.strip() for cell in board["storage-note"].split("|"))]

    def of_stack(self, printed):
        """The table that ./ci.sh stack prints; every image has to be in it."""
        found = dict(re.findall(r"^\| (\w+) \| (.*) \|$", printed, re.M))
        missing = [image["name"] for image in self.images if image["name"] not in found]
        if missing:
            sys.exit(f"no stack of {', '.join(missing)}")
        yield STACK_HEAD
        for image in self.images:
            yield [f"`{image['name']}`", *found[image["name"]].split(" | ")]


def cells(row):
    return "| " + " | ".join(row).replace("|  |", "| |") + " |"


def markdown(rows, numbers=False):
    head, *rest = rows
    rule = "|---|" + ("---:|" if numbers else "---|") * (len(head) - 1)
    return "\n".join([cells(head), rule, *map(cells, rest)])


def marked(name):
    """A table in the book, between its marks."""
    return re.compile(rf"(<!-- table of {name}, by \./ci\.sh boards-docs -->\n\n)(.*?)(\n\n<!-- end -->)", re.S)


def written(text, name, table):
    replaced, count = marked(name).subn(lambda match: match[1] + table + match[3], text)
    return replaced if count == 1 else sys.exit(f"the book has {count} marks of the table of {name}, not 1")


def check(boards, text):
    """What differs; of the stack only which images there are, and their budgets: how deep it is depends on the compiler."""
    for name, rows in boards.tables().items():
        if written(text, name, markdown(rows)) != text:
            yield f"the table of {name}"
    stack = marked("stack").search(text)
    found = re.findall(r"^\| `(\w+)` .* ([\d,]+) \| [\d,]+ \|$", stack[2], re.M) if stack else []
    if found != [(image["name"], f"{image['stack']:,}") for image in boards.images]:
        yield "images or budgets in the table of stack"


def main(command, book=None, stack=None):
    boards = Boards(metadata())
    if command in ("boards", "images"):
        for row in boards.board_rows() if command == "boards" else boards.image_rows():
            print(*row)
        return
    path = pathlib.Path(book)
    text = path.read_text()
    if command == "check":
        if differing := list(check(boards, text)):
            sys.exit(f"{book} is not what {MANIFEST} says: {'; '.join(differing)}: ./ci.sh boards-docs")
        return
    for name, rows in boards.tables().items():
        text = written(text, name, markdown(rows))
    path.write_text(written(text, "stack", markdown(boards.of_stack(pathlib.Path(stack).read_text()), numbers=True)))


if __name__ == "__main__":
    main(*sys.argv[1:])
