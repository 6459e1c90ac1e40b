//! A picture of a folder inside a page: only the shapes and words that the plots of this program are made of get through.
//!
//! A file may have been changed by anybody. What draws nothing (a script, a link, a style, a reference to another file) keeps the whole picture out.

use quick_xml::Reader;
use quick_xml::escape::{escape, unescape};
use quick_xml::events::{BytesStart, Event};
use std::fmt::Write as _;

/// Elements that draw.
const ELEMENTS: [&str; 10] =
    ["svg", "g", "rect", "text", "polyline", "polygon", "line", "circle", "path", "ellipse"];
/// Attributes that say where and how. Those of colours can be set by the page, for a dark one.
const ATTRIBUTES: [&str; 30] = [
    "x",
    "y",
    "x1",
    "y1",
    "x2",
    "y2",
    "cx",
    "cy",
    "r",
    "rx",
    "ry",
    "width",
    "height",
    "points",
    "d",
    "fill",
    "stroke",
    "stroke-width",
    "opacity",
    "fill-opacity",
    "stroke-opacity",
    "font-family",
    "font-size",
    "font-style",
    "font-weight",
    "text-anchor",
    "dx",
    "dy",
    "transform",
    "viewBox",
];
/// Deeper than any plot.
const DEEPEST: usize = 8;
/// Plots that are wider have several panels beside each other, and need more room to be read.
const WIDE: f64 = 5500.0;

/// The picture for a page, named and described by the element with the id `described_by`.
///
/// # Errors
/// It is no picture of this program, in words.
pub(super) fn inline(svg: &str, described_by: &str) -> Result<String, String> {
    let mut out = String::with_capacity(svg.len());
    let mut reader = Reader::from_str(svg);
    let (mut open, mut drawn): (Vec<String>, bool) = (Vec::new(), false);
    loop {
        match reader.read_event().map_err(|error| format!("is no SVG: {error}"))? {
            Event::Eof if open.is_empty() && drawn => return Ok(out),
            Event::Eof => return Err("is no whole SVG".to_owned()),
            Event::Decl(_) if !drawn => {}
            Event::Start(start) => {
                if open.is_empty() && drawn || open.len() == DEEPEST {
                    return Err("is no plot of this program".to_owned());
                }
                open.push(element(&mut out, &start, open.is_empty().then_some(described_by), false)?);
                drawn = true;
            }
            Event::Empty(start) if !open.is_empty() => drop(element(&mut out, &start, None, true)?),
            Event::End(_) => {
                // The reader has checked that it ends what is open.
                if let Some(name) = open.pop() {
                    let _ = write!(out, "</{name}>");
                }
            }
            Event::Text(text) => {
                let text = text.decode().map_err(|error| format!("is no SVG: {error}"))?;
                match open.last().is_some_and(|name| name == "text") {
                    // Plots begin and end a text with a new line; spaces beside an escaped character are its own.
                    true => out.push_str(&escape(text.replace(['\n', '\r'], ""))),
                    false if text.trim().is_empty() => {}
                    false => return Err("has words outside of its texts".to_owned()),
                }
            }
            Event::GeneralRef(reference) if open.last().is_some_and(|name| name == "text") => {
                let name = reference.decode().map_err(|error| format!("is no SVG: {error}"))?;
                let reference = format!("&{name};");
                let character = unescape(&reference).map_err(|error| format!("is no SVG: {error}"))?;
                out.push_str(&escape(character));
            }
            _ => return Err("has more than shapes and words".to_owned()),
        }
    }
}

/// Writes the begin of an element; `described_by` makes it the picture itself. Gives its name.
fn element(
    out: &mut String,
    start: &BytesStart<'_>,
    described_by: Option<&str>,
    ends: bool,
) -> Result<String, String> {
    let name = String::from_utf8_lossy(start.name().as_ref()).into_owned();
    let is_picture = name == "svg";
    if !ELEMENTS.contains(&name.as_str()) || is_picture != described_by.is_some() {
        return Err(format!("has an element '{}', which no plot has", crate::printable::printable(&name)));
    }
    let points = start.try_get_attribute("points").ok().flatten().filter(|_| name == "polyline");
    let points = points.and_then(|points| steps(&String::from_utf8_lossy(&points.value)));
    let name = if points.is_some() { "path".to_owned() } else { name };
    // Writing to a string does not fail.
    let _ = write!(out, "<{name}");
    if let Some(points) = &points {
        let _ = write!(out, " d=\"{points}\"");
    }
    if let Some(id) = described_by {
        let class = if width(start) > WIDE { "plot sheet" } else { "plot" };
        let _ = write!(out, " class=\"{class}\" role=\"img\" aria-labelledby=\"{}\"", escape(id));
    }
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|error| format!("is no SVG: {error}"))?;
        let key = String::from_utf8_lossy(attribute.key.as_ref()).into_owned();
        let value = String::from_utf8_lossy(&attribute.value).into_owned();
        let value = unescape(&value).map_err(|error| format!("is no SVG: {error}"))?.into_owned();
        // The page makes it as wide as it has room.
        if is_picture && key != "viewBox" || points.is_some() && key == "points" {
            continue;
        }
        if !ATTRIBUTES.contains(&key.as_str()) || value.contains("url(") || value.contains(':') {
            return Err(format!(
                "has an attribute '{}', which no plot has",
                crate::printable::printable(&key)
            ));
        }
        // As drawn without it.
        if key == "opacity" && value == "1" {
            continue;
        }
        let _ = write!(out, " {key}=\"{}\"", escape(value));
    }
    out.push_str(if ends { "/>" } else { ">" });
    Ok(name)
}

/// The width of a picture in the units of its shapes; 0 where it does not say.
fn width(start: &BytesStart<'_>) -> f64 {
    let view = start.try_get_attribute("viewBox").ok().flatten();
    let view = view.map(|view| String::from_utf8_lossy(&view.value).into_owned()).unwrap_or_default();
    view.split_ascii_whitespace().nth(2).and_then(|width| width.parse().ok()).unwrap_or(0.0)
}

/// The same line as `points` of whole numbers, by its steps: that takes a third of the room. `None` for other points.
fn steps(points: &str) -> Option<String> {
    let (mut out, mut last) = (String::new(), None);
    for point in points.split_ascii_whitespace() {
        let (x, y) = point.split_once(',')?;
        let (x, y): (i32, i32) = (x.parse().ok()?, y.parse().ok()?);
        let (letter, dx, dy) = match last {
            None => ("M", x, y),
            Some((from_x, from_y, is_second)) => {
                (if is_second { "l" } else { "" }, x.checked_sub(from_x)?, y.checked_sub(from_y)?)
            }
        };
        // A minus sign or a letter separates as well as a space.
        let space = |number: i32, before: &str| if number < 0 || !before.is_empty() { "" } else { " " };
        let _ = write!(out, "{letter}{}{dx}{}{dy}", space(dx, letter), space(dy, ""));
        last = Some((x, y, last.is_none()));
    }
    last.map(|_| out)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLOT: &str = "<svg width=\"10\" height=\"5\" viewBox=\"0 0 50 25\" xmlns=\"http://www.w3.org/2000/svg\">\n\
        <rect x=\"0\" y=\"0\" width=\"50\" height=\"25\" opacity=\"1\" fill=\"#FFFFFF\" stroke=\"none\"/>\n\
        <text x=\"1\" y=\"2\" fill=\"#222222\">\na &lt;b&gt; &amp; c\n</text>\n</svg>\n";

    #[test]
    fn a_plot_gets_through_as_wide_as_the_page_and_its_words_stay_words() {
        assert_eq!(
            inline(PLOT, "states").unwrap(),
            "<svg class=\"plot\" role=\"img\" aria-labelledby=\"states\" viewBox=\"0 0 50 25\">\
             <rect x=\"0\" y=\"0\" width=\"50\" height=\"25\" fill=\"#FFFFFF\" stroke=\"none\"/>\
             <text x=\"1\" y=\"2\" fill=\"#222222\">a &lt;b&gt; &amp; c</text></svg>"
        );
    }

    #[test]
    fn a_line_is_written_by_its_steps() {
        assert_eq!(steps("380,2329 388,2300 389,2300 380,2310 ").unwrap(), "M380 2329l8-29 1 0-9 10");
        assert_eq!(steps("-5,7").unwrap(), "M-5 7");
        for other in ["", "1.5,2", "1", "a,b", "-2147483648,0 2147483647,0"] {
            assert_eq!(steps(other), None, "{other}");
        }
        let text = PLOT.replace("</svg>", "<polyline stroke=\"#222222\" points=\"1,2 3,4 \"/></svg>");
        let inlined = inline(&text, "a").unwrap();
        assert!(inlined.ends_with("<path d=\"M1 2l2 2\" stroke=\"#222222\"/></svg>"), "{inlined}");
    }

    #[test]
    fn what_does_something_else_than_draw_keeps_the_picture_out() {
        for bad in [
            "<script>alert(1)</script>",
            "<g onload=\"alert(1)\"></g>",
            "<image href=\"http://example.org/a.png\"/>",
            "<a href=\"x\"><text>a</text></a>",
            "<style>@import 'x'</style>",
            "<rect fill=\"url(#a)\"/>",
            "<rect fill=\"url(http://example.org)\"/>",
            "<foreignObject><body/></foreignObject>",
            "<svg></svg>",
            "<!-- <b> -->",
            "<![CDATA[<script>]]>",
            "<?php ?>",
            "words",
        ] {
            let text = PLOT.replace("</svg>", &format!("{bad}</svg>"));
            assert!(inline(&text, "a").is_err(), "{bad}");
        }
        for whole in
            ["", "words", "<svg>", "<html></html>", "<svg></svg><svg></svg>", "<!DOCTYPE svg><svg></svg>"]
        {
            assert!(inline(whole, "a").is_err(), "{whole}");
        }
    }
}
