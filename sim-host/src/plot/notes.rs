//! What a panel says of its node in words.

use super::marks::Kind;
use super::trace::{Drawn, Node};

/// The largest ratio. What is not a number, or not known, never reads as a small one.
pub(super) fn largest(node: &Node) -> String {
    let (worst, all_ticks) = node.worst();
    if worst.judged == 0 {
        return "largest |\u{3BD}|/\u{3C8}: not known".to_owned();
    }
    if worst.max_ratio.is_nan() {
        return "largest |\u{3BD}|/\u{3C8}: not a number".to_owned();
    }
    let whence = if all_ticks { "" } else { " at the rows" };
    format!("largest |\u{3BD}|/\u{3C8} = {}{whence}", digits(worst.max_ratio))
}

/// Three decimals, or as many as tell the ratio from 1.
fn digits(ratio: f64) -> String {
    let decimals = (3..=6).find(|&decimals| {
        let text = format!("{ratio:.decimals$}");
        ratio == 1.0 || text.parse::<f64>() != Ok(1.0)
    });
    match decimals {
        _ if ratio.is_infinite() => "infinite".to_owned(),
        _ if ratio >= 1e4 => crate::number_format::significant(ratio, 3).replace(".0e", "e"),
        Some(decimals) => format!("{ratio:.decimals$}"),
        None => if ratio < 1.0 {
            "1 \u{2212} 1e\u{2212}6 or nearer to 1"
        } else {
            "1 + 1e\u{2212}6 or nearer to 1"
        }
        .to_owned(),
    }
}

/// What else has to be known of the panel, in one line.
pub(super) fn notes(trace: &Drawn, node: &Node) -> String {
    let (worst, all_ticks) = node.worst();
    let what = if all_ticks { "tick" } else { "row" };
    let at = |count: u64| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let mut notes = Vec::new();
    if worst.breaches > 0 {
        let between = if node.is_outside_at_a_row() { "" } else { ", between the rows" };
        notes.push(format!("outside at {}{between}", at(worst.breaches)));
    }
    if worst.unknown > 0 {
        notes.push(format!("not known at {}", at(worst.unknown)));
    }
    if worst.uncoupled > 0 {
        notes.push(format!("no neighbour at {}", at(worst.uncoupled)));
    }
    if node.psi.first().is_some_and(|psi| psi.is_infinite()) {
        notes.push("\u{3C8} begins infinite".to_owned());
    }
    let marks: Vec<_> = trace.marks_of(node.id).collect();
    notes.extend(marks.iter().take(2).map(|mark| mark.words()));
    if marks.len() > 2 {
        notes.push(format!("{} marks more", marks.len() - 2));
    }
    if marks.iter().any(|mark| mark.kind == Kind::Stopped) {
        notes.push("judged on".to_owned());
    }
    notes.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_near_one_is_told_from_one() {
        let said = [0.9251, 0.99997, 1.0, 1.00004, 1.4, 4e8, f64::INFINITY].map(digits);
        assert_eq!(said, ["0.925", "0.99997", "1.000", "1.00004", "1.400", "4e8", "infinite"]);
        assert!(digits(1.0 - 1e-9).contains("or nearer"));
    }
}
