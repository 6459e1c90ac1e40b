//! Which SYNC is new. Where lines make a ring each one comes from both sides, and an old one may come late.

use funnelnet_protocol::message::TickStamp;

/// How long a node remembers what it has passed on, ms: longer than anything needs to go round. 127 nodes at
/// 115,200 bit/s take 0.2 s.
pub const FORGET_MS: u64 = 2_000;
/// Bits of the tick in a SYNC.
const BITS: u32 = 24;

/// The newest SYNC. Only a newer one is new, so whatever goes round comes to an end, however much is on its
/// way.
#[derive(Clone, Copy, Debug, Default)]
pub struct SyncFilter {
    /// Its tick, and when it was new, ms.
    last: Option<(u32, u64)>,
}

impl SyncFilter {
    /// None has come yet.
    pub const NONE: Self = Self { last: None };

    /// Whether `tick` is ahead of the last one by less than half of what 24 bits can tell, at `now` (ms); it
    /// is the last one then. After [`FORGET_MS`] without a new one every tick is new: the host may have begun
    /// anew.
    pub fn take(&mut self, tick: TickStamp, now: u64) -> bool {
        let tick = tick.value();
        let is_new = self.last.is_none_or(|(last, at)| {
            let ahead = tick.wrapping_sub(last) & ((1 << BITS) - 1);
            (ahead > 0 && ahead < 1 << (BITS - 1)) || now.saturating_sub(at) >= FORGET_MS
        });
        if is_new {
            self.last = Some((tick, now));
        }
        is_new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn takes(newest: &mut SyncFilter, tick: u32, now: u64) -> bool {
        newest.take(TickStamp::low(tick, 24), now)
    }

    #[test]
    fn only_what_is_ahead_is_new_also_where_the_number_wraps() {
        let mut newest = SyncFilter::NONE;
        // All ones before tick 0.
        assert!(takes(&mut newest, u32::MAX, 0));
        assert!(!takes(&mut newest, u32::MAX, 0));
        assert!(takes(&mut newest, 0, 1));
        assert!(!takes(&mut newest, u32::MAX, 2));
        assert!(takes(&mut newest, 1_000, 2));
        assert!(!takes(&mut newest, 999, 2));
        assert!(!takes(&mut newest, 1_000 + (1 << 23), 2));
        assert!(takes(&mut newest, 1_000 + (1 << 23) - 1, 2));
    }

    #[test]
    fn after_two_seconds_without_a_new_one_every_one_is() {
        let mut newest = SyncFilter::NONE;
        assert!(takes(&mut newest, 500, 0));
        assert!(!takes(&mut newest, 0, FORGET_MS - 1));
        assert!(takes(&mut newest, 0, FORGET_MS));
    }
}
