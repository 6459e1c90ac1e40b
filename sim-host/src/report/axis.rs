//! Ranges and tick labels.

use funnel_core::math;
use std::ops::Range;

/// The range of `values` with a margin of 5 %, never empty.
pub(super) fn padded(values: impl Iterator<Item = f64>) -> Range<f64> {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return -1.0..1.0;
    }
    let margin = (0.05 * (high - low)).max(1e-9 * high.abs().max(low.abs())).max(1e-12);
    low - margin..high + margin
}

/// A decimal label without trailing zeros, `1e-7` style where that is shorter.
pub(super) fn label(value: &f64) -> String {
    let value = *value;
    if value == 0.0 || value.abs() < 1e-12 {
        return "0".into();
    }
    if (1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.4}");
        return text.trim_end_matches('0').trim_end_matches('.').replace('-', "\u{2212}");
    }
    format!("{value:.3e}").replace(".000e", "e").replace('-', "\u{2212}")
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
    fn ranges_are_never_empty() {
        for range in [padded([3.0, 3.0].into_iter()), padded(std::iter::empty()), padded([0.0].into_iter())] {
            assert!(range.end > range.start);
        }
    }
}
