//! From a text to a tree: operator precedence by binding power (V. R. Pratt, POPL 1973).
//!
//! Written by hand, in 150 lines: what users see of a parser is its messages, and a combinator library
//! (winnow is there, below `toml`) gives where it stopped, not what would have been right.

use super::ExpressionError;
use super::syntax::{Binary, FUNCTIONS, Function, Kind, Term};
use super::token::{Token, Tokens};

/// Brackets, signs and functions inside one another.
const DEEPEST: usize = 64;
/// How strongly a sign before a term binds: more than `*`, less than `^`.
const SIGN: u8 = 5;

/// Names that stand for something.
#[derive(Clone, Copy)]
pub(super) struct Names<'n> {
    /// Components of the state.
    pub components: usize,
    /// Inputs from outside.
    pub inputs: &'n [String],
}

pub(super) fn parse(text: &str, names: Names<'_>) -> Result<Term, ExpressionError> {
    let mut tokens = Tokens::of(text);
    let (token, at) = tokens.next()?;
    let mut parser = Parser { tokens, token, at, names, depth: 0 };
    let term = parser.term(0)?;
    match parser.token {
        Token::End => Ok(term),
        Token::Sign(')') => Err(parser.error("this ) closes nothing".to_owned())),
        found => Err(parser.expected("an operator (+ - * / ^) or the end", found)),
    }
}

struct Parser<'t, 'n> {
    tokens: Tokens<'t>,
    /// The next word, and its column.
    token: Token<'t>,
    at: usize,
    names: Names<'n>,
    depth: usize,
}

impl<'t> Parser<'t, '_> {
    /// What binds at least so strongly.
    fn term(&mut self, least: u8) -> Result<Term, ExpressionError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self
                .error(format!("more than {DEEPEST} brackets, signs and functions are inside one another")));
        }
        let mut left = self.operand()?;
        while let Token::Sign(sign) = self.token {
            let Some((operator, own, of_right)) = operator(sign) else { break };
            if own < least {
                break;
            }
            let at = self.at;
            self.advance()?;
            let right = self.term(of_right)?;
            left = Term { at, kind: Kind::Binary(operator, Box::new(left), Box::new(right)) };
        }
        self.depth -= 1;
        Ok(left)
    }

    fn operand(&mut self) -> Result<Term, ExpressionError> {
        let (token, at) = (self.token, self.at);
        let term = |kind| Ok(Term { at, kind });
        match token {
            Token::Number(number) => {
                self.advance()?;
                term(Kind::Number(number))
            }
            Token::Name(name) => {
                self.advance()?;
                self.name(name, at)
            }
            Token::Sign('-') => {
                self.advance()?;
                let inner = self.term(SIGN)?;
                term(Kind::Negate(Box::new(inner)))
            }
            Token::Sign('(') => {
                self.advance()?;
                let inner = self.term(0)?;
                self.close(at)?;
                Ok(inner)
            }
            found => Err(self.expected("a number, a name, - or (", found)),
        }
    }

    /// What a name stands for.
    fn name(&mut self, name: &'t str, at: usize) -> Result<Term, ExpressionError> {
        if let Some(&(name, function, count)) = FUNCTIONS.iter().find(|entry| entry.0 == name) {
            return self.call(name, function, count, at);
        }
        let kind = match name {
            "pi" => Kind::Number(std::f64::consts::PI),
            "t" => Kind::Time,
            _ => self.variable(name).ok_or_else(|| self.unknown(name, at))?,
        };
        match self.token {
            Token::Sign('(') => Err(self.error(format!("{name} is no function; write {name}*( to multiply"))),
            _ => Ok(Term { at, kind }),
        }
    }

    fn variable(&self, name: &str) -> Option<Kind> {
        let Names { components, inputs } = self.names;
        if components == 1 && name == "x" {
            return Some(Kind::State(0));
        }
        let component = name.strip_prefix('x').and_then(|digits| digits.parse::<usize>().ok());
        if let Some(component) =
            component.filter(|number| components > 1 && (1..=components).contains(number))
        {
            return Some(Kind::State(component as u8 - 1));
        }
        inputs.iter().position(|input| input == name).map(|index| Kind::Input(index as u8))
    }

    fn unknown(&self, name: &str, at: usize) -> ExpressionError {
        let state = match self.names.components {
            1 => "x".to_owned(),
            2 => "x1, x2".to_owned(),
            count => format!("x1 to x{count}"),
        };
        let inputs = self.names.inputs.iter().map(|input| format!(", {input} (an input)"));
        let functions: Vec<_> = FUNCTIONS.iter().map(|entry| entry.0).collect();
        let known =
            format!("{state}, t, pi{}; functions {}", inputs.collect::<String>(), functions.join(" "));
        let near =
            functions.iter().chain(&["pi"]).find(|known| strsim::damerau_levenshtein(known, name) == 1);
        let hint = near.map_or(String::new(), |near| format!("; did you mean '{near}'?"));
        ExpressionError::new(at, format!("nothing is called '{name}'; known: {known}{hint}"))
    }

    fn call(
        &mut self,
        name: &str,
        function: Function,
        count: usize,
        at: usize,
    ) -> Result<Term, ExpressionError> {
        let open = self.at;
        if self.token != Token::Sign('(') {
            return Err(self.expected(&format!("( after {name}"), self.token));
        }
        self.advance()?;
        let mut arguments = vec![self.term(0)?];
        while self.token == Token::Sign(',') {
            self.advance()?;
            arguments.push(self.term(0)?);
        }
        self.close(open)?;
        if arguments.len() != count {
            let plural = if count == 1 { "argument" } else { "arguments" };
            let message = format!("{name} takes {count} {plural}; here are {}", arguments.len());
            return Err(ExpressionError::new(at, message));
        }
        Ok(Term { at, kind: Kind::Call(function, arguments) })
    }

    /// Takes the bracket that closes the one in column `open`.
    fn close(&mut self, open: usize) -> Result<(), ExpressionError> {
        match self.token {
            Token::Sign(')') => self.advance(),
            found => Err(self.expected(&format!("an operator or the ) of the ( in column {open}"), found)),
        }
    }

    fn advance(&mut self) -> Result<(), ExpressionError> {
        (self.token, self.at) = self.tokens.next()?;
        Ok(())
    }

    fn expected(&self, what: &str, found: Token<'_>) -> ExpressionError {
        self.error(format!("expected {what}, found {}", found.text()))
    }

    fn error(&self, message: String) -> ExpressionError {
        ExpressionError::new(self.at, message)
    }
}

/// An operator, how strongly it binds, and how strongly what is right of it has to.
fn operator(sign: char) -> Option<(Binary, u8, u8)> {
    Some(match sign {
        '+' => (Binary::Add, 1, 2),
        '-' => (Binary::Subtract, 1, 2),
        '*' => (Binary::Multiply, 3, 4),
        '/' => (Binary::Divide, 3, 4),
        // To the right: a^b^c is a^(b^c).
        '^' => (Binary::Power, 7, 6),
        _ => return None,
    })
}
