//! Colours, sizes and texts that the plots share.

use plotters::style::{Color, FontDesc, FontFamily, FontStyle, RGBColor, ShapeStyle};

/// Told apart by the colour-blind, and from black, which is for what is predicted: Okabe and Ito without
/// yellow, then Tol's muted set.
const PALETTE: [RGBColor; 12] = [
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0xD5, 0x5E, 0x00),
    RGBColor(0x00, 0x9E, 0x73),
    RGBColor(0xCC, 0x79, 0xA7),
    RGBColor(0x56, 0xB4, 0xE9),
    RGBColor(0xE6, 0x9F, 0x00),
    RGBColor(0x33, 0x22, 0x88),
    RGBColor(0x88, 0x22, 0x55),
    RGBColor(0x11, 0x77, 0x33),
    RGBColor(0x44, 0xAA, 0x99),
    RGBColor(0xAA, 0x44, 0x99),
    RGBColor(0x99, 0x99, 0x33),
];

/// Most nodes that get a colour or a panel of their own.
pub(super) const NODES: usize = PALETTE.len();

pub(super) const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
pub(super) const FAINT: RGBColor = RGBColor(0xE4, 0xE4, 0xE4);
pub(super) const CROWD: RGBColor = RGBColor(0x7F, 0x9F, 0xBF);
pub(super) const BOUNDARY: RGBColor = RGBColor(0x80, 0x80, 0x80);
pub(super) const BREACH: RGBColor = RGBColor(0xCC, 0x00, 0x11);
pub(super) const INSIDE: RGBColor = RGBColor(0xEC, 0xEF, 0xF2);

/// The colour of the node at `index` among those shown.
pub(super) fn colour(index: usize) -> RGBColor {
    PALETTE[index % NODES]
}

/// Units of the drawing per pixel: plotters rounds coordinates to whole units, which shows at one per pixel.
const FINE: u32 = 5;

/// A length in pixels, in units of the drawing.
pub(super) const fn px(length: u32) -> u32 {
    length * FINE
}

/// The position `(x, y)` in pixels, in units of the drawing.
pub(super) const fn at(x: i32, y: i32) -> (i32, i32) {
    (x * FINE as i32, y * FINE as i32)
}

/// Gives a drawing of `(px(width), px(height))` units its size in pixels.
pub(super) fn shrink(mut svg: String, (width, height): (u32, u32)) -> String {
    let fine = format!("width=\"{}\" height=\"{}\"", px(width), px(height));
    if let Some(at) = svg.find(&fine) {
        svg.replace_range(at..at + fine.len(), &format!("width=\"{width}\" height=\"{height}\""));
    }
    svg
}

/// A line of this colour and width in pixels.
pub(super) fn line(colour: RGBColor, width: u32) -> ShapeStyle {
    colour.stroke_width(px(width))
}

/// The plots' font, in pixels.
pub(super) fn font(size: u32) -> FontDesc<'static> {
    FontDesc::new(FontFamily::SansSerif, f64::from(px(size)), FontStyle::Normal)
}
