//! Reads a page as a browser does, and says what is wrong with it.

use html5ever::tendril::StrTendril;
use html5ever::tokenizer::states::RawKind;
use html5ever::tokenizer::{
    BufferQueue, Tag, TagKind, Token, TokenSink, TokenSinkResult, Tokenizer, TokenizerOpts,
};
use std::cell::RefCell;

/// Elements that have no end.
const VOID: [&str; 6] = ["meta", "link", "br", "hr", "img", "input"];
/// Elements that load something or run.
const ACTIVE: [&str; 12] = [
    "script",
    "link",
    "img",
    "iframe",
    "object",
    "embed",
    "image",
    "use",
    "a",
    "form",
    "base",
    "foreignobject",
];
/// Attributes that name another file.
const REFERENCES: [&str; 8] =
    ["href", "src", "xlink:href", "srcset", "action", "data", "background", "poster"];

/// A start tag.
#[derive(Clone, Debug)]
pub struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    /// The text directly in it.
    pub text: String,
}

impl Element {
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }
}

/// A page as it was read.
#[derive(Debug, Default)]
pub struct Page {
    pub elements: Vec<Element>,
    /// What is no HTML, or not whole.
    pub errors: Vec<String>,
    /// Places of the elements that are open.
    open: Vec<usize>,
}

#[derive(Default)]
struct Sink(RefCell<Page>);

impl Page {
    pub fn read(html: &str) -> Self {
        let tokenizer =
            Tokenizer::new(Sink::default(), TokenizerOpts { exact_errors: true, ..TokenizerOpts::default() });
        let input = BufferQueue::default();
        input.push_back(StrTendril::from(html));
        while !matches!(tokenizer.feed(&input), html5ever::TokenizerResult::Done) {}
        tokenizer.end();
        let mut page = tokenizer.sink.0.into_inner();
        for &at in &page.open {
            page.errors.push(format!("<{}> has no end", page.elements[at].name));
        }
        page
    }

    pub fn named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> {
        self.elements.iter().filter(move |element| element.name == name)
    }

    /// All text of the page.
    pub fn text(&self) -> String {
        let shown =
            self.elements.iter().filter(|element| !["style", "script"].contains(&element.name.as_str()));
        shown.map(|element| element.text.as_str()).collect::<Vec<_>>().join("\n")
    }

    /// What a page to hand over must not have: errors, anything that loads or runs, pictures without words, tables without a name.
    pub fn faults(&self, scripts: usize) -> Vec<String> {
        let mut faults = self.errors.clone();
        let active: Vec<_> =
            self.elements.iter().filter(|element| ACTIVE.contains(&element.name.as_str())).collect();
        if active.len() != scripts {
            faults.push(format!("{} active elements: {active:?}", active.len()));
        }
        for element in &self.elements {
            for (key, value) in &element.attributes {
                if REFERENCES.contains(&key.as_str()) || key.starts_with("on") || value.contains("url(") {
                    faults.push(format!("<{} {key}={value}>", element.name));
                }
            }
        }
        for style in
            self.named("style").filter(|style| style.text.contains("url(") || style.text.contains("@import"))
        {
            faults.push(format!("a style that loads: {}", style.text));
        }
        let has_words = |id: &str| {
            self.elements
                .iter()
                .any(|element| element.attribute("id") == Some(id) && element.text.trim().len() > 20)
        };
        for svg in self.named("svg") {
            if svg.attribute("role") != Some("img")
                || !svg.attribute("aria-labelledby").is_some_and(has_words)
            {
                faults.push("a picture without words".to_owned());
            }
        }
        if self.named("table").count() != self.named("caption").count() {
            faults.push("a table without a caption".to_owned());
        }
        let mut ids: Vec<_> = self.elements.iter().filter_map(|element| element.attribute("id")).collect();
        ids.sort_unstable();
        faults.extend(
            ids.windows(2)
                .filter(|pair| pair[0] == pair[1])
                .map(|pair| format!("two elements are {}", pair[0])),
        );
        faults
    }
}

impl TokenSink for Sink {
    type Handle = ();

    fn process_token(&self, token: Token, line: u64) -> TokenSinkResult<()> {
        let mut page = self.0.borrow_mut();
        match token {
            Token::TagToken(tag) => return page.tag(&tag, line),
            Token::CharacterTokens(text) => {
                if let Some(&at) = page.open.last() {
                    page.elements[at].text.push_str(&text);
                }
            }
            Token::ParseError(error) => page.errors.push(format!("line {line}: {error}")),
            Token::NullCharacterToken => page.errors.push(format!("line {line}: a null character")),
            Token::DoctypeToken(_) | Token::CommentToken(_) | Token::EOFToken => {}
        }
        TokenSinkResult::Continue
    }
}

impl Page {
    fn tag(&mut self, tag: &Tag, line: u64) -> TokenSinkResult<()> {
        let name = tag.name.to_string();
        if tag.kind == TagKind::EndTag {
            let open = self.open.pop().map(|at| self.elements[at].name.clone());
            if open.as_deref() != Some(name.as_str()) {
                self.errors.push(format!("line {line}: </{name}> ends {open:?}"));
            }
            return TokenSinkResult::Continue;
        }
        let attribute = |attribute: &html5ever::Attribute| {
            (attribute.name.local.to_string(), attribute.value.to_string())
        };
        let attributes = tag.attrs.iter().map(attribute).collect();
        self.elements.push(Element { name: name.clone(), attributes, text: String::new() });
        if !tag.self_closing && !VOID.contains(&name.as_str()) {
            self.open.push(self.elements.len() - 1);
        }
        match name.as_str() {
            "script" => TokenSinkResult::RawData(RawKind::ScriptData),
            "style" => TokenSinkResult::RawData(RawKind::Rawtext),
            "title" => TokenSinkResult::RawData(RawKind::Rcdata),
            _ => TokenSinkResult::Continue,
        }
    }
}
