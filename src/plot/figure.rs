//! The content of a chart as plain data: a figure of panels, a panel of layers.

use super::axis::Axis;
use super::palette::Theme;

/// Pattern of a line: it shows the kind, while colour shows the joint or method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dash {
    /// Achieved.
    #[default]
    Solid,
    /// Commanded.
    Dashed,
    /// Reference, baseline.
    Dotted,
}

/// Form of single points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Commanded.
    Cross,
    /// Measured.
    Dot,
}

/// Data in a panel. Points that are not finite break a line.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// A curve.
    Line {
        /// For the legend; empty = not listed.
        name: String,
        /// (x, y).
        points: Vec<(f64, f64)>,
        /// Number of the colour, see [`Theme::line`].
        color: usize,
        /// The pattern.
        dash: Dash,
    },
    /// Between a lower and an upper curve (a 95 % interval).
    Band {
        /// (x, low, high).
        points: Vec<(f64, f64, f64)>,
        /// Number of the colour.
        color: usize,
    },
    /// Single points.
    Marks {
        /// For the legend; empty = not listed.
        name: String,
        /// (x, y).
        points: Vec<(f64, f64)>,
        /// Number of the colour.
        color: usize,
        /// The form.
        mark: Mark,
    },
    /// Bars over the named places of the x axis, one set beside the other.
    Bars {
        /// For the legend.
        name: String,
        /// Height and half length of the error bar (0 = none) for each place.
        values: Vec<(f64, f64)>,
        /// Number of the colour.
        color: usize,
        /// The index of this set, from 0, and the number of sets.
        set: (usize, usize),
    },
    /// Columns between edges.
    Histogram {
        /// For the legend; empty = not listed.
        name: String,
        /// One more than heights.
        edges: Vec<f64>,
        /// Heights.
        heights: Vec<f64>,
        /// Number of the colour.
        color: usize,
    },
    /// Cells in colour; row 0 is the lowest.
    Cells {
        /// First and last x.
        x: (f64, f64),
        /// First and last y.
        y: (f64, f64),
        /// Cells a row.
        columns: usize,
        /// Row by row; not finite = empty.
        values: Vec<f64>,
        /// The meaning of the colour, with its unit.
        label: String,
        /// Values of the first and the last colour; `None` = the range of the values.
        ends: Option<(f64, f64)>,
    },
    /// A stretch of x without goal (hatched).
    Masked {
        /// From, to.
        x: (f64, f64),
    },
    /// A horizontal line across.
    Level {
        /// Its height.
        y: f64,
        /// Written at its right end.
        name: String,
    },
}

/// One pair of axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Horizontal.
    pub x: Axis,
    /// Vertical.
    pub y: Axis,
    /// From back to front.
    pub layers: Vec<Layer>,
    /// Whether both axes have the same scale.
    pub equal: bool,
}

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Above all.
    pub title: String,
    /// Below the title, smaller: conditions, sample size.
    pub note: String,
    /// In reading order.
    pub panels: Vec<Panel>,
    /// Panels a row.
    pub columns: usize,
    /// Width and height of one panel in points (1/96 inch).
    pub panel: (u32, u32),
    /// Paper or dark.
    pub theme: Theme,
    /// Whether each panel explains its own colours; otherwise one list serves all.
    pub own_legends: bool,
}

impl Figure {
    /// One panel.
    pub fn of(title: &str, panel: Panel) -> Figure {
        Figure {
            title: title.to_owned(),
            note: String::new(),
            panels: vec![panel],
            columns: 1,
            panel: (720, 380),
            theme: Theme::Light,
            own_legends: false,
        }
    }

    /// Small multiples.
    pub fn grid(title: &str, panels: Vec<Panel>, columns: usize) -> Figure {
        Figure {
            title: title.to_owned(),
            note: String::new(),
            panels,
            columns: columns.max(1),
            panel: (270, 180),
            theme: Theme::Light,
            own_legends: false,
        }
    }

    /// The line below the title.
    #[must_use]
    pub fn note(mut self, note: &str) -> Figure {
        note.clone_into(&mut self.note);
        self
    }

    /// Paper or dark.
    #[must_use]
    pub fn theme(mut self, theme: Theme) -> Figure {
        self.theme = theme;
        self
    }

    /// Panels whose colours mean different things.
    #[must_use]
    pub fn own_legends(mut self) -> Figure {
        self.own_legends = true;
        self
    }

    /// Another size of one panel, points.
    #[must_use]
    pub fn panel_size(mut self, width: u32, height: u32) -> Figure {
        self.panel = (width, height);
        self
    }
}

impl Layer {
    /// Whether colours of cells need a scale beside the panel.
    pub(super) fn scale(&self) -> Option<(&str, f64, f64)> {
        let Layer::Cells { values, label, ends, .. } = self else { return None };
        if let Some((low, high)) = ends {
            return Some((label.as_str(), *low, *high));
        }
        let seen = values.iter().copied().filter(|v| v.is_finite());
        let (low, high) =
            seen.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let low = if low > 0.0 && low < 0.5 * high { 0.0 } else { low };
        (low <= high).then_some((label.as_str(), low, if high > low { high } else { low + 1.0 }))
    }

    /// Calls `x` and `y` with every coordinate that must be inside the axes.
    pub(super) fn span(&self, mut x: impl FnMut(f64), mut y: impl FnMut(f64)) {
        match self {
            Layer::Line { points, .. } | Layer::Marks { points, .. } => {
                for (a, b) in points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()) {
                    x(*a);
                    y(*b);
                }
            }
            Layer::Band { points, .. } => {
                for (a, low, high) in points {
                    x(*a);
                    y(*low);
                    y(*high);
                }
            }
            Layer::Bars { values, .. } => {
                y(0.0);
                for (v, e) in values {
                    y(*v + e.abs());
                    if *v < 0.0 {
                        y(*v - e.abs());
                    }
                }
            }
            Layer::Histogram { edges, heights, .. } => {
                for e in edges {
                    x(*e);
                }
                y(0.0);
                for h in heights {
                    y(*h);
                }
            }
            Layer::Cells { x: (x0, x1), y: (y0, y1), .. } => {
                x(*x0);
                x(*x1);
                y(*y0);
                y(*y1);
            }
            Layer::Masked { .. } => {}
            Layer::Level { y: level, .. } => y(*level),
        }
    }
}
