//! `key=low..high`: a key and the range that its values are drawn from.

use super::values::key_of;
use crate::scenario::{format_duration, parse_duration};
use funnelnet_law::math;

/// A key with its range.
#[derive(Clone, Debug, PartialEq)]
pub struct Range {
    /// The full key, such as `coupling.funnel.rate`.
    pub key: String,
    /// As it was written, without the key.
    pub text: String,
    kind: Kind,
    is_log: bool,
}

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Whole numbers, both ends among them.
    Whole(i64, i64),
    /// Real numbers from the first one on, and below the second one.
    Real(f64, f64),
    /// Whole nanoseconds, both ends among them.
    Duration(u64, u64),
}

const WANTED: &str = "must be key=low..high, as in bus.loss=0.0..0.3, graph.nodes=4..20, bus.latency=10us..900us or coupling.funnel.rate=0.1..10.0:log";

impl Range {
    /// Reads `key=low..high` and `key=low..high:log`. Ends without a point or an exponent are whole numbers, as in TOML; with `:log` equal
    /// ratios are equally likely.
    ///
    /// # Errors
    /// What is wrong with it, in a few words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (key, range) = text.split_once('=').ok_or(WANTED)?;
        let key = key_of(key)?;
        let text = range.trim().to_owned();
        let (ends, is_log) = text.strip_suffix(":log").map_or((text.as_str(), false), |ends| (ends, true));
        let (low, high) = ends.split_once("..").ok_or(WANTED)?;
        let kind = Kind::parse(low.trim(), high.trim()).ok_or(WANTED)?;
        let (low, high) = kind.ends();
        if low >= high {
            return Err(format!("must begin below its end, and {text} does not"));
        }
        if is_log && low <= 0.0 {
            return Err(format!("must begin above 0 for :log, and {text} does not"));
        }
        Ok(Self { key, text, kind, is_log })
    }

    /// The value at `part` of the range, from 0 to below 1, as TOML.
    #[must_use]
    pub fn at(&self, part: f64) -> String {
        match self.kind {
            Kind::Real(low, high) => format!("{:?}", self.between(low, high, part).clamp(low, high)),
            Kind::Whole(low, high) => self.whole(low as f64, high as f64, part).to_string(),
            Kind::Duration(low, high) => {
                let ns = self.whole(low as f64, high as f64, part);
                format_duration(u64::try_from(ns).unwrap_or(low).clamp(low, high))
            }
        }
    }

    /// As many values have each whole number: the last one, too.
    fn whole(&self, low: f64, high: f64, part: f64) -> i64 {
        (self.between(low, high + 1.0, part).floor() as i64).clamp(low as i64, high as i64)
    }

    fn between(&self, low: f64, high: f64, part: f64) -> f64 {
        match self.is_log {
            true => low * math::exp(part * math::ln(high / low)),
            false => low + part * (high - low),
        }
    }
}

impl Kind {
    fn parse(low: &str, high: &str) -> Option<Self> {
        if let (Ok(low), Ok(high)) = (low.parse(), high.parse()) {
            return Some(Self::Whole(low, high));
        }
        if let (Ok(low), Ok(high)) = (parse_duration(low), parse_duration(high)) {
            return Some(Self::Duration(low, high));
        }
        let real = |text: &str| text.parse().ok().filter(|number: &f64| number.is_finite());
        Some(Self::Real(real(low)?, real(high)?))
    }

    fn ends(self) -> (f64, f64) {
        match self {
            Self::Whole(low, high) => (low as f64, high as f64),
            Self::Real(low, high) => (low, high),
            Self::Duration(low, high) => (low as f64, high as f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str, parts: &[f64]) -> Vec<String> {
        let range = Range::parse(text).unwrap();
        parts.iter().map(|part| range.at(*part)).collect()
    }

    #[test]
    fn a_range_is_real_whole_or_of_times_as_its_ends_are_written() {
        assert_eq!(at("bus.loss=0.0..0.3", &[0.0, 0.5]), ["0.0", "0.15"]);
        assert_eq!(at("bus.loss=0..0.5", &[0.0, 0.5]), ["0.0", "0.25"]);
        assert_eq!(at("graph.nodes=4..6", &[0.0, 0.34, 0.67, 0.999_999]), ["4", "5", "6", "6"]);
        assert_eq!(at("seed=-2..2", &[0.0, 0.99]), ["-2", "2"]);
        assert_eq!(at("bus.latency=100us..1ms", &[0.0, 0.5]), ["100us", "550us"]);
    }

    #[test]
    fn with_log_equal_ratios_are_equally_likely() {
        let values = at("rate=0.01..100.0:log", &[0.0, 0.25, 0.5, 0.75]);
        for (value, expected) in values.iter().zip([0.01, 0.1, 1.0, 10.0]) {
            let value: f64 = value.parse().unwrap();
            assert!((value / expected - 1.0).abs() < 1e-12, "{value} {expected}");
        }
        assert_eq!(at("nodes=1..7:log", &[0.0, 0.34, 0.999]), ["1", "2", "7"]);
    }

    #[test]
    fn what_is_no_range_is_refused() {
        for text in ["bus.loss", "bus.loss=0.1", "bus.loss=0.1,0.2", "bus.loss=a..b", "x=0..inf", "x=1ms..2"]
        {
            assert_eq!(Range::parse(text).unwrap_err(), WANTED, "{text}");
        }
        assert!(Range::parse("x=2.0..1.0").unwrap_err().contains("must begin below its end"));
        assert!(Range::parse("x=0.0..1.0:log").unwrap_err().contains("must begin above 0"));
    }
}
