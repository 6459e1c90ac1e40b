//! Ranges and tick labels.

use funnelnet_law::math;
use std::ops::Range;

/// The range of `values` with a margin of 5 %, never empty.
pub(super) fn padded(values: impl Iterator<Item = f64>) -> Range<f64> {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return -1.0..1.0;
    }
    let size = high.abs().max(low.abs());
    // What differs by rounding alone is one value, and stands in the middle.
    let margin = if high - low > SAME * size { 0.05 * (high - low) } else { 0.05 * size };
    let margin = if margin > 0.0 { margin } else { 1.0 };
    low - margin..high + margin
}

/// Values are one where they differ by less, as a share of the largest.
const SAME: f64 = 1e-6;

/// This much wider than what is usual, a range is cut: a value far away would leave no room for the others.
const FAR: f64 = 20.0;
/// This much wider than what is natural, what is usual is no longer looked at.
const BEYOND: f64 = 1000.0;

/// The range for all of `values`, or, where some of them are too far away, for the others. `natural` are
/// values that the picture has to show: the scale that the run is about.
pub(super) fn robust(values: &[f64], natural: impl Iterator<Item = f64>) -> Range<f64> {
    let all = padded(values.iter().copied());
    let width = |range: &Range<f64>| range.end - range.start;
    let natural = padded(natural);
    let usual = padded(usual(values).into_iter().flatten().chain([natural.start, natural.end]));
    let core = if width(&usual) <= BEYOND * width(&natural) { usual } else { natural };
    if width(&all) <= FAR * width(&core) && values.iter().all(|v| !v.is_infinite()) {
        return all;
    }
    let room = 0.25 * width(&core);
    all.start.max(core.start - room)..all.end.min(core.end + room)
}

/// Values that a twentieth of all is below, and above.
fn usual(values: &[f64]) -> Option<[f64; 2]> {
    let mut finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let share = finite.len() / 20;
    let last = finite.len().checked_sub(1)?;
    Some([share, last - share].map(|at| *finite.select_nth_unstable_by(at, f64::total_cmp).1))
}

/// A decimal label without trailing zeros, `1e-7` style where that is shorter.
pub(super) fn label(value: &f64) -> String {
    within(*value, DECIMALS, EXPONENT_DECIMALS)
}

/// Labels of the ticks of an axis: like [`label`], with as many digits as tell them apart.
pub(super) fn labels(range: &Range<f64>) -> impl Fn(&f64) -> String + use<> {
    // Ticks are at least a hundredth of the range apart.
    let finest = 2 - math::log10(range.end - range.start).floor() as i32;
    move |value| {
        let places =
            |digits: i32, usual: usize| usize::try_from(digits).unwrap_or(0).clamp(usual, MOST_DECIMALS);
        let magnitude = math::log10(value.abs().max(f64::MIN_POSITIVE)).floor() as i32;
        within(*value, places(finest, DECIMALS), places(finest + magnitude, EXPONENT_DECIMALS))
    }
}

/// Digits behind the point of a decimal label, of one with an exponent, and of any at most.
const DECIMALS: usize = 4;
const EXPONENT_DECIMALS: usize = 3;
const MOST_DECIMALS: usize = 12;

fn within(value: f64, decimals: usize, exponent_decimals: usize) -> String {
    if value == 0.0 || value.abs() < 1e-12 {
        return "0".into();
    }
    if (1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.decimals$}");
        return text.trim_end_matches('0').trim_end_matches('.').replace('-', "\u{2212}");
    }
    let text = format!("{value:.exponent_decimals$e}");
    let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let is_whole = digits.split_once('.').is_some_and(|(_, rest)| rest.chars().all(|digit| digit == '0'));
    let digits = if is_whole { digits.trim_end_matches('0').trim_end_matches('.') } else { digits };
    format!("{digits}e{exponent}").replace('-', "\u{2212}")
}

/// The label of a power of ten on a logarithmic axis.
pub(super) fn decade(value: &f64) -> String {
    if (1e-3..1e4).contains(value) {
        return label(value);
    }
    format!("1e{}", math::log10(*value).round()).replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_short() {
        let labels = [0.0, -2.5, 1e-7, 40.0, 2.5e6].map(|v| label(&v));
        assert_eq!(labels, ["0", "\u{2212}2.5", "1e\u{2212}7", "40", "2.500e6"]);
        assert_eq!([1e-10, 0.01, 1000.0].map(|v| decade(&v)), ["1e\u{2212}10", "0.01", "1000"]);
    }

    #[test]
    fn labels_of_an_axis_differ_from_tick_to_tick() {
        for range in
            [0.0..1.0, 0.43238..0.43246, 7.60790..7.60792, 1e6..1e6 + 2.0, 2e-5..2.0001e-5, -3e-7..4e-7]
        {
            let (label, step) = (labels(&range), (range.end - range.start) / 10.0);
            let all: std::collections::BTreeSet<_> =
                (0..10).map(|k| label(&(range.start + f64::from(k) * step))).collect();
            assert_eq!(all.len(), 10, "{range:?} {all:?}");
        }
        let whole = labels(&(0.0..10.0));
        assert_eq!([2.5, 10.0].map(|value| whole(&value)), ["2.5", "10"]);
    }

    #[test]
    fn a_value_far_away_leaves_room_for_the_others() {
        let mut values: Vec<f64> = (0..100).map(|k| f64::from(k % 10)).collect();
        let whole = robust(&values, [0.0, 5.0].into_iter());
        assert!(whole.contains(&0.0) && whole.contains(&9.0) && whole.end < 10.0);
        values.push(1e9);
        let cut = robust(&values, [0.0, 5.0].into_iter());
        assert!(cut.contains(&9.0) && cut.end < 20.0, "{cut:?}");
        values.extend([8e8; 900]);
        let cut = robust(&values, [0.0, 5.0].into_iter());
        assert!(cut.contains(&5.0) && cut.end < 20.0, "a run that is far away for most of the time: {cut:?}");
        let infinite = robust(&[0.0, 1.0, f64::INFINITY], [0.0, 1.0].into_iter());
        assert!(infinite.end < 2.0, "{infinite:?}");
    }

    #[test]
    fn what_stays_as_it_is_has_short_labels() {
        for value in [1.0, 21.5, 0.0, -3e-7, 2.5e6] {
            let range = padded([value, value].into_iter());
            let (label, step) = (labels(&range), (range.end - range.start) / 10.0);
            let longest = (0..10).map(|k| label(&(range.start + f64::from(k) * step)).chars().count()).max();
            assert!(longest <= Some(9), "{range:?} {longest:?}");
        }
        assert_eq!(labels(&(0.9e6..1.1e6))(&1e6), "1e6");
    }

    #[test]
    fn ranges_are_never_empty() {
        for range in [padded([3.0, 3.0].into_iter()), padded(std::iter::empty()), padded([0.0].into_iter())] {
            assert!(range.end > range.start);
        }
    }
}
