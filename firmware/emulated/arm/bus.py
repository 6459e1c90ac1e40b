"""A CAN bus between boards, and a host on it. Every frame reaches every other board, in the order of the boards, within STEP_NS."""

STEP_NS = 100e3
TICK_NS = 1e6


class Bus:
    """Boards on one bus. `sent` is what each has said, in order."""

    def __init__(self, boards):
        self.boards = boards
        self.sent = [[] for _ in boards]

    def put(self, frame, sender=None):
        for board in self.boards:
            if board is not sender:
                board.can.receive(frame)

    def run(self, ns):
        for _ in range(round(ns / STEP_NS)):
            for board in self.boards:
                board.run(STEP_NS)
            for board, sent in zip(self.boards, self.sent):
                frames, board.can.sent = board.can.sent, []
                sent += frames
                for each in frames:
                    self.put(each, board)

    def start(self, words):
        self.put(self.boards[0].frame(words["start"]))
        self.run(400e3)

    def tick(self, words, tick):
        self.put(self.boards[0].frame(words["ticks"][tick]["sync"]))
        self.run(TICK_NS)
