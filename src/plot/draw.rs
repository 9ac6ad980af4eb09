//! Lays out and draws a figure through plotters' bitmap and SVG backends.
//!
//! The axes are ours (plotters' own reserve fixed label areas and cannot hatch, break lines at
//! masks or share a legend between panels); its backends, shapes and font handling do the work.
//! Bitmaps are drawn at four times the size and averaged down: plotters smooths thin lines only.
//! Their text is set afterwards at the final size by [`Letterer`]: plotters ignores side bearings
//! ("FF J4"), and averaged letters would be soft. An SVG keeps text as text.

use std::cell::RefCell;

use plotters::backend::{BitMapBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::prelude::{
    Circle, Color, DrawingArea, DrawingBackend, IntoDrawingArea, PathElement, Polygon, RGBColor,
    Rectangle, ShapeStyle, Text,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontDesc, FontFamily, FontStyle, TextStyle};

use super::axis::Axis;
use super::figure::{Dash, Figure, Layer, Mark, Panel};
use super::palette::{Rgb, Theme};
use super::{Error, Letterer};

/// The family's name as it stands in an SVG: the viewer takes the first that it has.
const FAMILY: &str = "Noto Sans, DejaVu Sans, Helvetica, Arial, sans-serif";
/// Drawn units a point.
const UNITS: u32 = 4;
/// Units averaged into one pixel.
const SMOOTH: u32 = 2;
/// Points along one edge of a figure.
const POINTS: u32 = 6000;

const TITLE: f64 = 16.0;
const HEAD: f64 = 12.5;
const LABEL: f64 = 11.5;
const TICK: f64 = 10.5;
const MARGIN: f64 = 16.0;

/// A figure as PNG bytes.
pub(super) fn png(figure: &Figure) -> Result<Vec<u8>, Error> {
    let letterer = Letterer::default();
    let size = layout(figure, &letterer)?;
    let (w, h) = ((size.width * UNITS) as usize, (size.height * UNITS) as usize);
    let mut pixels = vec![0_u8; w * h * 3];
    let texts = RefCell::new(Vec::new());
    {
        let backend = BitMapBackend::with_buffer(&mut pixels, (w as u32, h as u32));
        render(figure, &size, &backend.into_drawing_area(), &letterer, Some(&texts))?;
    }
    let smooth = SMOOTH as usize;
    let (ow, oh) = (w / smooth, h / smooth);
    let mut out = Vec::with_capacity(ow * oh * 3);
    for y in 0..oh {
        for x in 0..ow {
            for c in 0..3 {
                let mut sum = 0_u32;
                for dy in 0..smooth {
                    for dx in 0..smooth {
                        sum += u32::from(pixels[3 * ((y * smooth + dy) * w + x * smooth + dx) + c]);
                    }
                }
                out.push(((sum + SMOOTH) / (SMOOTH * SMOOTH)) as u8);
            }
        }
    }
    for t in texts.into_inner() {
        t.draw(&letterer, &mut out, (ow, oh));
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, ow as u32, oh as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(Error::draw)?;
    writer.write_image_data(&out).map_err(Error::draw)?;
    writer.finish().map_err(Error::draw)?;
    Ok(bytes)
}

/// A figure as SVG text.
pub(super) fn svg(figure: &Figure) -> Result<String, Error> {
    let letterer = Letterer::default();
    let size = layout(figure, &letterer)?;
    let (w, h) = (size.width * UNITS, size.height * UNITS);
    let mut text = String::new();
    {
        let backend = SVGBackend::with_string(&mut text, (w, h));
        render(figure, &size, &backend.into_drawing_area(), &letterer, None)?;
    }
    // Drawn in quarter points, shown in points.
    let large = format!("width=\"{w}\" height=\"{h}\"");
    let shown = format!("width=\"{}\" height=\"{}\"", size.width, size.height);
    Ok(text.replacen(&large, &shown, 1))
}

type Area<'a, DB> = DrawingArea<DB, Shift>;

struct Size {
    width: u32,
    height: u32,
    /// Top of the panels.
    top: f64,
    legend: Vec<Entry>,
    rows: usize,
}

/// A legend entry.
#[derive(Clone, PartialEq)]
struct Entry {
    name: String,
    color: usize,
    /// Whether panels draw it in different colours: then the pattern is what it explains.
    varies: bool,
    sign: Sign,
}

#[derive(Clone, Copy, PartialEq)]
enum Sign {
    Line(Dash),
    Mark(Mark),
    Block,
    Hatch,
}

fn layout(figure: &Figure, letterer: &Letterer) -> Result<Size, Error> {
    if figure.panels.is_empty() {
        return Err(Error::Empty);
    }
    let columns = figure.columns.clamp(1, figure.panels.len());
    let rows = figure.panels.len().div_ceil(columns);
    let width = 2.0 * MARGIN + columns as f64 * f64::from(figure.panel.0);
    let legend = legend(figure);
    let mut top = MARGIN;
    if !figure.title.is_empty() {
        top += TITLE * 1.45;
    }
    if !figure.note.is_empty() {
        top += LABEL * 1.5;
    }
    let rows_of_legend = legend_rows(letterer, &legend, width - 2.0 * MARGIN);
    if rows_of_legend > 0 {
        top += rows_of_legend as f64 * LABEL * 1.7 + 7.0;
    }
    let height = top + rows as f64 * f64::from(figure.panel.1) + 0.6 * MARGIN;
    let (width, height) = (width.ceil() as u32, height.ceil() as u32);
    if width > POINTS || height > POINTS {
        return Err(Error::Large { width, height, cap: POINTS });
    }
    Ok(Size { width, height, top, legend, rows })
}

fn legend(figure: &Figure) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut add = |name: &str, color: usize, sign: Sign| {
        // The same name and pattern in several panels is one entry, whatever the colour there.
        if let Some(e) = entries.iter_mut().find(|e| e.name == name && e.sign == sign) {
            e.varies |= e.color != color;
        } else if !name.is_empty() {
            entries.push(Entry { name: name.to_owned(), color, varies: false, sign });
        }
    };
    for layer in figure.panels.iter().flat_map(|p| &p.layers) {
        match layer {
            Layer::Line { name, color, dash, .. } => add(name, *color, Sign::Line(*dash)),
            Layer::Marks { name, color, mark, .. } => add(name, *color, Sign::Mark(*mark)),
            Layer::Bars { name, color, .. } | Layer::Histogram { name, color, .. } => {
                add(name, *color, Sign::Block);
            }
            Layer::Masked { .. } => add("masked: no goal", super::INK, Sign::Hatch),
            Layer::Band { .. } | Layer::Cells { .. } | Layer::Level { .. } => {}
        }
    }
    entries.sort_by_key(|e| e.sign == Sign::Hatch);
    // One set of bars in one panel names itself by the axis.
    if entries.len() == 1 && figure.panels.len() == 1 && matches!(entries[0].sign, Sign::Block) {
        entries.clear();
    }
    entries
}

fn entry_width(letterer: &Letterer, e: &Entry) -> f64 {
    30.0 + text_width(letterer, &e.name, LABEL, false) + 18.0
}

fn legend_rows(letterer: &Letterer, legend: &[Entry], width: f64) -> usize {
    if legend.is_empty() {
        return 0;
    }
    let (mut rows, mut x) = (1, 0.0);
    for e in legend {
        let w = entry_width(letterer, e);
        if x > 0.0 && x + w > width {
            rows += 1;
            x = 0.0;
        }
        x += w;
    }
    rows
}

fn font_of(px: f64, bold: bool) -> FontDesc<'static> {
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    FontDesc::new(FontFamily::Name(FAMILY), px * f64::from(UNITS), style)
}

fn text_width(letterer: &Letterer, text: &str, px: f64, bold: bool) -> f64 {
    f64::from(letterer.width(text, bold, px as f32))
}

/// A line of text that waits for the final size.
struct Lettering {
    text: String,
    /// Points.
    at: (f64, f64),
    px: f64,
    bold: bool,
    color: Rgb,
    pos: (HPos, VPos),
}

impl Lettering {
    fn draw(&self, letterer: &Letterer, rgb: &mut [u8], size: (usize, usize)) {
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
struct Canvas<'a, DB: DrawingBackend> {
    area: &'a Area<'a, DB>,
    letterer: &'a Letterer,
    /// Where the text of a bitmap is kept; none in an SVG.
    texts: Option<&'a RefCell<Vec<Lettering>>>,
    theme: Theme,
}

fn rgb(c: Rgb) -> RGBColor {
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

    fn line(&self, points: &[(f64, f64)], c: Rgb, opacity: f64, width: f64) -> Result<(), Error> {
        let path: Vec<_> = points.iter().map(|p| at(*p)).collect();
        let style = Self::stroke(c, opacity, width);
        if self.texts.is_none() || path.len() < 3 {
            return self.area.draw(&PathElement::new(path, style)).map_err(Error::draw);
        }
        // The bitmap backend fills the outline of a thick path by even and odd: where it crosses
        // itself a hole would show. Piece by piece, with round joints, it does not.
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

    fn fill(&self, points: &[(f64, f64)], c: Rgb, opacity: f64) -> Result<(), Error> {
        let path: Vec<_> = points.iter().map(|p| at(*p)).collect();
        self.area.draw(&Polygon::new(path, rgb(c).mix(opacity).filled())).map_err(Error::draw)
    }

    fn rect(&self, r: Rect, c: Rgb, opacity: f64) -> Result<(), Error> {
        let corners = [at((r.x, r.y)), at((r.x + r.w, r.y + r.h))];
        self.area.draw(&Rectangle::new(corners, rgb(c).mix(opacity).filled())).map_err(Error::draw)
    }

    fn dot(&self, p: (f64, f64), radius: f64, c: Rgb) -> Result<(), Error> {
        let radius = (radius * f64::from(UNITS)).round() as i32;
        self.area.draw(&Circle::new(at(p), radius, rgb(c).filled())).map_err(Error::draw)
    }

    fn cross(&self, p: (f64, f64), half: f64, c: Rgb, width: f64) -> Result<(), Error> {
        self.line(&[(p.0 - half, p.1 - half), (p.0 + half, p.1 + half)], c, 1.0, width)?;
        self.line(&[(p.0 - half, p.1 + half), (p.0 + half, p.1 - half)], c, 1.0, width)
    }

    fn text(
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
    fn path(&self, points: &[(f64, f64)], c: Rgb, width: f64, dash: Dash) -> Result<(), Error> {
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
    fn hatch(&self, r: Rect, c: Rgb) -> Result<(), Error> {
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
}

#[derive(Clone, Copy)]
struct Rect {
    x: f64,
    y: f64,
    w: f64,
    h: f64,
}

fn render<DB: DrawingBackend>(
    figure: &Figure,
    size: &Size,
    area: &Area<'_, DB>,
    letterer: &Letterer,
    texts: Option<&RefCell<Vec<Lettering>>>,
) -> Result<(), Error> {
    let t = figure.theme;
    area.fill(&rgb(t.paper())).map_err(Error::draw)?;
    let canvas = Canvas { area, letterer, texts, theme: t };
    let mut y = MARGIN;
    let left = (HPos::Left, VPos::Center);
    if !figure.title.is_empty() {
        canvas.text(&figure.title, (MARGIN, y + 0.5 * TITLE), TITLE, true, t.ink(), left)?;
        y += TITLE * 1.45;
    }
    if !figure.note.is_empty() {
        canvas.text(&figure.note, (MARGIN, y + 0.4 * LABEL), LABEL, false, t.faint_ink(), left)?;
        y += LABEL * 1.5;
    }
    let mut x = 0.0;
    y += 0.8 * LABEL;
    for e in &size.legend {
        let w = entry_width(letterer, e);
        if x > 0.0 && x + w > f64::from(size.width) - 2.0 * MARGIN {
            x = 0.0;
            y += LABEL * 1.7;
        }
        canvas.entry(e, MARGIN + x, y)?;
        x += w;
    }
    let columns = figure.columns.clamp(1, figure.panels.len());
    let (w, h) = (f64::from(figure.panel.0), f64::from(figure.panel.1));
    for (i, panel) in figure.panels.iter().enumerate() {
        let (column, row) = (i % columns, i / columns);
        let r = Rect { x: MARGIN + w * column as f64, y: size.top + h * row as f64, w, h };
        let lowest = row + 1 == size.rows || i + columns >= figure.panels.len();
        canvas.panel(panel, r, lowest)?;
    }
    area.present().map_err(Error::draw)
}

/// From data to points on the paper.
struct Frame {
    rect: Rect,
    x: (f64, f64),
    y: (f64, f64),
    log: (bool, bool),
}

/// Both ends of what is left of a segment, and whether the second was inside.
type Cut = ((f64, f64), (f64, f64), bool);

impl Frame {
    fn share(v: f64, ends: (f64, f64), log: bool) -> f64 {
        if log {
            (v.max(1e-300).ln() - ends.0.ln()) / (ends.1.ln() - ends.0.ln())
        } else {
            (v - ends.0) / (ends.1 - ends.0)
        }
    }

    fn x(&self, v: f64) -> f64 {
        self.rect.x + self.rect.w * Self::share(v, self.x, self.log.0)
    }

    fn y(&self, v: f64) -> f64 {
        self.rect.y + self.rect.h * (1.0 - Self::share(v, self.y, self.log.1))
    }

    fn clamp_y(&self, y: f64) -> f64 {
        y.clamp(self.rect.y, self.rect.y + self.rect.h)
    }

    fn inside(&self, p: (f64, f64)) -> bool {
        let r = self.rect;
        let e = 0.5;
        p.0 >= r.x - e && p.0 <= r.x + r.w + e && p.1 >= r.y - e && p.1 <= r.y + r.h + e
    }

    /// Unbroken, clipped pieces of a curve.
    fn pieces(&self, points: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
        let mut out: Vec<Vec<(f64, f64)>> = Vec::new();
        let mut joined = false;
        for w in points.windows(2) {
            let &[a, b] = w else { continue };
            let finite = a.0.is_finite() && a.1.is_finite() && b.0.is_finite() && b.1.is_finite();
            let cut = finite
                .then(|| self.cut((self.x(a.0), self.y(a.1)), (self.x(b.0), self.y(b.1))))
                .flatten();
            let Some((p, q, whole)) = cut else {
                joined = false;
                continue;
            };
            match out.last_mut() {
                Some(last) if joined => last.push(q),
                _ => out.push(vec![p, q]),
            }
            joined = whole;
        }
        out
    }

    /// The part of a segment inside (Liang and Barsky), and whether its end was inside.
    fn cut(&self, a: (f64, f64), b: (f64, f64)) -> Option<Cut> {
        let r = self.rect;
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let (mut t0, mut t1) = (0.0_f64, 1.0_f64);
        for (p, q) in
            [(-dx, a.0 - r.x), (dx, r.x + r.w - a.0), (-dy, a.1 - r.y), (dy, r.y + r.h - a.1)]
        {
            if p.abs() < 1e-12 {
                if q < 0.0 {
                    return None;
                }
            } else if p < 0.0 {
                t0 = t0.max(q / p);
            } else {
                t1 = t1.min(q / p);
            }
        }
        let on = |t: f64| (a.0 + t * dx, a.1 + t * dy);
        (t0 <= t1).then(|| (on(t0), on(t1), t1 >= 1.0))
    }
}

impl<DB: DrawingBackend> Canvas<'_, DB> {
    /// The last number means plain ink: a command beside motions of many colours.
    fn color(&self, i: usize) -> Rgb {
        if i == super::INK { self.theme.ink() } else { self.theme.line(i) }
    }

    fn y_ticks(axis: &Axis, ends: (f64, f64), height: f64) -> Vec<(f64, String)> {
        let mut wish = (height / 42.0).round().clamp(2.0, 8.0) as usize;
        loop {
            let ticks = axis.ticks(ends, wish);
            // At least three, as long as they keep 18 points apart.
            if ticks.len() >= 3 || height / (wish as f64) < 22.0 {
                return ticks;
            }
            wish += 1;
        }
    }

    fn entry(&self, e: &Entry, x: f64, y: f64) -> Result<(), Error> {
        let c = match e.sign {
            Sign::Line(Dash::Solid) if e.varies => self.theme.faint_ink(),
            _ => self.color(e.color),
        };
        match e.sign {
            Sign::Line(dash) => self.path(&[(x, y), (x + 23.0, y)], c, 2.0, dash)?,
            Sign::Mark(Mark::Cross) => self.cross((x + 11.0, y), 3.6, c, 1.6)?,
            Sign::Mark(Mark::Dot) => self.dot((x + 11.0, y), 3.2, c)?,
            Sign::Block => self.rect(Rect { x: x + 2.0, y: y - 4.5, w: 18.0, h: 9.0 }, c, 1.0)?,
            Sign::Hatch => {
                self.hatch(Rect { x: x + 2.0, y: y - 5.0, w: 19.0, h: 10.0 }, self.theme.grid())?;
            }
        }
        let left = (HPos::Left, VPos::Center);
        self.text(&e.name, (x + 29.0, y), LABEL, false, self.theme.ink(), left)
    }

    fn panel(&self, panel: &Panel, outer: Rect, lowest: bool) -> Result<(), Error> {
        let t = self.theme;
        let ends = |axis: &Axis, horizontal: bool| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            let mut take = |v: f64| {
                if v.is_finite() && (!axis.log || v > 0.0) {
                    low = low.min(v);
                    high = high.max(v);
                }
            };
            for l in &panel.layers {
                if horizontal { l.span(&mut take, |_| {}) } else { l.span(|_| {}, &mut take) }
            }
            // Lines run from edge to edge; only true lengths and marks need air at the sides.
            if horizontal && !panel.equal { axis.tight(low, high) } else { axis.ends(low, high) }
        };
        let (mut x, mut y) = (ends(&panel.x, true), ends(&panel.y, false));
        let scale = panel.layers.iter().find_map(Layer::scale);
        let cells = scale.is_some();
        let exact = |axis: &Axis, e: (f64, f64), layer: fn(&Layer) -> Option<(f64, f64)>| {
            if axis.range.is_some() { e } else { panel.layers.iter().find_map(layer).unwrap_or(e) }
        };
        if cells {
            x = exact(
                &panel.x,
                x,
                |l| if let Layer::Cells { x, .. } = l { Some(*x) } else { None },
            );
            y = exact(
                &panel.y,
                y,
                |l| if let Layer::Cells { y, .. } = l { Some(*y) } else { None },
            );
        }
        let mut top = outer.y;
        if !panel.title.is_empty() {
            top += HEAD * 1.5;
        }
        if !panel.y.text().is_empty() {
            top += LABEL * 1.35;
        }
        let bottom = TICK * 1.9 + if lowest { LABEL * 1.7 } else { 6.0 };
        let height = (outer.y + outer.h - bottom - top - 4.0).max(10.0);
        let y_ticks = Self::y_ticks(&panel.y, y, height);
        let widest = y_ticks
            .iter()
            .map(|k| text_width(self.letterer, &k.1, TICK, false))
            .fold(0.0, f64::max);
        let label_width = widest.min(0.4 * outer.w);
        let side = if cells { 74.0 } else { 14.0 };
        let mut rect = Rect {
            x: outer.x + label_width + 8.0,
            y: top + 4.0,
            w: (outer.w - label_width - 8.0 - side).max(10.0),
            h: height,
        };
        if panel.equal {
            (x, y) = equalise(&mut rect, x, y);
        }
        let y_ticks = if panel.equal { Self::y_ticks(&panel.y, y, rect.h) } else { y_ticks };
        let frame = Frame { rect, x, y, log: (panel.x.log, panel.y.log) };
        let x_ticks = self.x_ticks(panel, &frame);

        let left = (HPos::Left, VPos::Center);
        let mut head = outer.y;
        if !panel.title.is_empty() {
            self.text(&panel.title, (rect.x, head + 0.6 * HEAD), HEAD, true, t.ink(), left)?;
            head += HEAD * 1.5;
        }
        let y_text = panel.y.text();
        self.text(&y_text, (rect.x, head + 0.5 * LABEL), LABEL, false, t.faint_ink(), left)?;

        for l in &panel.layers {
            if let Layer::Masked { x } = l {
                let (a, b) = (frame.x(x.0).max(rect.x), frame.x(x.1).min(rect.x + rect.w));
                if b > a {
                    self.hatch(Rect { x: a, w: b - a, ..rect }, t.grid())?;
                }
            }
        }
        let bars = !panel.x.names.is_empty();
        for (v, _) in &y_ticks {
            let y = frame.y(*v);
            if frame.inside((rect.x, y)) && !cells {
                self.line(&[(rect.x, y), (rect.x + rect.w, y)], t.grid(), 1.0, 0.8)?;
            }
        }
        for (v, _) in &x_ticks {
            if !bars && !cells {
                let x = frame.x(*v);
                self.line(&[(x, rect.y), (x, rect.y + rect.h)], t.grid(), 1.0, 0.8)?;
            }
        }
        for l in &panel.layers {
            self.layer(l, &frame, scale.map(|s| (s.1, s.2)))?;
        }
        let foot = rect.y + rect.h;
        self.line(&[(rect.x, foot), (rect.x + rect.w, foot)], t.faint_ink(), 1.0, 0.9)?;
        for (v, name) in &y_ticks {
            let p = (rect.x - 5.0, frame.y(*v));
            self.text(name, p, TICK, false, t.faint_ink(), (HPos::Right, VPos::Center))?;
        }
        for (v, name) in &x_ticks {
            let x = frame.x(*v);
            if !bars {
                self.line(&[(x, foot), (x, foot + 3.5)], t.faint_ink(), 1.0, 0.9)?;
            }
            let p = (x, foot + 6.0 + 0.5 * TICK);
            self.text(name, p, TICK, false, t.faint_ink(), (HPos::Center, VPos::Center))?;
        }
        if lowest {
            let p = (rect.x + 0.5 * rect.w, foot + TICK * 1.7 + LABEL);
            let centre = (HPos::Center, VPos::Center);
            self.text(&panel.x.text(), p, LABEL, false, t.faint_ink(), centre)?;
        }
        if let Some((label, low, high)) = scale {
            self.scale(&frame, label, low, high)?;
        }
        Ok(())
    }

    /// As many ticks as have room beside each other.
    fn x_ticks(&self, panel: &Panel, frame: &Frame) -> Vec<(f64, String)> {
        let mut wish = (frame.rect.w / 62.0).round().clamp(2.0, 12.0) as usize;
        loop {
            let ticks = panel.x.ticks(frame.x, wish);
            let widest = ticks
                .iter()
                .map(|k| text_width(self.letterer, &k.1, TICK, false))
                .fold(0.0, f64::max);
            let room = frame.rect.w / ticks.len().max(1) as f64;
            if wish <= 2 || widest + 8.0 <= room || panel.x.log || !panel.x.names.is_empty() {
                return ticks;
            }
            wish -= 1;
        }
    }

    fn layer(&self, layer: &Layer, f: &Frame, scale: Option<(f64, f64)>) -> Result<(), Error> {
        let t = self.theme;
        match layer {
            Layer::Line { points, color, dash, .. } => {
                for piece in f.pieces(points) {
                    self.path(&piece, self.color(*color), 1.8, *dash)?;
                }
            }
            Layer::Band { points, color } => {
                for run in
                    points.split(|p| !(p.0.is_finite() && p.1.is_finite() && p.2.is_finite()))
                {
                    let up = run.iter().map(|p| (f.x(p.0), f.clamp_y(f.y(p.2))));
                    let down = run.iter().rev().map(|p| (f.x(p.0), f.clamp_y(f.y(p.1))));
                    let outline: Vec<_> = up.chain(down).collect();
                    if run.len() > 1 {
                        self.fill(&outline, self.color(*color), 0.20)?;
                    }
                }
            }
            Layer::Marks { points, color, mark, .. } => {
                for p in points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()) {
                    let p = (f.x(p.0), f.y(p.1));
                    if f.inside(p) {
                        match mark {
                            Mark::Cross => self.cross(p, 3.4, self.color(*color), 1.5)?,
                            Mark::Dot => self.dot(p, 2.8, self.color(*color))?,
                        }
                    }
                }
            }
            Layer::Bars { values, color, set: (set, sets), .. } => {
                let wide = 0.76 / (*sets).max(1) as f64;
                for (i, (v, error)) in values.iter().enumerate().filter(|(_, v)| v.0.is_finite()) {
                    let from = i as f64 - 0.38 + wide * *set as f64;
                    let gap = if *sets > 1 { 0.04 * wide } else { 0.0 };
                    let (x0, x1) = (f.x(from + gap), f.x(from + wide - gap));
                    let (y0, y1) = (f.clamp_y(f.y(v.max(0.0))), f.clamp_y(f.y(v.min(0.0))));
                    let bar = Rect { x: x0, y: y0, w: x1 - x0, h: (y1 - y0).max(0.5) };
                    self.rect(bar, self.color(*color), 0.92)?;
                    if *error > 0.0 && error.is_finite() {
                        let x = 0.5 * (x0 + x1);
                        let (a, b) = (f.clamp_y(f.y(v - error)), f.clamp_y(f.y(v + error)));
                        let cap = (0.22 * (x1 - x0)).min(5.0);
                        self.line(&[(x, a), (x, b)], t.ink(), 1.0, 1.2)?;
                        self.line(&[(x - cap, a), (x + cap, a)], t.ink(), 1.0, 1.2)?;
                        self.line(&[(x - cap, b), (x + cap, b)], t.ink(), 1.0, 1.2)?;
                    }
                }
            }
            Layer::Histogram { edges, heights, color, .. } => {
                for (pair, v) in edges.windows(2).zip(heights) {
                    let &[a, b] = pair else { continue };
                    let (x0, x1) = (f.x(a), f.x(b));
                    let y = f.clamp_y(f.y(*v));
                    let foot = f.rect.y + f.rect.h;
                    let bar = Rect { x: x0, y, w: (x1 - x0 - 0.6).max(0.5), h: foot - y };
                    self.rect(bar, self.color(*color), 0.85)?;
                }
            }
            Layer::Cells { x, y, columns, values, .. } => {
                let Some((low, high)) = scale else { return Ok(()) };
                let columns = (*columns).max(1);
                let rows = values.len().div_ceil(columns);
                let (dx, dy) = ((x.1 - x.0) / columns as f64, (y.1 - y.0) / rows.max(1) as f64);
                for (i, v) in values.iter().enumerate().filter(|(_, v)| v.is_finite()) {
                    let (c, r) = ((i % columns) as f64, (i / columns) as f64);
                    let (x0, x1) = (f.x(x.0 + c * dx), f.x(x.0 + (c + 1.0) * dx));
                    let (y0, y1) = (f.y(y.0 + (r + 1.0) * dy), f.y(y.0 + r * dy));
                    let share = (v - low) / (high - low);
                    let cell = Rect { x: x0, y: y0, w: x1 - x0, h: y1 - y0 };
                    self.rect(cell, t.heat(share), 1.0)?;
                }
            }
            Layer::Level { y, name } => {
                let y = f.y(*y);
                if f.inside((f.rect.x, y)) {
                    let right = f.rect.x + f.rect.w;
                    self.path(&[(f.rect.x, y), (right, y)], t.faint_ink(), 1.1, Dash::Dotted)?;
                    let pos = (HPos::Right, VPos::Bottom);
                    self.text(name, (right, y - 3.0), TICK, false, t.faint_ink(), pos)?;
                }
            }
            Layer::Masked { .. } => {}
        }
        Ok(())
    }

    /// The colour scale to the right of cells.
    fn scale(&self, f: &Frame, label: &str, low: f64, high: f64) -> Result<(), Error> {
        let t = self.theme;
        let (x, w) = (f.rect.x + f.rect.w + 12.0, 11.0);
        let steps = 64;
        for k in 0..steps {
            let share = f64::from(k) / f64::from(steps);
            let h = f.rect.h / f64::from(steps);
            let y = f.rect.y + f.rect.h - h * f64::from(k + 1);
            self.rect(Rect { x, y, w, h: h + 0.3 }, t.heat(share), 1.0)?;
        }
        let axis = Axis::default();
        let left = (HPos::Left, VPos::Center);
        for (v, name) in axis.ticks((low, high), (f.rect.h / 50.0).clamp(2.0, 6.0) as usize) {
            let y = f.rect.y + f.rect.h * (1.0 - (v - low) / (high - low));
            self.text(&name, (x + w + 4.0, y), TICK, false, t.faint_ink(), left)?;
        }
        let p = (x + w + 46.0, f.rect.y - 0.85 * LABEL);
        self.text(label, p, LABEL, false, t.faint_ink(), (HPos::Right, VPos::Center))
    }
}

/// Widens the range of one axis until a unit is as long on both. The panel keeps its size.
fn equalise(rect: &mut Rect, x: (f64, f64), y: (f64, f64)) -> ((f64, f64), (f64, f64)) {
    let per = ((x.1 - x.0) / rect.w).max((y.1 - y.0) / rect.h);
    let grow = |e: (f64, f64), length: f64| {
        let (middle, half) = (0.5 * (e.0 + e.1), 0.5 * per * length);
        (middle - half, middle + half)
    };
    (grow(x, rect.w), grow(y, rect.h))
}
