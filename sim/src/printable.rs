//! Text from files, file names and arguments, made fit for a terminal and for XML.

use std::borrow::Cow;

/// Whether a character would steer a terminal, hide or turn text around it, or is none of XML's.
#[must_use]
pub fn is_unprintable(c: char) -> bool {
    let turns = matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let breaks = matches!(c, '\u{2028}' | '\u{2029}');
    c.is_control() || turns || breaks || matches!(c, '\u{fffe}' | '\u{ffff}')
}

/// One line: such characters as `\n` or `\u{1b}`.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    escape(text, is_unprintable)
}

/// Several lines: the ends of lines stay.
#[must_use]
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escape(text, |c| c != '\n' && is_unprintable(c))
}

fn escape(text: &str, is_bad: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_bad) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        if is_bad(c) { escaped.extend(c.escape_default()) } else { escaped.push(c) }
    }
    Cow::Owned(escaped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_steers_a_terminal_is_escaped_and_other_text_is_left() {
        assert_eq!(printable("\u{1b}[2J\u{7}\u{9b}\u{7f}"), r"\u{1b}[2J\u{7}\u{9b}\u{7f}");
        assert_eq!(printable("a\nb\u{fffe}\u{ffff}\u{202e}"), r"a\nb\u{fffe}\u{ffff}\u{202e}");
        assert_eq!(printable_lines("a\nb\rc"), "a\nb\\rc");
        for text in ["Über ψ(t) \u{1F600} <&>\"'", ""] {
            assert!(matches!(printable(text), Cow::Borrowed(same) if same == text));
        }
    }
}
