//! The bytes of the vocabulary: what has been sent once keeps its number for ever.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_protocol::config::{Breach, Coupling, Gain, Normalised, Shape};
use serde::Serialize;

/// 1.0 as it travels.
const ONE: [u8; 4] = [0, 0, 0x80, 0x3F];

/// The number of the variant, and how many bytes follow it.
fn number(value: &impl Serialize) -> (u8, usize) {
    let mut room = [0; 64];
    let bytes = postcard::to_slice(value, &mut room).unwrap();
    (bytes[0], bytes.len() - 1)
}

#[test]
fn every_gain_keeps_its_number() {
    let names = ["reciprocal", "logarithmic", "locally-linear", "median", "linear", "algebraic"]
        .into_iter()
        .enumerate();
    assert_eq!(Gain::<f32>::KINDS.len(), 6);
    for (kind, (index, name)) in Gain::<f32>::KINDS.iter().zip(names) {
        assert_eq!(kind.name, name);
        let gain = (kind.build)([1.0, 1.0]);
        assert_eq!(number(&gain), (index as u8, 4 * kind.parameters.len()), "{name}");
        let mut room = [0; 16];
        assert_eq!(postcard::to_slice(&gain, &mut room).unwrap()[1..5], ONE);
    }
}

#[test]
fn couplings_breach_policies_and_funnels_keep_theirs() {
    let couplings = [
        Coupling::NodeWise,
        Coupling::MaxGain,
        Coupling::EdgeWise,
        Coupling::LambdaTracker { eta: 1.0f32 },
        Coupling::None,
    ];
    assert_eq!(couplings.map(|coupling| number(&coupling).0), [0, 1, 2, 3, 4]);
    let policies = [Breach::Ride, Breach::Reopen { margin: 1.5f32, rate: 1.0 }, Breach::Stop];
    assert_eq!(policies.map(|policy| number(&policy).0), [0, 1, 2]);
    let shapes = [
        Shape::Exponential { start: 1.0f32, end: 1.0, rate: 1.0 },
        Shape::Constant { width: 1.0 },
        Shape::ReciprocalTime { scale: 1.0 },
        Shape::FiniteTime { start: 1.0, at_ns: 1, power: 1.0 },
        Shape::Schedule { start: 1.0, at_ns: 1, eps: 1.0, then: Normalised::Constant { width: 1.0 } },
    ];
    assert_eq!(shapes.map(|shape| number(&shape).0), [0, 1, 2, 3, 4]);
}

#[test]
fn what_no_node_is_told_does_not_travel() {
    for coupling in [Coupling::ElementWise, Coupling::Linear, Coupling::<f32>::WeaklyCentralised] {
        assert!(postcard::to_slice(&coupling, &mut [0; 8]).is_err(), "{coupling}");
    }
    for unknown in 5..=255u8 {
        assert!(postcard::from_bytes::<Coupling<f32>>(&[unknown]).is_err(), "{unknown}");
    }
}
