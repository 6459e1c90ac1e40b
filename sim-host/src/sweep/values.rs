//! `key=a,b,c`: a key and the values that it is to have, one after the other.

/// A key with its values, as written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    /// The full key, such as `coupling.funnel.rate`.
    pub key: String,
    /// TOML values, or bare strings.
    pub values: Vec<String>,
}

impl Axis {
    /// Reads `key=a,b,c`. Commas in strings, arrays and inline tables part nothing.
    ///
    /// # Errors
    /// What is wrong with it, in a few words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (key, values) = text.split_once('=').ok_or("must be key=a,b,c, as in bus.loss=0.0,0.1,0.2")?;
        let key = key_of(key)?;
        let values: Vec<String> = split(values).into_iter().map(|value| value.trim().to_owned()).collect();
        if values.iter().any(String::is_empty) {
            return Err("has an empty value; write \"\" for an empty string".to_owned());
        }
        for (n, value) in values.iter().enumerate() {
            if values.iter().take(n).any(|other| canonical(other) == canonical(value)) {
                return Err(format!("has the value {value} twice"));
            }
        }
        Ok(Self { key, values })
    }
}

/// A full key without blanks, as columns and messages have it.
///
/// # Errors
/// A part of it is empty.
pub fn key_of(text: &str) -> Result<String, String> {
    let parts: Vec<_> = text.split('.').map(str::trim).collect();
    match parts.iter().any(|part| part.is_empty()) {
        true => Err("must begin with a key, as in bus.loss=0.0,0.1,0.2".to_owned()),
        false => Ok(parts.join(".")),
    }
}

/// The same text for equal numbers, however they are written.
#[must_use]
pub fn canonical(value: &str) -> String {
    match value.parse::<f64>() {
        Ok(number) if number.is_finite() => format!("{number:?}"),
        _ => value.to_owned(),
    }
}

/// The parts between commas that are in no string, array or inline table.
fn split(text: &str) -> Vec<&str> {
    let (mut parts, mut begin, mut depth, mut quote, mut escaped) = (Vec::new(), 0, 0_i32, None, false);
    for (at, c) in text.char_indices() {
        match (quote, c) {
            _ if escaped => escaped = false,
            (Some('"'), '\\') => escaped = true,
            (Some(open), _) => quote = Some(open).filter(|open| *open != c),
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => depth += 1,
            (None, ']' | '}') => depth -= 1,
            (None, ',') if depth <= 0 => {
                parts.push(text.get(begin..at).unwrap_or(""));
                begin = at + 1;
            }
            _ => {}
        }
    }
    parts.push(text.get(begin..).unwrap_or(""));
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commas_inside_of_values_part_nothing() {
        let values = |text: &str| Axis::parse(text).unwrap().values;
        assert_eq!(values("graph.kind=ring, star"), ["ring", "star"]);
        assert_eq!(values("node.1.state=[1, 2],[3,4]"), ["[1, 2]", "[3,4]"]);
        let gains = "agent.gain={ kind = \"median\", scale = 1 },{ kind = 'x,y' },\"a\\\",b\"";
        assert_eq!(values(gains), ["{ kind = \"median\", scale = 1 }", "{ kind = 'x,y' }", "\"a\\\",b\""]);
        assert_eq!(Axis::parse(" bus . loss =1").unwrap().key, "bus.loss");
    }

    #[test]
    fn what_is_no_axis_is_refused() {
        let wrong = |text: &str| Axis::parse(text).unwrap_err();
        assert!(wrong("bus.loss").contains("key=a,b,c"));
        assert!(wrong("=1").contains("must begin with a key"));
        assert!(wrong("bus.=1").contains("must begin with a key"));
        assert!(wrong("bus.loss=").contains("empty value"));
        assert!(wrong("bus.loss=0.1,,0.2").contains("empty value"));
        assert_eq!(wrong("bus.loss=0.1,0.2,1e-1"), "has the value 1e-1 twice");
    }
}
