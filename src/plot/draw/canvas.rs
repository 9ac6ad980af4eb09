//! Strokes, fills and text in points, on a bitmap or in an SVG.
//!
//! Bitmaps are drawn at four times the size and averaged, because plotters antialiases only thin
//! lines. Their text is drawn afterwards at the final size by [`Letterer`], because plotters
//! ignores side bearings ("FF J4"), and averaged letters would be blurred. An SVG keeps text as
//! text.

use std::cell::RefCell;

use plotters::coord::Shift;
use plotters::prelude::{
    Circle, Color, DrawingArea, DrawingBackend, PathElement, Polygon, RGBColor, Rectangle,
    ShapeStyle, Text,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontDesc, FontFamily, FontStyle, TextStyle};

use crate::figure::Dash;
use crate::palette::{Rgb, Theme};
use crate::{Error, INK, Letterer};

/// The font families in an SVG; the viewer uses the first that it has.
const FAMILY: &str = "Noto Sans, DejaVu Sans, Helvetica, Arial, sans-serif";
/// Height of a panel's title, points.
pub(super) const HEAD: f64 = 12.5;
/// Height of names and legends, points.
pub(super) const LABEL: f64 = 11.5;
/// Height of numbers along an axis, points.
pub(super) const TICK: f64 = 10.5;
/// Drawn units per point.
pub(super) const UNITS: u32 = 4;
/// Units averaged into one pixel.
pub(super) const SMOOTH: u32 = 2;

pub(super) type Area<'a, DB> = DrawingArea<DB, Shift>;

/// A rectangle in points.
#[derive(Clone, Copy)]
pub(super) struct Rect {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) w: f64,
    pub(super) h: f64,
}

fn font_of(px: f64, bold: bool) -> FontDesc<'static> {
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    FontDesc::new(FontFamily::Name(FAMILY), px * f64::from(UNITS), style)
}

pub(super) fn text_width(letterer: &Letterer, text: &str, px: f64, bold: bool) -> f64 {
    f64::from(letterer.width(text, bold, px as f32))
}

/// A line of text that is drawn at the final size.
pub(super) struct Lettering {
    text: String,
    /// Points.
    at: (f64, f64),
    px: f64,
    bold: bool,
    color: Rgb,
    pos: (HPos, VPos),
}

impl Lettering {
    pub(super) fn draw(&self, letterer: &Letterer, rgb: &mut [u8], size: (usize, usize)) {
        let k = f64::from(UNITS / SMOOTH);
        let em = (self.px * k) as f32;
        let width = letterer.width(&self.text, self.bold, em);
        let x = (self.at.0 * k) as f32
            - match self.pos.0 {
                HPos::Left => 0.0,
                HPos::Center => 0.5 * width,
                HPos::Right => width,
            };
        // The middle of a line is that of its small letters with ascenders, about 0.35 em up.
        let y = (self.at.1 * k) as f32
            + match self.pos.1 {
                VPos::Top => 0.75 * em,
                VPos::Center => 0.35 * em,
                VPos::Bottom => -0.18 * em,
            };
        letterer.draw(&self.text, self.bold, em, (x, y), |x, y, cover| {
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
            if x >= size.0 || y >= size.1 {
                return;
            }
            for (p, c) in rgb[3 * (y * size.0 + x)..][..3].iter_mut().zip(self.color) {
                *p = (f32::from(*p) + (f32::from(c) - f32::from(*p)) * cover).round() as u8;
            }
        });
    }
}

/// Draws in points.
pub(super) struct Canvas<'a, DB: DrawingBackend> {
    pub(super) area: &'a Area<'a, DB>,
    pub(super) letterer: &'a Letterer,
    /// The text of a bitmap; `None` for an SVG.
    pub(super) texts: Option<&'a RefCell<Vec<Lettering>>>,
    pub(super) theme: Theme,
}

pub(super) fn rgb(c: Rgb) -> RGBColor {
    RGBColor(c[0], c[1], c[2])
}

fn at(p: (f64, f64)) -> (i32, i32) {
    let k = f64::from(UNITS);
    ((p.0 * k).round() as i32, (p.1 * k).round() as i32)
}

impl<DB: DrawingBackend> Canvas<'_, DB> {
    fn stroke(c: Rgb, opacity: f64, width: f64) -> ShapeStyle {
        let width = (width * f64::from(UNITS)).round().max(1.0) as u32;
        rgb(c).mix(opacity).stroke_width(width)
    }

    pub(super) fn line(
        &self,
        points: &[(f64, f64)],
        c: Rgb,
        opacity: f64,
        width: f64,
    ) -> Result<(), Error> {
        let path: Vec<_> = points.iter().map(|p| at(*p)).collect();
        let style = Self::stroke(c, opacity, width);
        if self.texts.is_none() || path.len() < 3 {
            return self.area.draw(&PathElement::new(path, style)).map_err(Error::draw);
        }
        // The bitmap backend fills the outline of a thick path by the even-odd rule, which leaves
        // holes where the path crosses itself. So it is drawn piece by piece, with round joints.
        let joint = (0.42 * width * f64::from(UNITS)).round() as i32;
        for pair in path.windows(2) {
            self.area.draw(&PathElement::new(pair.to_vec(), style)).map_err(Error::draw)?;
        }
        for p in &path[1..path.len() - 1] {
            let dot = Circle::new(*p, joint, rgb(c).mix(opacity).filled());
            self.area.draw(&dot).map_err(Error::draw)?;
        }
        Ok(())
    }

    pub(super) fn fill(&self, points: &[(f64, f64)], c: Rgb, opacity: f64) -> Result<(), Error> {
        let path: Vec<_> = points.iter().map(|p| at(*p)).collect();
        self.area.draw(&Polygon::new(path, rgb(c).mix(opacity).filled())).map_err(Error::draw)
    }

    pub(super) fn rect(&self, r: Rect, c: Rgb, opacity: f64) -> Result<(), Error> {
        let corners = [at((r.x, r.y)), at((r.x + r.w, r.y + r.h))];
        self.area.draw(&Rectangle::new(corners, rgb(c).mix(opacity).filled())).map_err(Error::draw)
    }

    pub(super) fn dot(&self, p: (f64, f64), radius: f64, c: Rgb) -> Result<(), Error> {
        let radius = (radius * f64::from(UNITS)).round() as i32;
        self.area.draw(&Circle::new(at(p), radius, rgb(c).filled())).map_err(Error::draw)
    }

    pub(super) fn cross(&self, p: (f64, f64), half: f64, c: Rgb, width: f64) -> Result<(), Error> {
        self.line(&[(p.0 - half, p.1 - half), (p.0 + half, p.1 + half)], c, 1.0, width)?;
        self.line(&[(p.0 - half, p.1 + half), (p.0 + half, p.1 - half)], c, 1.0, width)
    }

    pub(super) fn text(
        &self,
        text: &str,
        p: (f64, f64),
        px: f64,
        bold: bool,
        c: Rgb,
        pos: (HPos, VPos),
    ) -> Result<(), Error> {
        if text.is_empty() {
            return Ok(());
        }
        if let Some(texts) = self.texts {
            texts.borrow_mut().push(Lettering {
                text: text.to_owned(),
                at: p,
                px,
                bold,
                color: c,
                pos,
            });
            return Ok(());
        }
        let ink = rgb(c);
        let style = TextStyle::from(font_of(px, bold)).color(&ink).pos(Pos::new(pos.0, pos.1));
        self.area.draw(&Text::new(text.to_owned(), at(p), style)).map_err(Error::draw)
    }

    /// A polyline in a pattern.
    pub(super) fn path(
        &self,
        points: &[(f64, f64)],
        c: Rgb,
        width: f64,
        dash: Dash,
    ) -> Result<(), Error> {
        let (on, off) = match dash {
            Dash::Solid => return self.line(points, c, 1.0, width),
            Dash::Dashed => (5.5, 3.5),
            Dash::Dotted => (1.5, 2.8),
        };
        let mut piece = Vec::new();
        let (mut left, mut drawing) = (on, true);
        for w in points.windows(2) {
            let &[mut a, b] = w else { continue };
            if piece.is_empty() && drawing {
                piece.push(a);
            }
            let mut length = (b.0 - a.0).hypot(b.1 - a.1);
            while length > left {
                let share = left / length;
                a = (a.0 + (b.0 - a.0) * share, a.1 + (b.1 - a.1) * share);
                length -= left;
                if drawing {
                    piece.push(a);
                    self.line(&piece, c, 1.0, width)?;
                    piece.clear();
                } else {
                    piece.push(a);
                }
                drawing = !drawing;
                left = if drawing { on } else { off };
            }
            left -= length;
            if drawing {
                piece.push(b);
            }
        }
        if drawing && piece.len() > 1 { self.line(&piece, c, 1.0, width) } else { Ok(()) }
    }

    /// Diagonal strokes across a rectangle.
    pub(super) fn hatch(&self, r: Rect, c: Rgb) -> Result<(), Error> {
        self.rect(r, c, 0.28)?;
        let gap = 5.0;
        let mut k = ((r.x - r.h) / gap).floor() * gap;
        while k < r.x + r.w {
            // x - k runs with (r.y + r.h - y): clip both ends to the rectangle.
            let from = (r.x - k).max(0.0);
            let to = (r.x + r.w - k).min(r.h);
            if to > from {
                self.line(&[(k + from, r.y + r.h - from), (k + to, r.y + r.h - to)], c, 0.9, 0.7)?;
            }
            k += gap;
        }
        Ok(())
    }

    /// The last number is the text colour, for a command beside motions of many colours.
    pub(super) fn color(&self, i: usize) -> Rgb {
        if i == INK { self.theme.ink() } else { self.theme.line(i) }
    }
}
