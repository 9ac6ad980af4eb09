//! The charts of this program, made from plain numbers.

use super::INK;
use super::axis::Axis;
use super::figure::{Dash, Figure, Layer, Mark, Panel};
use super::palette::COLORS;

/// A named curve with an optional interval.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// For the legend.
    pub name: String,
    /// (x, y).
    pub points: Vec<(f64, f64)>,
    /// Half width of the 95 % interval at each point; empty = none.
    pub ci95: Vec<f64>,
}

/// One joint's command and motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointTrack {
    /// Name of the joint.
    pub name: String,
    /// `rad` or `m`.
    pub unit: String,
    /// Commanded value per frame; NaN if masked.
    pub commanded: Vec<f64>,
    /// Reached value per frame.
    pub achieved: Vec<f64>,
}

/// Curves with the same colour differ by their pattern.
fn pattern(curve: usize) -> Dash {
    match curve / COLORS % 3 {
        0 => Dash::Solid,
        1 => Dash::Dashed,
        _ => Dash::Dotted,
    }
}

/// On an axis with zero, the interval of a figure that cannot be negative ends at zero.
fn curve_layers(curves: &[Curve], y: &Axis) -> Vec<Layer> {
    let band = |(color, c): (usize, &Curve)| {
        let clipped = y.from_zero && c.points.iter().all(|p| p.1.is_nan() || p.1 >= 0.0);
        let low = |x: f64| if clipped { x.max(0.0) } else { x };
        let points =
            c.points.iter().zip(&c.ci95).map(|(p, e)| (p.0, low(p.1 - e), p.1 + e)).collect();
        (!c.ci95.is_empty()).then_some(Layer::Band { points, color })
    };
    let line = |(color, c): (usize, &Curve)| Layer::Line {
        name: c.name.clone(),
        points: c.points.clone(),
        color,
        dash: pattern(color),
    };
    let bands = curves.iter().enumerate().filter_map(band);
    bands.chain(curves.iter().enumerate().map(line)).collect()
}

/// Precision over time, one curve per method, masked spans hatched; `fps` converts frames into
/// seconds. `masked` are spans `[from, to)` in frames.
pub fn precision(
    title: &str,
    curves: &[Curve],
    unit: &str,
    masked: &[(f64, f64)],
    fps: f64,
) -> Figure {
    let mut layers: Vec<Layer> =
        masked.iter().map(|m| Layer::Masked { x: (m.0 / fps, m.1 / fps) }).collect();
    let scaled: Vec<Curve> = curves
        .iter()
        .map(|c| Curve { points: c.points.iter().map(|p| (p.0 / fps, p.1)).collect(), ..c.clone() })
        .collect();
    let y = Axis::new("precision: mean absolute error", unit).from_zero();
    layers.extend(curve_layers(&scaled, &y));
    layers.extend(scaled.iter().enumerate().map(|(color, c)| Layer::Marks {
        name: String::new(),
        points: alone(&c.points),
        color,
        mark: Mark::Dot,
    }));
    let panel = Panel { x: Axis::new("time", "s"), y, layers, ..Panel::default() };
    Figure::of(title, panel)
}

/// Points without a neighbour, such as the error at a key of one frame, which no line shows.
fn alone(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let seen = |i: Option<usize>| i.and_then(|i| points.get(i)).is_some_and(|p| p.1.is_finite());
    let place = |i: &usize| seen(Some(*i)) && !seen(i.checked_sub(1)) && !seen(Some(i + 1));
    (0..points.len()).filter(place).map(|i| points[i]).collect()
}

/// Command and reached motion, one small panel per joint. Single commands (keyframes) become
/// crosses, consecutive ones a dashed line.
pub fn joints(title: &str, tracks: &[JointTrack], fps: f64) -> Figure {
    let panels = tracks.iter().enumerate().map(|(i, t)| joint_panel(i, t, fps)).collect();
    let columns = match tracks.len() {
        0..=2 => tracks.len().max(1),
        3..=6 => 3,
        _ => 4,
    };
    Figure::grid(title, panels, columns)
}

fn joint_panel(color: usize, t: &JointTrack, fps: f64) -> Panel {
    let at = |(f, v): (usize, &f64)| (f as f64 / fps, *v);
    let seen = |f: usize| t.commanded.get(f).is_some_and(|v| v.is_finite());
    let lonely = |f: usize| seen(f) && !(f > 0 && seen(f - 1)) && !seen(f + 1);
    let (mut line, mut crosses) = (Vec::new(), Vec::new());
    for (f, v) in t.commanded.iter().enumerate() {
        let p = at((f, v));
        if lonely(f) {
            crosses.push(p);
        }
        line.push(if lonely(f) { (p.0, f64::NAN) } else { p });
    }
    let mut layers = Vec::new();
    let mut from = None;
    for f in 0..=t.commanded.len() {
        let masked = f < t.commanded.len() && !seen(f);
        match (masked, from) {
            (true, None) => from = Some(f),
            (false, Some(a)) => {
                // Between two crosses only long spans are hatched.
                if f - a > 1 {
                    layers.push(Layer::Masked { x: (a as f64 / fps, (f - 1) as f64 / fps) });
                }
                from = None;
            }
            _ => {}
        }
    }
    layers.push(Layer::Line {
        name: "achieved".into(),
        points: t.achieved.iter().enumerate().map(at).collect(),
        color,
        dash: Dash::Solid,
    });
    if line.iter().any(|p| p.1.is_finite()) {
        layers.push(Layer::Line {
            name: "commanded".into(),
            points: line,
            color: INK,
            dash: Dash::Dashed,
        });
    }
    if !crosses.is_empty() {
        layers.push(Layer::Marks {
            name: "commanded keyframe".into(),
            points: crosses,
            color: INK,
            mark: Mark::Cross,
        });
    }
    Panel {
        title: t.name.clone(),
        x: Axis::new("time", "s"),
        // Smaller ranges are rounding errors: a joint at rest is a straight line.
        y: Axis::new("", &t.unit).least(1e-3),
        layers,
        equal: false,
    }
}

/// Paths in the plane with equal scales: reached paths as lines, commanded points as crosses.
pub fn xy(title: &str, paths: &[Curve], commanded: &[(f64, f64)], x: Axis, y: Axis) -> Figure {
    let mut layers = curve_layers(paths, &Axis::default());
    layers.push(Layer::Marks {
        name: "commanded".into(),
        points: commanded.to_vec(),
        color: INK,
        mark: Mark::Cross,
    });
    // Smaller ranges are rounding errors: a robot at rest is a point.
    let (x, y) = (x.least(1e-3), y.least(1e-3));
    let panel = Panel { x, y, layers, equal: true, ..Panel::default() };
    Figure::of(title, panel).panel_size(520, 520)
}

/// Curves over a number such as training steps, in one panel.
pub fn curves(title: &str, curves: &[Curve], x: Axis, y: Axis) -> Figure {
    let layers = curve_layers(curves, &y);
    Figure::of(title, Panel { x, y, layers, ..Panel::default() })
}

/// Bars with 95 % intervals: `groups` along x (tasks), `sets` side by side (methods).
/// `values[set][group]` is mean and half width of the interval; NaN = not measured.
pub fn bars(title: &str, groups: &[String], sets: &[(String, Vec<(f64, f64)>)], y: Axis) -> Figure {
    let layers = sets
        .iter()
        .enumerate()
        .map(|(i, (name, values))| Layer::Bars {
            name: name.clone(),
            values: values.clone(),
            color: i,
            set: (i, sets.len()),
        })
        .collect();
    let x = Axis::default().names(groups.to_vec());
    let panel = Panel { x, y: y.from_zero(), layers, ..Panel::default() };
    let width = (groups.len() as u32 * (40 + 26 * sets.len() as u32)).clamp(420, 1600);
    Figure::of(title, panel).panel_size(width, 360)
}

/// Histogram of values, as shares of all.
pub fn histogram(name: &str, values: &[f64], bins: usize, x: Axis) -> Panel {
    let seen: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let (low, high) = x.range.unwrap_or_else(|| {
        seen.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)))
    });
    let bins = bins.clamp(1, 500);
    let wide = if high > low { (high - low) / bins as f64 } else { 1.0 };
    let low = if low.is_finite() { low } else { 0.0 };
    let mut heights = vec![0.0; bins];
    for v in &seen {
        let i = ((v - low) / wide).floor();
        if i >= 0.0
            && let Some(h) = heights.get_mut((i as usize).min(bins - 1))
        {
            *h += 100.0 / seen.len() as f64;
        }
    }
    let edges = (0..=bins).map(|i| low + wide * i as f64).collect();
    let layers = vec![Layer::Histogram { name: String::new(), edges, heights, color: 0 }];
    Panel {
        title: name.to_owned(),
        x,
        y: Axis::new("frames", "%").from_zero(),
        layers,
        equal: false,
    }
}

/// Two-dimensional histogram of pairs of values (coverage of a plane or of two joints), on a log
/// scale, because rare corners matter.
pub fn coverage(name: &str, points: &[(f64, f64)], cells: usize, x: Axis, y: Axis) -> Panel {
    let seen = || points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
    let ends = |range: Option<(f64, f64)>, pick: fn(&(f64, f64)) -> f64| {
        let (a, b) = range.unwrap_or_else(|| {
            seen()
                .map(pick)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
        });
        if a < b {
            (a, b)
        } else if a.is_finite() {
            (a - 0.5, a + 0.5)
        } else {
            (0.0, 1.0)
        }
    };
    let (xe, ye) = (ends(x.range, |p| p.0), ends(y.range, |p| p.1));
    let cells = cells.clamp(2, 200);
    let mut counts = vec![0_u32; cells * cells];
    for p in seen() {
        let place = |v: f64, e: (f64, f64)| ((v - e.0) / (e.1 - e.0) * cells as f64).floor();
        let (c, r) = (place(p.0, xe), place(p.1, ye));
        let inside = |k: f64| (0.0..=cells as f64).contains(&k);
        if inside(c) && inside(r) {
            counts[(r as usize).min(cells - 1) * cells + (c as usize).min(cells - 1)] += 1;
        }
    }
    let values =
        counts.iter().map(|n| if *n == 0 { f64::NAN } else { f64::from(*n).log10() }).collect();
    let label = "frames, log10".to_owned();
    let layers = vec![Layer::Cells { x: xe, y: ye, columns: cells, values, label, ends: None }];
    Panel { title: name.to_owned(), x, y, layers, equal: false }
}

/// Gives all these panels the same colour scale, so that they can be compared.
pub fn one_scale(panels: &mut [Panel]) {
    let scales = panels.iter().flat_map(|p| &p.layers).filter_map(Layer::scale);
    let all = scales.map(|(_, low, high)| (low, high)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    for layer in panels.iter_mut().flat_map(|p| &mut p.layers) {
        if let Layer::Cells { ends, .. } = layer {
            *ends = all;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Theme;

    fn wave(name: &str, phase: f64) -> Curve {
        let points: Vec<_> = (0..100)
            .map(|i| (f64::from(i), (f64::from(i) * 0.1 + phase).sin().abs() * 0.1))
            .collect();
        Curve { name: name.into(), ci95: vec![0.01; points.len()], points }
    }

    #[test]
    fn every_chart_becomes_png_and_svg() {
        let track = JointTrack {
            name: "FFJ3".into(),
            unit: "rad".into(),
            commanded: (0..60).map(|i| if i % 20 == 0 { 0.5 } else { f64::NAN }).collect(),
            achieved: (0..60).map(|i| f64::from(i) * 0.01).collect(),
        };
        let groups = ["six".to_owned(), "gun".to_owned()];
        let figures = [
            precision("p", &[wave("robert", 0.0), wave("pd", 1.0)], "rad", &[(10.0, 30.0)], 20.0),
            joints("j", &[track.clone(), track], 20.0),
            xy(
                "xy",
                &[wave("path", 0.0)],
                &[(10.0, 0.1)],
                Axis::new("x", "m"),
                Axis::new("y", "m"),
            ),
            curves("c", &[wave("loss", 0.0)], Axis::new("step", ""), Axis::new("loss", "").log()),
            curves("x", &[wave("loss", 0.0)], Axis::new("data", "").log(), Axis::new("loss", "")),
            bars(
                "b",
                &groups,
                &[("robert".into(), vec![(0.1, 0.02), (f64::NAN, 0.0)])],
                Axis::new("e", "rad"),
            ),
            Figure::of("h", histogram("q", &[0.0, 0.1, 0.1, f64::NAN], 10, Axis::new("q", "rad"))),
            Figure::of(
                "g",
                coverage(
                    "xy",
                    &[(0.0, 0.0), (1.0, 2.0)],
                    10,
                    Axis::new("x", "m"),
                    Axis::new("y", "m"),
                ),
            ),
        ];
        for f in figures {
            assert!(f.png().unwrap().starts_with(b"\x89PNG"), "{}", f.title);
            let svg = f.svg().unwrap();
            assert!(svg.contains("<svg") && svg.contains("</svg>"), "{}", f.title);
            // The backend puts each text on a line of its own.
            let says = |what: &str| svg.lines().any(|l| !l.contains('<') && l.contains(what));
            assert!(says("rad") || says("(m)") || says(", m") || says("loss"), "{}", f.title);
        }
    }

    #[test]
    fn a_path_and_its_command_look_unlike_each_other() {
        let paths = [wave("a", 0.0), wave("b", 1.0)];
        let axis = || Axis::new("x", "m");
        let figure = xy("", &paths, &[(1.0, 0.0)], axis(), axis());
        let colors: Vec<usize> = figure.panels[0]
            .layers
            .iter()
            .filter_map(|l| match l {
                Layer::Line { color, .. } | Layer::Marks { color, .. } => Some(*color),
                _ => None,
            })
            .collect();
        assert_eq!(colors, [0, 1, INK]);
    }

    #[test]
    fn many_groups_are_named_as_far_as_there_is_room() {
        let named = |n: usize| {
            let groups: Vec<String> = (0..n).map(|i| format!("group-{i:03}")).collect();
            let sets = [("a".to_owned(), vec![(1.0, 0.1); n])];
            let svg = bars("", &groups, &sets, Axis::new("e", "rad")).svg().unwrap();
            svg.lines().filter(|l| l.trim().starts_with("group-")).count()
        };
        assert_eq!(named(4), 4);
        assert_eq!(named(24), 24, "in two rows");
        let many = named(300);
        assert!((5..60).contains(&many), "{many} names of some 55 points on twice 1600");
    }

    #[test]
    fn twenty_curves_look_unlike_each_other() {
        let curves: Vec<Curve> = (0..20).map(|i| wave(&format!("run {i}"), 0.1)).collect();
        let mut looks = Vec::new();
        for layer in curve_layers(&curves, &Axis::default()) {
            let Layer::Line { color, dash, .. } = layer else { continue };
            let look = (Theme::Light.line(color), dash);
            assert!(!looks.contains(&look), "{look:?} twice");
            looks.push(look);
        }
        assert_eq!(looks.len(), 20);
    }

    #[test]
    fn intervals_end_at_a_zero_that_cannot_be_passed() {
        let curve =
            Curve { name: "a".into(), points: vec![(0.0, 1.0), (1.0, 2.0)], ci95: vec![1.5; 2] };
        let lows = |curve: &Curve, y: Axis| match &curve_layers(std::slice::from_ref(curve), &y)[0]
        {
            Layer::Band { points, .. } => points.iter().map(|p| p.1).collect::<Vec<_>>(),
            _ => Vec::new(),
        };
        assert_eq!(lows(&curve, Axis::default().from_zero()), [0.0, 0.5]);
        assert_eq!(lows(&curve, Axis::default()), [-0.5, 0.5]);
        let signed = Curve { points: vec![(0.0, -1.0), (1.0, 2.0)], ..curve };
        assert_eq!(lows(&signed, Axis::default().from_zero()), [-2.5, 0.5]);
    }

    #[test]
    fn panels_explain_their_own_colours_when_asked() {
        let panel = |color| Panel {
            layers: vec![Layer::Line {
                name: "loss".into(),
                points: vec![(0.0, 1.0), (1.0, 2.0)],
                color,
                dash: Dash::Solid,
            }],
            ..Panel::default()
        };
        let figure = Figure::grid("two", vec![panel(0), panel(1)], 2).panel_size(300, 200);
        let named = |f: &Figure| f.svg().unwrap().lines().filter(|l| l.trim() == "loss").count();
        assert_eq!(named(&figure), 1);
        assert_eq!(named(&figure.own_legends()), 2);
    }

    #[test]
    fn empty_and_broken_data_are_no_crash() {
        assert!(joints("none", &[], 20.0).png().is_err());
        let nan = Curve { name: "n".into(), points: vec![(f64::NAN, f64::NAN); 3], ci95: vec![] };
        precision("nan", std::slice::from_ref(&nan), "rad", &[], 20.0).png().unwrap();
        curves(
            "one",
            &[Curve { points: vec![(1.0, 1.0)], ..nan }],
            Axis::default(),
            Axis::default(),
        )
        .svg()
        .unwrap();
        Figure::of("empty", histogram("h", &[], 5, Axis::new("x", "m"))).png().unwrap();
        Figure::of("empty", coverage("c", &[], 5, Axis::default(), Axis::default())).png().unwrap();
    }

    #[test]
    fn panels_of_one_scale_have_the_same_colours() {
        let axis = || Axis::new("x", "m");
        let panel = |n: usize| coverage("", &vec![(0.5, 0.5); n], 2, axis(), axis());
        let mut panels = [panel(10), panel(1000), panel(0)];
        one_scale(&mut panels);
        let scales: Vec<_> = panels.iter().map(|p| p.layers[0].scale().unwrap()).collect();
        assert!(scales.iter().all(|s| (s.1, s.2) == (scales[0].1, scales[0].2)), "{scales:?}");
        assert!(scales[0].1 <= 1.0 && scales[0].2 >= 3.0, "{scales:?}");
    }

    #[test]
    fn an_axis_is_named_where_the_one_below_is_another() {
        let panel = |x: &str| Panel {
            x: Axis::new(x, "m"),
            layers: curve_layers(&[wave("w", 0.0)], &Axis::default()),
            ..Panel::default()
        };
        let count = |names: [&str; 4], what: &str| {
            let svg = Figure::grid("g", names.map(panel).into(), 2).svg().unwrap();
            svg.lines().filter(|l| l.trim() == what).count()
        };
        assert_eq!(count(["time", "time", "time", "time"], "time (m)"), 2);
        let names = ["hip", "knee", "foot", "knee"];
        assert_eq!(["hip (m)", "foot (m)", "knee (m)"].map(|what| count(names, what)), [1, 1, 1]);
    }

    #[test]
    fn shares_of_a_histogram_add_up() {
        let values: Vec<f64> = (0..50).map(f64::from).collect();
        let p = histogram("h", &values, 7, Axis::new("x", "m"));
        let Layer::Histogram { heights, edges, .. } = &p.layers[0] else { panic!() };
        assert!((heights.iter().sum::<f64>() - 100.0).abs() < 1e-9);
        assert_eq!((edges[0], edges[7]), (0.0, 49.0));
    }
}
