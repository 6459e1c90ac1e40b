//! Durations as people write them, kept as whole nanoseconds.

/// Units that a duration may have, with their length in nanoseconds.
pub(super) const UNITS: [(&str, u64); 7] = [
    ("ns", 1),
    ("us", 1_000),
    ("µs", 1_000),
    ("ms", 1_000_000),
    ("s", 1_000_000_000),
    ("min", 60_000_000_000),
    ("h", 3_600_000_000_000),
];

/// What a duration looks like, for messages.
pub(super) const ALLOWED: &str = "must be a duration with a unit, as \"1ms\" (units: ns, us, ms, s, min, h)";

/// Reads `"1.5s"`, `"100us"` and the like as nanoseconds.
///
/// # Errors
/// A message naming the allowed units, or saying that the value is negative, finer than 1 ns or too long.
pub fn parse_duration(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    if number.is_empty() && unit.starts_with('-') {
        return Err("must not be negative (a duration)".to_owned());
    }
    let unit = UNITS.iter().find(|(name, _)| *name == unit.trim_start());
    let (Some((_, scale)), false) = (unit, number.is_empty()) else { return Err(ALLOWED.to_owned()) };
    let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
    nanoseconds(whole, fraction, *scale)
}

/// `whole.fraction` times `scale`, exactly.
fn nanoseconds(whole: &str, fraction: &str, scale: u64) -> Result<u64, String> {
    let fraction = fraction.trim_end_matches('0');
    if fraction.contains('.') || whole.is_empty() {
        return Err(ALLOWED.to_owned());
    }
    let too_long = || "must be at most 584 years, the most that nanoseconds in 64 bits can count".to_owned();
    let digits: u128 = format!("{whole}{fraction}").parse().map_err(|_| too_long())?;
    let divisor =
        u32::try_from(fraction.len()).ok().and_then(|n| 10u128.checked_pow(n)).ok_or_else(too_long)?;
    let scaled = digits.checked_mul(u128::from(scale)).ok_or_else(too_long)?;
    if scaled % divisor != 0 {
        return Err("must be a whole number of nanoseconds".to_owned());
    }
    u64::try_from(scaled / divisor).map_err(|_| too_long())
}

/// Writes nanoseconds in the largest unit that keeps the figure short: `1500000` is `1.5ms`.
#[must_use]
pub fn format_duration(ns: u64) -> String {
    let (name, scale) = match ns {
        0 => return "0s".to_owned(),
        1..1_000 => ("ns", 1),
        1_000..1_000_000 => ("us", 1_000),
        1_000_000..1_000_000_000 => ("ms", 1_000_000),
        _ => ("s", 1_000_000_000u64),
    };
    let (whole, rest) = (ns / scale, ns % scale);
    if rest == 0 {
        return format!("{whole}{name}");
    }
    let width = scale.ilog10() as usize;
    let fraction = format!("{rest:0width$}");
    format!("{whole}.{}{name}", fraction.trim_end_matches('0'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_every_unit_exactly() {
        for (text, ns) in [
            ("1ms", 1_000_000),
            ("100us", 100_000),
            ("100µs", 100_000),
            ("20s", 20_000_000_000),
            ("1.5s", 1_500_000_000),
            ("0.1 ms", 100_000),
            ("2min", 120_000_000_000),
            ("1h", 3_600_000_000_000),
            ("1.000s", 1_000_000_000),
            ("7ns", 7),
            ("0s", 0),
        ] {
            assert_eq!(parse_duration(text), Ok(ns), "{text}");
        }
    }

    #[test]
    fn refuses_what_has_no_unit_or_is_no_number() {
        for text in ["1", "", "ms", "1 parsec", "1.2.3s", ".5s", "1e3s", "s1", "1mss"] {
            assert_eq!(parse_duration(text), Err(ALLOWED.to_owned()), "{text}");
        }
        assert!(parse_duration("-1ms").unwrap_err().contains("negative"));
        assert!(parse_duration("0.5ns").unwrap_err().contains("whole number"));
        assert!(parse_duration("99999999999999h").unwrap_err().contains("584 years"));
        assert!(parse_duration("0.00000000000000000000000000000000000000000000001s").is_err());
    }

    #[test]
    fn writes_what_it_reads() {
        for text in ["1ms", "1.5s", "100us", "20s", "7ns", "1.000001s", "0s", "120s"] {
            assert_eq!(parse_duration(text).map(format_duration), Ok(text.to_owned()));
        }
    }
}
