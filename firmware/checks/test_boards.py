"""boards.py finds tables of the book that are not what the metadata says."""

import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
import boards  # noqa: E402

FACTS = {
    "families": {"g4": {"target": "thumbv7em-none-eabihf", "core": "M4F", "log": "RTT"}},
    "boards": [{"name": "one-board", "family": "g4", "flash": [0, 1], "ram": [2, 3], "storage": [0x800, 2048], "real-time": "CAN", "service": "UART",
                "storage-note": "2 KiB | the core stands still"}],
    "images": [{"name": "one_board", "board": "one-board", "flash": 1, "ram": 2, "stack": 3000}],
}
STACK = "| one_board | 1 | 2 | 3 | 4 | 10 | 5 | 3,000 | 24,576 |"


def page(facts):
    """A page with all the tables."""
    made = boards.Boards(facts)
    tables = {name: boards.markdown(rows) for name, rows in made.tables().items()}
    tables["stack"] = boards.markdown(made.of_stack(STACK))
    return "\n".join(f"<!-- table of {name}, by ./ci.sh boards-docs -->\n\n{table}\n\n<!-- end -->\n" for name, table in tables.items())


def changed(table, **keys):
    """The same facts with other values in the first row of a table."""
    return {**FACTS, table: [{**FACTS[table][0], **keys}]}


class Tables(unittest.TestCase):
    def differing(self, facts):
        return list(boards.check(boards.Boards(facts), page(FACTS)))

    def test_a_page_that_was_just_written_differs_nowhere(self):
        self.assertEqual(self.differing(FACTS), [])

    def test_a_fact_that_has_changed_is_found(self):
        self.assertEqual(self.differing(changed("boards", service="USART")), ["the table of boards"])
        self.assertEqual(self.differing(changed("boards", storage=[0x1000, 2048])), ["the table of storage"])

    def test_a_budget_and_an_image_that_have_changed_are_found(self):
        self.assertEqual(self.differing(changed("images", stack=4000)), ["images or budgets in the table of stack"])
        self.assertEqual(self.differing(changed("images", name="other")), ["images or budgets in the table of stack"])

    def test_an_image_of_no_board_is_refused(self):
        with self.assertRaises(SystemExit) as end:
            boards.Boards(changed("images", board="none"))
        self.assertIn("image one_board: board is none, not one of one-board", str(end.exception))

    def test_rows_for_the_shell_have_the_columns_that_it_counts(self):
        self.assertEqual(list(boards.Boards(FACTS).board_rows()), [("one_board", "thumbv7em-none-eabihf", 0, 1, 2, 3, 0, 0x800, 2048)])
        self.assertEqual(list(boards.Boards(FACTS).image_rows()), [("one_board", "one_board", "one_board", "-", 1, 2, 3000, "-", 0, 1, 0)])

    def test_the_images_of_an_update_are_in_parts_of_the_flash(self):
        image, (board,) = FACTS["images"][0], FACTS["boards"]
        facts = {**FACTS, "boards": [{**board, "boot2": 256, "update": {"boot": [10, 20], "active": [30, 40]}}],
                 "images": [{**image, "features": feature} for feature in ("boot-loader", "update", "usb")]}
        self.assertEqual([row[-3:] for row in boards.Boards(facts).image_rows()], [(10, 20, 256), (30, 40, 0), (0, 1, 256)])


if __name__ == "__main__":
    unittest.main()
