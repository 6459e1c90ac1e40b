//! How much the emergent dynamics contract.

use funnel_core::gain::{BuiltinGain, Gain};

/// `df_em / dxi` (1/s) for affine fields: the mean of their slopes (1/s) with the weights
/// `dh / df_i = psi_i (mu_i^-1)'(h - f_i) / sum_j psi_j (mu_j^-1)'(h - f_j)` (paper, Section "Numerical integration").
///
/// All slices by index; `inputs` are `h - f_i` (state units / s), `psi` in any common unit.
// To be replaced by the function of the same meaning in `funnel_core::emergent` once that is there.
pub(super) fn slope(inputs: &[f64], slopes: &[f64], psi: &[f64], gains: &[BuiltinGain<f64>]) -> f64 {
    let (mut above, mut below) = (0.0, 0.0);
    for (((input, slope), psi), gain) in inputs.iter().zip(slopes).zip(psi).zip(gains) {
        let weight = psi * gain.inverse_slope(*input);
        above += weight * slope;
        below += weight;
    }
    above / below
}

#[cfg(test)]
mod tests {
    use super::slope;
    use funnel_core::emergent::{Agent, field};
    use funnel_core::gain::{BuiltinGain, LocallyLinear, Reciprocal};

    #[test]
    fn it_is_the_derivative_of_the_emergent_field() {
        let gains = [
            BuiltinGain::Reciprocal(Reciprocal { scale: 2.0 }),
            BuiltinGain::Reciprocal(Reciprocal { scale: 0.5 }),
            BuiltinGain::LocallyLinear(LocallyLinear { bound: 1.0 }),
        ];
        let (slopes, offsets, psi) = ([1.0, -2.0, -0.3], [3.0, 0.5, -1.0], [1.0, 0.4, 0.7]);
        let each = |xi: f64| [0, 1, 2].map(|i| slopes[i] * xi + offsets[i]);
        let emergent = |xi: f64| {
            let f = each(xi);
            field(&[0, 1, 2].map(|i| Agent { psi: psi[i], f: f[i], gain: gains[i] }), 0.0)
        };
        let (xi, step) = (0.7, 1e-5);
        let difference = (emergent(xi + step) - emergent(xi - step)) / (2.0 * step);
        let inputs = each(xi).map(|f| emergent(xi) - f);
        let exact = slope(&inputs, &slopes, &psi, &gains);
        assert!((exact - difference).abs() < 1e-8, "{exact} {difference}");
    }
}
