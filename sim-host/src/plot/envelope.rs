//! The rows of a run as a picture needs them, in memory that does not grow with their number.

/// Samples at most. A picture has fewer columns of pixels than half of them, and a group of rows that is kept
/// by its extremes has 2 at least.
const SAMPLES: usize = 4096;
/// Rows of an open group that are kept before they are reduced.
const PENDING: usize = 64;

/// One row of `C` curves that share their times. A picture has no more digits than f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample<const C: usize> {
    /// Time, in s.
    pub(super) t: f64,
    /// By curve; NaN where one is not known.
    pub(super) values: [f32; C],
}

impl<const C: usize> Sample<C> {
    /// At time `t` (s).
    pub(super) fn at(t: f64, values: [f64; C]) -> Self {
        Self { t, values: values.map(rounded) }
    }
}

/// The nearest f32 that is no more than `value` where it says so: what is finite stays finite, and a ratio
/// inside stays inside.
fn rounded(value: f64) -> f32 {
    let near = value as f32;
    match () {
        () if value.is_finite() && near.is_infinite() => f32::MAX.copysign(near),
        () if value.abs() < 1.0 && near.abs() >= 1.0 => 1.0f32.next_down().copysign(near),
        () => near,
    }
}

/// The envelope of `C` curves. As many rows as [`SAMPLES`] are kept as they are. More are grouped, twice as
/// many in each group whenever there is no room; of each stay the first and the last row, and those where a
/// curve is lowest and highest. So it is full once it was, and a long run needs no more than one that has
/// just filled it.
#[derive(Clone, Debug)]
pub(super) struct Envelope<const C: usize> {
    /// Rows in a group.
    width: u64,
    /// Rows of closed groups, in the order of time.
    kept: Vec<Sample<C>>,
    /// Where each closed group ends in `kept`.
    ends: Vec<usize>,
    open: Vec<Sample<C>>,
    in_open: u64,
}

impl<const C: usize> Default for Envelope<C> {
    fn default() -> Self {
        Self { width: 1, kept: Vec::new(), ends: Vec::new(), open: Vec::new(), in_open: 0 }
    }
}

impl<const C: usize> Envelope<C> {
    /// Appends a row, which is later than all before.
    pub(super) fn push(&mut self, sample: Sample<C>) {
        self.open.push(sample);
        self.in_open += 1;
        if self.in_open == self.width {
            self.close();
        } else if self.open.len() >= PENDING {
            reduce(&mut self.open);
        }
    }

    /// What is kept, in the order of time.
    pub(super) fn samples(&self) -> impl Iterator<Item = &Sample<C>> {
        self.kept.iter().chain(&self.open)
    }

    fn close(&mut self) {
        reduce(&mut self.open);
        if self.kept.len() + self.open.len() > SAMPLES {
            while self.kept.len() > SAMPLES / 2 {
                self.halve();
            }
            // Groups are wider now: the open one may have room again.
            if self.in_open < self.width {
                return;
            }
            reduce(&mut self.open);
        }
        self.kept.append(&mut self.open);
        self.ends.push(self.kept.len());
        self.in_open = 0;
    }

    /// Makes one group of two. One that is left over begins the open one.
    fn halve(&mut self) {
        let (mut kept, mut ends, mut from) = (Vec::with_capacity(SAMPLES), Vec::new(), 0);
        for &end in self.ends.iter().skip(1).step_by(2) {
            let mut group = self.kept[from..end].to_vec();
            reduce(&mut group);
            kept.append(&mut group);
            ends.push(kept.len());
            from = end;
        }
        if !self.ends.len().is_multiple_of(2) {
            self.open.splice(0..0, self.kept.drain(from..));
            self.in_open += self.width;
        }
        (self.kept, self.ends, self.width) = (kept, ends, self.width * 2);
    }
}

/// Leaves the first and the last row, and those where a curve is lowest and highest.
fn reduce<const C: usize>(samples: &mut Vec<Sample<C>>) {
    let Some(last) = samples.len().checked_sub(1).filter(|&last| last > 1) else { return };
    let mut stays = vec![false; samples.len()];
    (stays[0], stays[last]) = (true, true);
    for curve in 0..C {
        let known = || {
            samples.iter().map(|sample| sample.values[curve]).enumerate().filter(|(_, value)| !value.is_nan())
        };
        let low = known().min_by(|a, b| a.1.total_cmp(&b.1));
        let high = known().rev().max_by(|a, b| a.1.total_cmp(&b.1));
        for (at, _) in low.into_iter().chain(high) {
            stays[at] = true;
        }
    }
    let mut stays = stays.into_iter();
    samples.retain(|_| stays.next() == Some(true));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The envelope of two curves over so many rows.
    fn envelope(rows: u64, curves: impl Fn(u64) -> [f64; 2]) -> Envelope<2> {
        let mut envelope = Envelope::default();
        for k in 0..rows {
            envelope.push(Sample::at(k as f64, curves(k)));
        }
        envelope
    }

    #[test]
    fn rounding_makes_nothing_infinite_and_no_breach() {
        assert_eq!([1e300, -1e300, f64::INFINITY].map(rounded), [f32::MAX, f32::MIN, f32::INFINITY]);
        assert!(rounded(1.0 - 1e-12) < 1.0 && rounded(-1.0 + 1e-12) > -1.0 && rounded(1.0) == 1.0);
        assert!(rounded(f64::NAN).is_nan() && rounded(0.1) == 0.1);
    }

    #[test]
    fn what_fits_is_kept_as_it_is() {
        let few = envelope(SAMPLES as u64, |k| [k as f64, f64::NAN]);
        assert_eq!(few.samples().count(), SAMPLES);
    }

    #[test]
    fn memory_does_not_grow_with_the_number_of_rows() {
        // Each row is somewhere an extreme: the worst case.
        let wild = |k: u64| [(k.wrapping_mul(0x9E37_79B9) % 1000) as f64, (k % 7) as f64];
        let smooth = |k: u64| [k as f64, 0.0];
        for rows in [10_000, 100_000, 1_000_000] {
            for envelope in [envelope(rows, wild), envelope(rows, smooth)] {
                let count = envelope.samples().count();
                // Two curves: no group has more than six rows.
                assert!((SAMPLES / 6..=SAMPLES + PENDING).contains(&count), "{rows} rows: {count}");
                assert!(envelope.kept.capacity() <= SAMPLES, "{}", envelope.kept.capacity());
            }
        }
    }

    #[test]
    fn a_spike_of_one_row_survives_wherever_it_is_and_so_do_the_ends() {
        // Around a row with which there is no room, too: that is where groups are made wider.
        for at in (1..99_000).step_by(997).chain(4090..4110).chain(8190..8200) {
            for spike in [-5.0, 5.0, f64::INFINITY] {
                let with = envelope(100_000, |k| [0.5, if k == at { spike } else { (k % 3) as f64 }]);
                let samples: Vec<_> = with.samples().collect();
                let found = samples.iter().filter(|sample| f64::from(sample.values[1]) == spike);
                assert_eq!(found.map(|sample| sample.t).collect::<Vec<_>>(), [at as f64]);
                assert_eq!((samples[0].t, samples[samples.len() - 1].t), (0.0, 99_999.0));
                assert!(samples.is_sorted_by(|a, b| a.t < b.t));
            }
        }
    }

    #[test]
    fn a_long_gap_stays_one_and_a_single_known_row_in_it_stays_too() {
        let gap = |k: u64| if (20_000..60_000).contains(&k) && k != 45_000 { f64::NAN } else { 1.0 };
        let with = envelope(100_000, |k| [gap(k), 0.0]);
        let inside: Vec<_> = with.samples().filter(|s| (20_100.0..59_900.0).contains(&s.t)).collect();
        let known: Vec<f64> = inside.iter().filter(|s| !s.values[0].is_nan()).map(|s| s.t).collect();
        assert!(inside.len() > 100 && known == [45_000.0], "{known:?}");
    }
}
