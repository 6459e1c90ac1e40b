"""stack.py finds what would make its bound a lie."""

import unittest

import stack
from mutants import FRAME, Folder

DEEP = 'void deep(void) { volatile int room[250]; for (int i = 0; i < 250; i++) room[i] = i; }\n'
TASK = 'void deep(void); void _TaskStorage4pollE(void) { deep(); __asm__ volatile(""); }\n'
# A tree that is walked by a pointer to each child's own walk.
BY_POINTER = """
struct node { void (*walk)(struct node *); struct node *child; };
void branch(struct node *self) { if (self->child) self->child->walk(self->child); __asm__ volatile(""); }
struct node leaf = { branch, 0 }, root = { branch, &leaf };
void deep(void) { root.walk(&root); __asm__ volatile(""); }
"""
# The same over a helper: the function that is called by a pointer has no such call of its own.
OVER_A_HELPER = """
struct node { void (*walk)(struct node *); struct node *child; };
void follow(struct node *child) { if (child) child->walk(child); __asm__ volatile(""); }
void branch(struct node *self) { follow(self->child); __asm__ volatile(""); }
struct node leaf = { branch, 0 }, root = { branch, &leaf };
void deep(void) { root.walk(&root); __asm__ volatile(""); }
"""
# `strex r0, r0, [r1]` reads as the address of the function at 0xe840, which is called by no pointer.
INSTRUCTION = """
typedef void (*call)(void);
void leaf(void) { __asm__ volatile(""); }
volatile call next = leaf;
__attribute__((section(".text.far"))) void far(void) { __asm__ volatile(".balign 4\\n strex r0, r0, [r1]" ::: "r0", "memory"); next(); }
void deep(void) { far(); __asm__ volatile(""); }
"""
DIRECT = """
void other(int n);
void deep(void) { other(9); __asm__ volatile(""); }
void again(int n) { if (n) other(n - 1); __asm__ volatile(""); }
void other(int n) { if (n) again(n - 1); __asm__ volatile(""); }
"""
DYNAMIC = """
void use(char *room) { __asm__ volatile("" : : "r"(room) : "memory"); }
volatile int size;
void deep(void) { use(__builtin_alloca(size)); __asm__ volatile(""); }
"""


class Stack(unittest.TestCase):
    def setUp(self):
        self.folder = Folder()
        self.addCleanup(self.folder.close)

    def image(self, deep):
        return self.folder.image({"task.c": TASK, "deep.c": deep})

    def refused(self, deep, words):
        with self.assertRaises(SystemExit) as end:
            stack.bound(self.image(deep))
        self.assertIn(words, str(end.exception))

    def test_a_path_is_as_deep_as_its_frames(self):
        thread = stack.bound(self.image(DEEP)).thread
        self.assertTrue(1000 <= thread <= 1100, thread)

    def test_an_executor_that_is_not_recognised_is_refused(self):
        around = FRAME.replace("{ task(); ", "{ poll(); ").replace("void _ZN8executor8Executor3runE(void) {", "void poll(void) { task(); __asm__ volatile(\"\"); }\n"
                                                                  "void _ZN8executor8Executor3runE(void) {")
        with self.assertRaises(SystemExit) as end:
            stack.bound(self.folder.image({"frame.c": around, "task.c": TASK, "deep.c": DEEP}))
        self.assertIn("0 executors", str(end.exception))

    def test_recursion_is_refused(self):
        self.refused(DIRECT, "call each other in a circle: again, other")

    def test_recursion_by_a_pointer_is_refused(self):
        self.refused(BY_POINTER, "in a circle, by pointers: branch")

    def test_recursion_by_a_pointer_over_a_helper_is_refused(self):
        self.refused(OVER_A_HELPER, "in a circle, by pointers: branch")

    def test_an_instruction_that_reads_as_an_address_is_no_pointer(self):
        stack.bound(self.image(INSTRUCTION))

    def test_a_frame_whose_size_is_not_known_is_refused(self):
        self.refused(DYNAMIC, "how much is that?")


if __name__ == "__main__":
    unittest.main()
