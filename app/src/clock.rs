//! Time as a platform hands it in.

/// A clock, which counts from the start of the program.
pub trait Clock: Copy {
    /// Time since the start, ns.
    fn now(self) -> u64;

    /// Waits until `at` (ns), or not as long: the app then looks at the time again. Dropping the future loses
    /// nothing.
    fn wait_until(self, at: u64) -> impl Future<Output = ()>;
}
