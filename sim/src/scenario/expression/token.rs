//! The words of an expression.

use super::ExpressionError;

/// A word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Token<'t> {
    Number(f64),
    Name(&'t str),
    /// One of `+ - * / ^ ( ) ,`.
    Sign(char),
    End,
}

impl Token<'_> {
    /// How a message names it.
    pub fn text(self) -> String {
        match self {
            Self::Number(number) => format!("the number {number}"),
            Self::Name(name) => format!("the name '{name}'"),
            Self::Sign(sign) => format!("'{sign}'"),
            Self::End => "the end".to_owned(),
        }
    }
}

/// The words of a text one after the other, each with its column, in characters from 1.
pub(super) struct Tokens<'t> {
    rest: &'t str,
    column: usize,
}

impl<'t> Tokens<'t> {
    pub fn of(text: &'t str) -> Self {
        Self { rest: text, column: 1 }
    }

    /// The next word; [`Token::End`] again and again after the last one.
    pub fn next(&mut self) -> Result<(Token<'t>, usize), ExpressionError> {
        let spaces = self.rest.len() - self.rest.trim_start().len();
        self.take(spaces);
        let at = self.column;
        let Some(first) = self.rest.chars().next() else { return Ok((Token::End, at)) };
        if first.is_ascii_digit() || first == '.' {
            let length = number_length(self.rest);
            let word = self.take(length);
            let number =
                word.parse().map_err(|_| ExpressionError::new(at, format!("'{word}' is no number")))?;
            return Ok((Token::Number(number), at));
        }
        if first.is_alphabetic() || first == '_' {
            let is_name = |c: char| c.is_alphanumeric() || c == '_';
            let length = self.rest.find(|c| !is_name(c)).unwrap_or(self.rest.len());
            return Ok((Token::Name(self.take(length)), at));
        }
        if "+-*/^(),".contains(first) {
            self.take(first.len_utf8());
            return Ok((Token::Sign(first), at));
        }
        let message = format!(
            "'{first}' means nothing here; operators are + - * / ^, arguments are in ( ) and separated by ,"
        );
        Err(ExpressionError::new(at, message))
    }

    fn take(&mut self, length: usize) -> &'t str {
        let (word, rest) = self.rest.split_at(length);
        self.rest = rest;
        self.column += word.chars().count();
        word
    }
}

/// Bytes of the number that a text begins with: digits, a point, and an exponent where one follows.
fn number_length(text: &str) -> usize {
    let digits = |from: usize| {
        text[from..].find(|c: char| !c.is_ascii_digit()).map_or(text.len(), |length| from + length)
    };
    let mut end = digits(0);
    if text[end..].starts_with('.') {
        end = digits(end + 1);
    }
    if text[end..].starts_with(['e', 'E']) {
        let sign = usize::from(text[end + 1..].starts_with(['+', '-']));
        let exponent = digits(end + 1 + sign);
        if exponent > end + 1 + sign {
            end = exponent;
        }
    }
    end
}
