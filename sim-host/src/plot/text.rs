//! Text of users in a picture: what XML cannot hold, and what a reader cannot see, never gets there.

/// `text` on one line and without control characters. Each that is taken out leaves a U+FFFD, so that it
/// shows.
pub(super) fn plain(text: &str) -> String {
    let fit = |c: char| match c {
        '\t' | '\n' | '\r' => ' ',
        _ if is_unfit(c) => char::REPLACEMENT_CHARACTER,
        _ => c,
    };
    text.chars().map(fit).collect()
}

/// Control characters, characters that turn the direction of the text around them, and what is no character
/// at all.
fn is_unfit(c: char) -> bool {
    let turns =
        matches!(c, '\u{061C}' | '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}');
    let breaks = matches!(c, '\u{2028}' | '\u{2029}');
    let none = u32::from(c) & 0xFFFE == 0xFFFE || matches!(c, '\u{FDD0}'..='\u{FDEF}');
    c.is_control() || turns || breaks || none
}

/// As much of `text` as a line of `width` pixels holds in a font of `size`; three dots stand for the rest.
pub(super) fn fit(text: &str, size: u32, width: u32) -> String {
    let room = f64::from(width) / (0.45 * f64::from(size));
    let mut used = 0.0;
    let mut ends = text.char_indices().filter(|&(_, c)| {
        used += if u32::from(c) < 0x1100 { 1.0 } else { 2.0 };
        used > room
    });
    match ends.next() {
        None => text.to_owned(),
        Some((end, _)) => format!("{}\u{2026}", text[..end].trim_end()),
    }
}

/// The width of `text` in a font of `size`, in pixels, about.
pub(super) fn width(text: &str, size: u32) -> u32 {
    (0.45 * f64::from(size) * text.chars().count() as f64) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_seen_becomes_a_sign_that_can() {
        let text = plain("a\tb\u{1b}[2J\u{7f}\u{85}\u{FFFE}\u{202E}<&>\u{e9}");
        assert_eq!(text, "a b\u{FFFD}[2J\u{FFFD}\u{FFFD}\u{FFFD}\u{FFFD}<&>\u{e9}");
    }

    #[test]
    fn a_long_line_ends_in_dots() {
        assert_eq!(fit("short", 20, 200), "short");
        let cut = fit(&"word ".repeat(100), 20, 200);
        assert!(cut.ends_with("word\u{2026}") || cut.ends_with("wo\u{2026}"), "{cut}");
        assert!(width(&cut, 20) <= 210, "{cut}");
    }
}
