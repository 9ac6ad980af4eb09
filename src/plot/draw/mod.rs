//! Lays out and draws a figure through plotters' bitmap and SVG backends.
//!
//! We draw the axes ourselves, because those of plotters reserve fixed label areas and cannot
//! hatch, break lines at masks or share a legend between panels. Its backends, shapes and fonts are
//! used.

mod canvas;
mod frame;
mod legend;
mod panel;

use std::cell::RefCell;
use std::path::Path;

use plotters::backend::{BitMapBackend, SVGBackend};
use plotters::prelude::{DrawingBackend, IntoDrawingArea};
use plotters::style::text_anchor::{HPos, VPos};

use self::canvas::{Area, Canvas, LABEL, Lettering, Rect, SMOOTH, UNITS, rgb};
use self::legend::Entry;
use self::panel::Room;
use super::figure::{Figure, Panel};
use super::{Error, Letterer};

/// Points along one edge of a figure.
const POINTS: u32 = 6000;

const TITLE: f64 = 16.0;
const MARGIN: f64 = 16.0;

impl Figure {
    /// As a PNG with two pixels per point.
    ///
    /// # Errors
    /// [`Error::Empty`], [`Error::Large`], [`Error::Draw`].
    pub fn png(&self) -> Result<Vec<u8>, Error> {
        png(self)
    }

    /// As an SVG.
    ///
    /// # Errors
    /// [`Error::Empty`], [`Error::Large`], [`Error::Draw`].
    pub fn svg(&self) -> Result<String, Error> {
        svg(self)
    }

    /// Checks the suffix of a path before the work.
    ///
    /// # Errors
    /// [`Error::Format`].
    pub fn may_save(path: &Path) -> Result<(), Error> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("png" | "svg") => Ok(()),
            _ => Err(Error::Format { path: path.to_owned() }),
        }
    }

    /// Writes a file; the suffix (png or svg) decides the format.
    ///
    /// # Errors
    /// As above; [`Error::Format`], [`Error::File`].
    pub fn save(&self, path: &Path) -> Result<(), Error> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let bytes = match ending.as_deref() {
            Some("png") => self.png()?,
            Some("svg") => self.svg()?.into_bytes(),
            _ => return Err(Error::Format { path: path.to_owned() }),
        };
        Ok(robert_base::fsio::write_atomic(path, &bytes)?)
    }
}

/// A figure as PNG bytes.
fn png(figure: &Figure) -> Result<Vec<u8>, Error> {
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
fn svg(figure: &Figure) -> Result<String, Error> {
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

struct Size {
    width: u32,
    height: u32,
    /// Top of the panels.
    top: f64,
    legend: Vec<Entry>,
    rows: usize,
}

fn layout(figure: &Figure, letterer: &Letterer) -> Result<Size, Error> {
    if figure.panels.is_empty() {
        return Err(Error::Empty);
    }
    let columns = figure.columns.clamp(1, figure.panels.len());
    let rows = figure.panels.len().div_ceil(columns);
    let width = 2.0 * MARGIN + columns as f64 * f64::from(figure.panel.0);
    let legend = if figure.own_legends { Vec::new() } else { legend::entries(&figure.panels) };
    let mut top = MARGIN;
    if !figure.title.is_empty() {
        top += TITLE * 1.45;
    }
    if !figure.note.is_empty() {
        top += LABEL * 1.5;
    }
    let rows_of_legend = legend::rows(letterer, &legend, width - 2.0 * MARGIN);
    if rows_of_legend > 0 {
        top += rows_of_legend as f64 * legend::LINE + 7.0;
    }
    let height = top + rows as f64 * f64::from(figure.panel.1) + 0.6 * MARGIN;
    let (width, height) = (width.ceil() as u32, height.ceil() as u32);
    if width > POINTS || height > POINTS {
        return Err(Error::Large { width, height, cap: POINTS });
    }
    Ok(Size { width, height, top, legend, rows })
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
    y += 0.8 * LABEL;
    canvas.legend(&size.legend, MARGIN, y, f64::from(size.width) - 2.0 * MARGIN)?;
    let columns = figure.columns.clamp(1, figure.panels.len());
    let (w, h) = (f64::from(figure.panel.0), f64::from(figure.panel.1));
    // A label is drawn once per column if the panels below have the same one.
    let lowest = |i: usize, panel: &Panel| {
        let below = figure.panels.get(i + columns);
        i / columns + 1 == size.rows || below.is_none_or(|b| b.x.text() != panel.x.text())
    };
    let mut feet = vec![false; size.rows];
    let mut placed = Vec::with_capacity(figure.panels.len());
    for (i, panel) in figure.panels.iter().enumerate() {
        let (column, row) = (i % columns, i / columns);
        feet[row] |= lowest(i, panel);
        let outer = Rect { x: MARGIN + w * column as f64, y: size.top + h * row as f64, w, h };
        let own = figure.own_legends.then(|| legend::entries(std::slice::from_ref(panel)));
        placed.push((panel, outer, own.unwrap_or_default()));
    }
    // Panels of a column begin at one line, panels of a row end at one.
    let room = |i: usize, legend| Room { foot: feet[i / columns], legend };
    let mut labels = vec![0.0_f64; columns];
    for (i, (panel, outer, legend)) in placed.iter().enumerate() {
        let widest = &mut labels[i % columns];
        *widest = widest.max(canvas.labels(panel, *outer, room(i, legend)));
    }
    for (i, (panel, outer, legend)) in placed.iter().enumerate() {
        let labels = labels[i % columns];
        canvas.panel(panel, *outer, lowest(i, panel), room(i, legend), labels)?;
    }
    area.present().map_err(Error::draw)
}
