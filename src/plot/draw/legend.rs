//! The legend of a figure: one list for all panels, or one for each.

use plotters::prelude::DrawingBackend;
use plotters::style::text_anchor::{HPos, VPos};

use super::canvas::{Canvas, LABEL, Rect, text_width};
use crate::figure::{Dash, Layer, Mark, Panel};
use crate::{Error, INK, Letterer};

/// A legend entry.
#[derive(Clone, PartialEq)]
pub(super) struct Entry {
    name: String,
    color: usize,
    /// Whether panels draw it in different colours; then the legend explains the pattern.
    varies: bool,
    sign: Sign,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Sign {
    Line(Dash),
    Mark(Mark),
    Block,
    Hatch,
}

/// The entries, without duplicates, masks last.
pub(super) fn entries(panels: &[Panel]) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut add = |name: &str, color: usize, sign: Sign| {
        // The same name and pattern in several panels is one entry, regardless of the colour.
        if let Some(e) = entries.iter_mut().find(|e| e.name == name && e.sign == sign) {
            e.varies |= e.color != color;
        } else if !name.is_empty() {
            entries.push(Entry { name: name.to_owned(), color, varies: false, sign });
        }
    };
    for layer in panels.iter().flat_map(|p| &p.layers) {
        match layer {
            Layer::Line { name, color, dash, .. } => add(name, *color, Sign::Line(*dash)),
            Layer::Marks { name, color, mark, .. } => add(name, *color, Sign::Mark(*mark)),
            Layer::Bars { name, color, .. } | Layer::Histogram { name, color, .. } => {
                add(name, *color, Sign::Block);
            }
            Layer::Masked { .. } => add("masked: no goal", INK, Sign::Hatch),
            Layer::Band { .. } | Layer::Cells { .. } | Layer::Level { .. } => {}
        }
    }
    entries.sort_by_key(|e| e.sign == Sign::Hatch);
    // One set of bars in one panel names itself by the axis.
    if entries.len() == 1 && panels.len() == 1 && matches!(entries[0].sign, Sign::Block) {
        entries.clear();
    }
    entries
}

impl Entry {
    /// Points across, with the gap behind it.
    pub(super) fn width(&self, letterer: &Letterer) -> f64 {
        30.0 + text_width(letterer, &self.name, LABEL, false) + 18.0
    }
}

/// From one line of the list to the next, points.
pub(super) const LINE: f64 = LABEL * 1.7;

/// Lines that the list takes at this width.
pub(super) fn rows(letterer: &Letterer, legend: &[Entry], width: f64) -> usize {
    if legend.is_empty() {
        return 0;
    }
    let (mut rows, mut x) = (1, 0.0);
    for e in legend {
        let w = e.width(letterer);
        if x > 0.0 && x + w > width {
            rows += 1;
            x = 0.0;
        }
        x += w;
    }
    rows
}

impl<DB: DrawingBackend> Canvas<'_, DB> {
    /// The list, its first line at `y`.
    pub(super) fn legend(
        &self,
        list: &[Entry],
        left: f64,
        mut y: f64,
        width: f64,
    ) -> Result<(), Error> {
        let mut x = 0.0;
        for e in list {
            let w = e.width(self.letterer);
            if x > 0.0 && x + w > width {
                x = 0.0;
                y += LINE;
            }
            self.entry(e, left + x, y)?;
            x += w;
        }
        Ok(())
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
}
