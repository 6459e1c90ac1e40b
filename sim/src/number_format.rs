//! Numbers as people write them.

use funnelnet_law::math;

/// `value` with so many significant digits and no trailing zeros; powers of ten below 1e-3 and from 1e6 on.
#[must_use]
pub fn significant(value: f64, digits: usize) -> String {
    let size = value.abs();
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.*e}", digits.saturating_sub(2));
    }
    let decimals = (digits as i32 - 1 - math::log10(size).floor() as i32).max(0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::significant;

    #[test]
    fn figures_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (2.0, "2"),
            (1.381_966, "1.382"),
            (40.0, "40"),
            (1037.4, "1037"),
            (1e-10, "1.00e-10"),
            (0.05, "0.05"),
            (-0.25, "-0.25"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(significant(value, 4), text);
        }
        assert_eq!(significant(41.5, 6), "41.5");
    }
}
