//! Which of several copies of a number is new. On a ring each frame comes from both sides, and an old one may come late.

/// How long a number is remembered, ms. A ring must take less than that to go round: 127 nodes at 115,200 bit/s take 0.2 s.
pub const FORGET_MS: u64 = 2_000;

/// The newest of numbers that wrap. Only a newer one is new: so whatever goes round comes to an end, however much is on its way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Newest {
    /// The number, and when it was new, ms.
    last: Option<(u64, u64)>,
}

impl Newest {
    /// Nothing has come yet.
    pub const NONE: Self = Self { last: None };

    /// Whether `number`, of `bits` bits (1 to 63), is ahead of the last one by less than half of their range, at `now` (ms); it is the last
    /// one then. After [`FORGET_MS`] without a new one every number is new: a host may have started anew.
    pub fn take(&mut self, number: u64, bits: u8, now: u64) -> bool {
        let range = 1_u64 << bits.min(63);
        let is_new = self.last.is_none_or(|(last, at)| {
            let ahead = number.wrapping_sub(last) & (range - 1);
            (ahead > 0 && ahead < range / 2) || now.saturating_sub(at) >= FORGET_MS
        });
        if is_new {
            self.last = Some((number, now));
        }
        is_new
    }
}
