//! The clock of a node in a process, and the loop that polls the node.

use funnelnet_app::Clock;
use std::cell::Cell;
use std::future::poll_fn;
use std::pin::pin;
use std::task::{Context, Poll, Waker};
use std::thread;
use std::time::{Duration, Instant};

/// The system's monotonic clock, perhaps a little too fast or too slow, with the time at which a thread that rests is to go on.
pub struct SystemClock {
    begin: Instant,
    /// Parts in a billion that it is too fast.
    drift_ppb: i64,
    alarm: Cell<u64>,
}

impl SystemClock {
    /// A clock that starts now, and is so many ppm too fast.
    pub fn start(drift_ppm: f64) -> Self {
        let drift_ppb = (drift_ppm * 1000.0).round() as i64;
        Self { begin: Instant::now(), drift_ppb, alarm: Cell::new(u64::MAX) }
    }

    /// Polls a future until it is done. In between, this thread rests until the earliest alarm, or until
    /// another one unparks it.
    pub fn run<T>(&self, future: impl Future<Output = T>) -> T {
        let mut future = pin!(future);
        // Whatever ends a rest, everything is polled.
        let mut context = Context::from_waker(Waker::noop());
        loop {
            self.alarm.set(u64::MAX);
            if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
                return value;
            }
            thread::park_timeout(Duration::from_nanos(self.alarm.get().saturating_sub(self.now())));
        }
    }

    /// Ends the next rest at `at` (ns) at the latest.
    pub fn wake_at(&self, at: u64) {
        self.alarm.set(self.alarm.get().min(at));
    }
}

impl Clock for &SystemClock {
    fn now(self) -> u64 {
        let passed = u64::try_from(self.begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let gained = i128::from(passed) * i128::from(self.drift_ppb) / 1_000_000_000;
        passed.saturating_add_signed(i64::try_from(gained).unwrap_or(0))
    }

    fn wait_until(self, at: u64) -> impl Future<Output = ()> {
        poll_fn(move |_| {
            if self.now() >= at {
                return Poll::Ready(());
            }
            self.wake_at(at);
            Poll::Pending
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rest_ends_at_the_earliest_alarm() {
        let clock = SystemClock::start(0.0);
        let ms = |ms: u64| ms * 1_000_000;
        let (early, late) = (clock.wait_until(ms(20)), clock.wait_until(ms(60_000)));
        clock.run(embassy_futures::select::select(late, early));
        assert!((ms(20)..ms(60_000)).contains(&clock.now()));
    }

    #[test]
    fn a_clock_that_is_too_slow_falls_behind() {
        assert_eq!(SystemClock::start(-150.0).drift_ppb, -150_000);
        let slow = SystemClock { drift_ppb: -500_000_000, ..SystemClock::start(0.0) };
        thread::sleep(Duration::from_millis(20));
        let passed = slow.begin.elapsed().as_nanos() as u64;
        assert!(slow.now() < passed * 6 / 10, "{} of {passed}", slow.now());
    }

    #[test]
    fn a_rest_ends_when_another_thread_has_something() {
        let clock = SystemClock::start(0.0);
        let (sender, receiver) = std::sync::mpsc::channel();
        let rests = thread::current();
        thread::spawn(move || {
            sender.send(7).unwrap();
            rests.unpark();
        });
        let received = clock.run(poll_fn(|_| receiver.try_recv().map_or(Poll::Pending, Poll::Ready)));
        assert_eq!(received, 7);
    }
}
