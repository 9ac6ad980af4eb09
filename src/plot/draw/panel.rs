//! One pair of axes and its content.

use plotters::prelude::DrawingBackend;
use plotters::style::text_anchor::{HPos, VPos};

use super::canvas::{Canvas, HEAD, LABEL, Rect, TICK, text_width};
use super::frame::{Frame, drawable};
use super::legend::{Entry, LINE, rows};
use crate::Error;
use crate::axis::Axis;
use crate::figure::{Dash, Layer, Mark, Panel};

/// The margins of a panel around its axes.
#[derive(Clone, Copy)]
pub(super) struct Room<'a> {
    /// Whether the name of the x axis is drawn; the same for all panels of a row.
    pub(super) foot: bool,
    /// The panel's own legend; empty if the figure has one.
    pub(super) legend: &'a [Entry],
}

/// Axes, measured.
struct Inner {
    x: (f64, f64),
    y: (f64, f64),
    /// Upper edge and height of what lies between the axes.
    top: f64,
    height: f64,
    list_width: f64,
    /// Points that the numbers of the y axis take.
    labels: f64,
    y_ticks: Vec<(f64, String)>,
    /// Lines that names below the x axis take: two where they would run into each other.
    name_rows: usize,
}

impl<DB: DrawingBackend> Canvas<'_, DB> {
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

    /// The axes of a panel, and the space for them inside `outer`.
    fn measure(&self, panel: &Panel, outer: Rect, room: Room<'_>) -> Inner {
        let ends = |axis: &Axis, horizontal: bool| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            let mut take = |v: f64| {
                if drawable(v) && (!axis.log || v > 0.0) {
                    low = low.min(v);
                    high = high.max(v);
                }
            };
            for l in &panel.layers {
                if horizontal { l.span(&mut take, |_| {}) } else { l.span(|_| {}, &mut take) }
            }
            // Lines go from edge to edge; only equal scales and marks need margins at the sides.
            if horizontal && !panel.equal { axis.tight(low, high) } else { axis.ends(low, high) }
        };
        let (mut x, mut y) = (ends(&panel.x, true), ends(&panel.y, false));
        let cells = panel.layers.iter().any(|l| l.scale().is_some());
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
        // Whatever the ticks will take, the list fits beside them.
        let list_width = (outer.w - 64.0).max(10.0);
        top += rows(self.letterer, room.legend, list_width) as f64 * LINE;
        if !panel.y.text().is_empty() {
            top += LABEL * 1.35;
        }
        // The width is known to the numbers at the left, a tenth of the panel more or less.
        let name_rows = self.name_rows(panel, 0.92 * list_width);
        let bottom =
            TICK * (0.6 + 1.3 * name_rows as f64) + if room.foot { LABEL * 1.7 } else { 6.0 };
        let height = (outer.y + outer.h - bottom - top - 4.0).max(10.0);
        let y_ticks = Self::y_ticks(&panel.y, y, height);
        let labels = self.widest(&y_ticks).min(0.4 * outer.w);
        Inner { x, y, top: top + 4.0, height, list_width, labels, y_ticks, name_rows }
    }

    /// Points that the numbers beside a panel take.
    pub(super) fn labels(&self, panel: &Panel, outer: Rect, room: Room<'_>) -> f64 {
        self.measure(panel, outer, room).labels
    }

    /// `labels` are the points for the numbers at the left, the same for a whole column.
    pub(super) fn panel(
        &self,
        panel: &Panel,
        outer: Rect,
        lowest: bool,
        room: Room<'_>,
        labels: f64,
    ) -> Result<(), Error> {
        let t = self.theme;
        let legend = room.legend;
        let Inner { mut x, mut y, top, height, list_width, y_ticks, name_rows, .. } =
            self.measure(panel, outer, room);
        let scale = panel.layers.iter().find_map(Layer::scale);
        let cells = scale.is_some();
        let side = if cells { 74.0 } else { 14.0 };
        let mut rect = Rect {
            x: outer.x + labels + 8.0,
            y: top,
            w: (outer.w - labels - 8.0 - side).max(10.0),
            h: height,
        };
        if panel.equal {
            (x, y) = equalise(&mut rect, x, y);
        }
        let y_ticks = if panel.equal { Self::y_ticks(&panel.y, y, rect.h) } else { y_ticks };
        let frame = Frame { rect, x, y, log: (panel.x.log, panel.y.log) };
        let x_ticks = self.x_ticks(panel, &frame, name_rows);

        let left = (HPos::Left, VPos::Center);
        let mut head = outer.y;
        if !panel.title.is_empty() {
            self.text(&panel.title, (rect.x, head + 0.6 * HEAD), HEAD, true, t.ink(), left)?;
            head += HEAD * 1.5;
        }
        self.legend(legend, rect.x, head + 0.5 * LINE, list_width)?;
        head += rows(self.letterer, legend, list_width) as f64 * LINE;
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
        for (i, (v, name)) in x_ticks.iter().enumerate() {
            let x = frame.x(*v);
            if !bars {
                self.line(&[(x, foot), (x, foot + 3.5)], t.faint_ink(), 1.0, 0.9)?;
            }
            let down = (i % name_rows) as f64 * 1.3 * TICK;
            let p = (x, foot + 6.0 + 0.5 * TICK + down);
            self.text(name, p, TICK, false, t.faint_ink(), (HPos::Center, VPos::Center))?;
        }
        if lowest {
            let p = (rect.x + 0.5 * rect.w, foot + TICK * (0.4 + 1.3 * name_rows as f64) + LABEL);
            let centre = (HPos::Center, VPos::Center);
            self.text(&panel.x.text(), p, LABEL, false, t.faint_ink(), centre)?;
        }
        if let Some((label, low, high)) = scale {
            self.scale(&frame, label, low, high)?;
        }
        Ok(())
    }

    fn widest(&self, ticks: &[(f64, String)]) -> f64 {
        ticks.iter().map(|k| text_width(self.letterer, &k.1, TICK, false)).fold(0.0, f64::max)
    }

    /// Rows for the names below the axis, in a panel this wide.
    fn name_rows(&self, panel: &Panel, width: f64) -> usize {
        if panel.x.names.is_empty() {
            return 1;
        }
        let names = panel.x.ticks((0.0, 1.0), 2);
        let crowded = self.widest(&names) + 8.0 > width / names.len().max(1) as f64;
        if crowded { 2 } else { 1 }
    }

    /// As many ticks as fit beside each other, in this many rows.
    fn x_ticks(&self, panel: &Panel, frame: &Frame, rows: usize) -> Vec<(f64, String)> {
        let mut wish = (frame.rect.w / 62.0).round().clamp(2.0, 12.0) as usize;
        loop {
            let ticks = panel.x.ticks(frame.x, wish);
            let widest = self.widest(&ticks);
            let room = frame.rect.w / ticks.len().max(1) as f64;
            if !panel.x.names.is_empty() {
                // Names that would run into each other all the same: every second, every third, ...
                let room = rows as f64 * room.max(1e-3);
                let every = ((widest + 8.0) / room).ceil().max(1.0) as usize;
                return ticks.into_iter().step_by(every).collect();
            }
            if wish <= 2 || widest + 8.0 <= room || panel.x.log {
                return ticks;
            }
            wish -= 1;
        }
    }

    fn layer(&self, layer: &Layer, f: &Frame, scale: Option<(f64, f64)>) -> Result<(), Error> {
        let t = self.theme;
        match layer {
            Layer::Line { points, color, dash, .. } => {
                // A line of one point would be invisible.
                if let [p] = points[..]
                    && p.0.is_finite()
                    && p.1.is_finite()
                    && f.inside((f.x(p.0), f.y(p.1)))
                {
                    self.dot((f.x(p.0), f.y(p.1)), 2.2, self.color(*color))?;
                }
                for piece in f.pieces(points) {
                    self.path(&piece, self.color(*color), 1.8, *dash)?;
                }
            }
            Layer::Band { points, color } => {
                for run in points.split(|p| ![p.0, p.1, p.2].into_iter().all(drawable)) {
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
                for (i, (v, error)) in values.iter().enumerate().filter(|(_, v)| drawable(v.0)) {
                    let from = i as f64 - 0.38 + wide * *set as f64;
                    let gap = if *sets > 1 { 0.04 * wide } else { 0.0 };
                    let (x0, x1) = (f.x(from + gap), f.x(from + wide - gap));
                    let (y0, y1) = (f.clamp_y(f.y(v.max(0.0))), f.clamp_y(f.y(v.min(0.0))));
                    let bar = Rect { x: x0, y: y0, w: x1 - x0, h: (y1 - y0).max(0.5) };
                    self.rect(bar, self.color(*color), 0.92)?;
                    if *error > 0.0 && drawable(v + error) && drawable(v - error) {
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
                    if ![a, b, *v].into_iter().all(drawable) {
                        continue;
                    }
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
                    self.rect(cell, t.heat(seen(share)), 1.0)?;
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
            self.rect(Rect { x, y, w, h: h + 0.3 }, t.heat(seen(share)), 1.0)?;
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

/// Makes the smallest value that is drawn differ visibly from the paper, which means zero.
fn seen(share: f64) -> f64 {
    0.2 + 0.8 * share
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
