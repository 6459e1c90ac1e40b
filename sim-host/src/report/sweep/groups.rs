//! The values of a parameter as few enough groups to be read: each by itself, or of many numbers ten ranges with as many of them in each.

use super::super::figures::short;
use super::table::number;
use std::collections::BTreeMap;

/// Most values that stand by themselves.
pub(super) const MOST: usize = 24;
/// Ranges that more are put into.
const RANGES: usize = 10;

/// Groups of values.
#[derive(Debug, PartialEq)]
pub(super) struct Groups {
    /// What each is called.
    pub(super) names: Vec<String>,
    /// The mean of the values in each; NaN where one is no number.
    pub(super) centres: Vec<f64>,
    of: BTreeMap<String, usize>,
}

impl Groups {
    /// Of values as [`Table::axes`](super::table::Table::axes) has them: numbers ascend.
    pub(super) fn of(values: &[String]) -> Self {
        let numbers: Option<Vec<f64>> = values.iter().map(|value| number(value)).collect();
        let numbers = numbers.filter(|_| values.len() > MOST);
        let count = if numbers.is_some() { RANGES } else { values.len() };
        let place = |at: usize| at * count / values.len().max(1);
        let mut groups = Self { names: Vec::new(), centres: Vec::new(), of: BTreeMap::new() };
        for group in 0..count {
            let members: Vec<&String> = values
                .iter()
                .enumerate()
                .filter(|(at, _)| place(*at) == group)
                .map(|(_, value)| value)
                .collect();
            let known: Vec<f64> = members.iter().map(|value| number(value).unwrap_or(f64::NAN)).collect();
            let name = match (members.as_slice(), known.as_slice()) {
                ([one], _) => (*one).clone(),
                (_, [first, .., last]) => format!("{} to {}", short(*first), short(*last)),
                _ => String::new(),
            };
            groups.names.push(name);
            groups.centres.push(known.iter().sum::<f64>() / known.len() as f64);
            groups.of.extend(members.into_iter().map(|value| (value.clone(), group)));
        }
        groups
    }

    /// The group of a value.
    pub(super) fn place(&self, value: &str) -> Option<usize> {
        self.of.get(value).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_stand_by_themselves_and_many_numbers_in_ranges() {
        let words = ["ring", "star"].map(str::to_owned);
        let groups = Groups::of(&words);
        assert_eq!((groups.names.as_slice(), groups.place("star")), (&words[..], Some(1)));
        let many: Vec<String> = (0..100).map(|n| n.to_string()).collect();
        let groups = Groups::of(&many);
        assert_eq!(groups.names.len(), RANGES);
        assert_eq!(
            (groups.names[1].as_str(), groups.centres[1], groups.place("19")),
            ("10 to 19", 14.5, Some(1))
        );
        assert_eq!(groups.place("100"), None);
    }
}
