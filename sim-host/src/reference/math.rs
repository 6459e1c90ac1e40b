//! The float functions that this module needs, all through `libm`: the same bits on every host, whatever
//! other crates switch on. `abs`, `max` and `sqrt`-free arithmetic are exact in `core` and need no wrapper.

pub(super) fn sin(x: f64) -> f64 {
    libm::sin(x)
}

pub(super) fn exp(x: f64) -> f64 {
    libm::exp(x)
}

pub(super) fn expm1(x: f64) -> f64 {
    libm::expm1(x)
}

pub(super) fn log1p(x: f64) -> f64 {
    libm::log1p(x)
}
