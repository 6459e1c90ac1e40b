//! Frames that were lost, over time: a rug along the lower edge of a picture, in memory that does not grow
//! with time.

use plotters::coord::CoordTranslate;
use plotters::prelude::*;

use super::PlotError;
use super::legend::{Entry, Stroke};
use super::style::{INK, at, line};

/// Groups of rows at most: about as many as a picture has columns of pixels.
const GROUPS: usize = 1024;
/// Heights of the marks of the fewest and of the most losses, in pixels.
const LOW: f64 = 4.0;
const HIGH: f64 = 12.0;

/// How many deliveries were lost when.
#[derive(Clone, Debug)]
pub(super) struct Losses {
    /// Time of its first row (s) and losses of each group.
    groups: Vec<(f64, u64)>,
    /// Rows in a group.
    width: u64,
    in_last: u64,
}

impl Default for Losses {
    fn default() -> Self {
        Self { groups: Vec::new(), width: 1, in_last: 0 }
    }
}

impl Losses {
    /// Takes the losses of a row, which is later than all before.
    pub(super) fn push(&mut self, t: f64, lost: u64) {
        if self.in_last == 0 {
            if self.groups.len() == GROUPS {
                self.halve();
            }
            self.groups.push((t, 0));
        }
        if let Some(last) = self.groups.last_mut() {
            last.1 += lost;
        }
        self.in_last = (self.in_last + 1) % self.width;
    }

    /// Makes one group of two.
    fn halve(&mut self) {
        let sum = |pair: &[(f64, u64)]| (pair[0].0, pair.iter().map(|group| group.1).sum());
        self.groups = self.groups.chunks(2).map(sum).collect();
        self.width *= 2;
    }

    /// A mark at each time at which something was lost, the higher the more that was, on the height `bottom`.
    pub(super) fn draw<DB, CT>(
        &self,
        chart: &mut ChartContext<'_, DB, CT>,
        bottom: f64,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        let most = self.groups.iter().map(|group| group.1).max().unwrap_or(0).max(1);
        let mark = |&(t, lost): &(f64, u64)| {
            let height = LOW + (HIGH - LOW) * lost as f64 / most as f64;
            let up = vec![at(0, 0), at(0, -(height as i32))];
            EmptyElement::at((t, bottom)) + PathElement::new(up, line(INK, 1))
        };
        let marks: Vec<_> = self.groups.iter().filter(|group| group.1 > 0).map(mark).collect();
        chart.draw_series(marks).map(|_| ()).map_err(PlotError::new)
    }

    /// The line of the legend, where something was lost.
    pub(super) fn entry(&self) -> Option<Entry> {
        let any = self.groups.iter().any(|group| group.1 > 0);
        any.then(|| Entry { label: "frames lost".to_owned(), style: line(INK, 1), stroke: Stroke::Rug })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_bounded_and_no_loss_is_lost() {
        for rows in [1, 1023, 1024, 1025, 100_000] {
            let mut losses = Losses::default();
            (0..rows).for_each(|k| losses.push(f64::from(k), u64::from(k % 3 == 0)));
            let sum: u64 = losses.groups.iter().map(|group| group.1).sum();
            assert_eq!(sum, u64::from(rows as u32).div_ceil(3));
            assert!(losses.groups.len() <= GROUPS && losses.groups.is_sorted_by(|a, b| a.0 < b.0));
        }
    }

    #[test]
    fn a_loss_is_marked_at_its_time() {
        let mut losses = Losses::default();
        (0..100_000).for_each(|k| losses.push(f64::from(k), u64::from(k == 50_000)));
        let found: Vec<f64> = losses.groups.iter().filter(|group| group.1 > 0).map(|group| group.0).collect();
        assert!(found.len() == 1 && (found[0] - 50_000.0).abs() < 200.0, "{found:?}");
        assert!(losses.entry().is_some() && Losses::default().entry().is_none());
    }
}
