//! Largest and smallest of numbers where one that is not a number is never lost.
//!
//! `f64::max` drops a NaN, so that a fold by it calls a network that has diverged the best of all. Here a NaN
//! is the largest and the smallest of all: whoever compares the result with a limit finds that it does not
//! hold.

/// The larger of two; NaN where one of them is.
#[must_use]
pub fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

/// The smaller of two; NaN where one of them is.
#[must_use]
pub fn smaller(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.min(b) }
}

/// The largest value, none below `floor`; NaN where one is.
#[must_use]
pub fn largest(floor: f64, values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(floor, larger)
}

/// The smallest value, none above `ceiling`; NaN where one is.
#[must_use]
pub fn smallest(ceiling: f64, values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(ceiling, smaller)
}

/// Lowest and highest of some values; both are not a number where one is not.
#[must_use]
pub fn extremes(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let first = (f64::INFINITY, f64::NEG_INFINITY);
    values.into_iter().fold(first, |(low, high), value| (smaller(low, value), larger(high, value)))
}

/// Whether a value takes the place of the largest so far: it is larger, or the first that is not a number.
#[must_use]
pub fn beyond(value: f64, largest: f64) -> bool {
    value > largest || (value.is_nan() && !largest.is_nan())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_that_is_not_a_number_takes_the_place_and_keeps_it() {
        assert!(beyond(2.0, 1.0) && !beyond(1.0, 1.0) && !beyond(0.0, 1.0));
        assert!(beyond(f64::NAN, f64::INFINITY));
        assert!(!beyond(f64::NAN, f64::NAN) && !beyond(f64::INFINITY, f64::NAN));
    }

    #[test]
    fn a_value_that_is_not_a_number_is_never_lost() {
        for values in [[f64::NAN, 1.0, 2.0], [1.0, f64::NAN, 2.0], [1.0, 2.0, f64::NAN]] {
            assert!(largest(0.0, values).is_nan() && smallest(9.0, values).is_nan());
        }
        assert!(larger(f64::NAN, 1.0).is_nan() && larger(1.0, f64::NAN).is_nan());
        assert!(smaller(f64::NAN, 1.0).is_nan() && smaller(1.0, f64::NAN).is_nan());
    }

    #[test]
    fn numbers_are_compared_as_ever() {
        assert_eq!((largest(0.0, [-1.0, 3.0, 2.0]), largest(0.0, [])), (3.0, 0.0));
        assert_eq!((smallest(9.0, [4.0, f64::INFINITY]), smallest(9.0, [])), (4.0, 9.0));
    }
}
