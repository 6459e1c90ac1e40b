"""panics.py finds calls that end in a panic, in each kind of crate, and lets through what is allowed."""

import contextlib
import io
import unittest

import panics
from mutants import Folder

TASK = """
void _ZN4core9panicking5panicE(void), helper(void);
void _TaskStorage4pollE(void) { helper(); __asm__ volatile(""); }
"""
SOUND = 'void helper(void) { __asm__ volatile("nop"); }\nvoid caller(void) { helper(); __asm__ volatile(""); }\n'
PANICS = """
void _ZN4core9panicking5panicE(void);
void helper(void) { _ZN4core9panicking5panicE(); __asm__ volatile(""); }
"""
ALLOWED = PANICS.replace("void helper", "// May panic: never in truth.\nvoid helper")
NO_REASON = PANICS.replace("void helper", "// May panic:\nvoid helper")
MAIN = PANICS.replace("helper", "__cortex_m_rt_main") + SOUND
BY_POINTER = "extern void (*volatile pointer)(void);\nvoid (*volatile pointer)(void);\nvoid helper(void) { pointer(); __asm__ volatile(\"\"); }\n"
# Somebody else's function that panics, called from one of ours.
FOREIGN = PANICS.replace("helper", "foreign")
CALLS_FOREIGN = 'void foreign(void);\nvoid helper(void) { foreign(); __asm__ volatile(""); }\n'


class Panics(unittest.TestCase):
    def setUp(self):
        self.folder = Folder()
        self.addCleanup(self.folder.close)

    def is_clean(self, sources):
        root = str(self.folder.root)
        owners = panics.Owners(root, ["law"], ["firmware"], "storage")
        panics.is_marked.cache_clear()
        path = self.folder.image({"registry/task.c": TASK, **sources})
        self.said = io.StringIO()
        with contextlib.redirect_stdout(self.said), contextlib.redirect_stderr(self.said):
            return panics.check(path, root, ["law", "firmware"], owners, "storage", 0)

    def test_sound_code_is_clean(self):
        for place in ("law/src/a.c", "firmware/src/a.c"):
            with self.subTest(place):
                self.assertTrue(self.is_clean({place: SOUND}), self.said.getvalue())

    def test_a_panic_is_found_with_its_line(self):
        for place in ("law/src/a.c", "firmware/src/a.c", "firmware/src/boards/b.c"):
            with self.subTest(place):
                self.assertFalse(self.is_clean({place: PANICS}))
                self.assertIn(f"{place}:3: helper: calls _ZN4core9panicking5panicE", self.said.getvalue())

    def test_a_line_may_panic_with_a_reason_where_drivers_are_called(self):
        self.assertTrue(self.is_clean({"firmware/src/a.c": ALLOWED}), self.said.getvalue())
        self.assertFalse(self.is_clean({"firmware/src/a.c": NO_REASON}))
        self.assertFalse(self.is_clean({"law/src/a.c": ALLOWED}), "never in the law")

    def test_the_start_may_panic(self):
        self.assertTrue(self.is_clean({"firmware/src/a.c": MAIN}), self.said.getvalue())

    def test_a_pointer_is_refused_where_nothing_may_panic(self):
        self.assertFalse(self.is_clean({"law/src/a.c": BY_POINTER}))
        self.assertTrue(self.is_clean({"firmware/src/a.c": BY_POINTER}), self.said.getvalue())

    def test_a_panic_of_others_counts_where_nothing_may_panic(self):
        self.assertFalse(self.is_clean({"law/src/a.c": CALLS_FOREIGN, "registry/b.c": FOREIGN}))
        self.assertTrue(self.is_clean({"firmware/src/a.c": CALLS_FOREIGN, "registry/b.c": FOREIGN}), self.said.getvalue())

    def test_an_image_without_code_of_the_crates_is_refused(self):
        with self.assertRaises(SystemExit):
            self.is_clean({"registry/b.c": SOUND})


if __name__ == "__main__":
    unittest.main()
