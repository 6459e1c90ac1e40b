//! Whether telemetry is a measurement: finite values in a funnel that is open, of a component that the state
//! has.

use super::OTHER_COMPONENT;
use funnelnet_protocol::report::Telemetry;

/// Why telemetry of a state of so many components is refused, and the value that shows it.
pub(crate) fn refusal(telemetry: &Telemetry, components: usize) -> Option<(&'static str, String)> {
    let Telemetry { component, nu, psi, u, .. } = *telemetry;
    if usize::from(component) >= components {
        return Some((OTHER_COMPONENT, format!("telemetry of {component}")));
    }
    let not_finite = [("nu", nu), ("psi", psi), ("u", u)].into_iter().find(|(_, value)| !value.is_finite());
    let wrong = not_finite.or((psi <= 0.0).then_some(("psi", psi)));
    wrong.map(|(name, value)| ("sent telemetry that is no measurement", format!("{name} = {value}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_numbers_in_an_open_funnel_are_measurements() {
        let good = Telemetry { tick: 3, component: 1, nu: -0.5, psi: 2.0, u: 0.0 };
        assert_eq!(refusal(&good, 2), None);
        let cases = [
            (Telemetry { nu: f32::NAN, ..good }, "nu = NaN"),
            (Telemetry { psi: f32::INFINITY, ..good }, "psi = inf"),
            (Telemetry { psi: 0.0, ..good }, "psi = 0"),
            (Telemetry { psi: -2.0, ..good }, "psi = -2"),
            (Telemetry { u: f32::NEG_INFINITY, ..good }, "u = -inf"),
            (Telemetry { component: 2, ..good }, "telemetry of 2"),
        ];
        for (telemetry, value) in cases {
            assert_eq!(refusal(&telemetry, 2).map(|(_, value)| value).as_deref(), Some(value));
        }
    }
}
