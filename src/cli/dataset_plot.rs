//! `robert dataset plot`: the visited states in one picture.
//!
//! It shows a histogram per joint (one line per agent), the speeds, and planes of neighbouring
//! joints and of joints against their own speed. The planes have a log scale, because rare corners
//! matter.

use std::path::Path;

use super::failure::{Failure, Outcome};
use super::out;
use crate::dataset::{Dataset, Verify};
use crate::plot::{Axis, Figure, Layer, Panel, Theme, coverage, one_scale};
use crate::units::Unit;

/// The most frames to draw; more would not change the picture.
const FRAMES: u64 = 200_000;
/// Bins of a histogram.
const BINS: usize = 60;
/// Cells along each side of a plane.
const CELLS: usize = 60;
/// The most planes to draw.
const PLANES: usize = 8;
/// Planes of each kind (positions, speeds) if every agent has its own.
const PLANES_BY_AGENT: usize = 3;

/// Agent, positions, velocities of a frame.
type Frame = (usize, Vec<f64>, Vec<f64>);

/// Frames picked evenly from all trajectories.
struct Sample {
    agents: Vec<String>,
    frames: Vec<Frame>,
}

impl Sample {
    /// An axis over the values of all agents, so that their panels can be compared.
    fn span(&self, axis: Axis, value: impl Fn(&Frame) -> Option<f64>) -> Axis {
        let seen = self.frames.iter().filter_map(value).filter(|v| v.is_finite());
        let (lo, hi) =
            seen.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if lo < hi { axis.range(lo, hi) } else { axis }
    }
}

/// Draws `data` into the picture `path` and reports it.
pub(super) fn run(
    data: &Path,
    path: &Path,
    only: &[String],
    by_agent: bool,
    theme: Theme,
) -> Outcome {
    draw(data, path, only, by_agent, theme)?;
    out::line(&path.display().to_string())
}

/// Draws `data` into the picture `path` (png or svg), with all agents together or one per column.
pub(super) fn draw(
    data: &Path,
    path: &Path,
    only: &[String],
    by_agent: bool,
    theme: Theme,
) -> Outcome {
    let data = Dataset::open(data, Verify::Structure)?;
    let m = data.manifest();
    let names = &m.robot.joints;
    if let Some(unknown) = only.iter().find(|n| !names.contains(n)) {
        return Err(Failure::usage(format!(
            "{} has no joint \"{unknown}\"; it has {}",
            m.robot.id,
            names.join(", ")
        )));
    }
    let joints: Vec<usize> = (0..names.len())
        .filter(|&j| only.is_empty() || names.get(j).is_some_and(|n| only.contains(n)))
        .collect();
    let sample = sample(&data);
    if sample.frames.is_empty() {
        let path = data.path().display();
        return Err(Failure::invalid(format!("nothing to draw: {path} lists no trajectory")));
    }
    let axis = |j: usize| {
        let unit = m.robot.units.get(j).map_or("", |u| u.symbol());
        let axis = Axis::new(names.get(j).map_or("", String::as_str), unit);
        match m.robot.ranges.get(j) {
            Some(Some([lo, hi])) => axis.range(*lo, *hi),
            _ => sample.span(axis, |f| f.1.get(j).copied()),
        }
    };
    let speed_axis = |j: usize| {
        let per_sec = match m.robot.units.get(j) {
            Some(Unit::M) => "m/s",
            _ => "rad/s",
        };
        let name = names.get(j).map_or("", String::as_str);
        sample.span(Axis::new(&format!("{name} speed"), per_sec), |f| f.2.get(j).copied())
    };
    // Planes (title, joint, joint or own speed) of one agent's frames, or of all.
    let plane = |title: &str, who: Option<usize>, a: usize, b: Option<usize>| {
        let frames = sample.frames.iter().filter(|f| who.is_none_or(|w| w == f.0));
        let points: Vec<(f64, f64)> = frames
            .filter_map(|f| {
                Some((*f.1.get(a)?, b.map_or_else(|| f.2.get(a), |b| f.1.get(b))?.to_owned()))
            })
            .collect();
        coverage(title, &points, CELLS, axis(a), b.map_or_else(|| speed_axis(a), axis))
    };
    let pairs: Vec<(usize, Option<usize>)> =
        joints.iter().zip(joints.iter().skip(1)).map(|(&a, &b)| (a, Some(b))).collect();
    let speeds: Vec<(usize, Option<usize>)> = joints.iter().map(|&j| (j, None)).collect();
    let few = |list: &[(usize, Option<usize>)], n| list.iter().copied().take(n).collect::<Vec<_>>();
    let mut panels: Vec<Panel> = Vec::new();
    let columns = if by_agent {
        let planes = [few(&pairs, PLANES_BY_AGENT), few(&speeds, PLANES_BY_AGENT)].concat();
        for (row, (a, b)) in planes.into_iter().enumerate() {
            let first = panels.len();
            for (k, name) in sample.agents.iter().enumerate() {
                let title = if row == 0 { name.as_str() } else { "" };
                panels.push(plane(title, Some(k), a, b));
            }
            one_scale(panels.get_mut(first..).unwrap_or_default());
        }
        sample.agents.len().max(1)
    } else {
        panels.extend(joints.iter().map(|&j| lines(&sample, axis(j), |f| f.1[j])));
        let unit = if m.robot.units.contains(&Unit::M) { "m/s" } else { "rad/s" };
        panels.push(lines(&sample, Axis::new("fastest joint", unit), |f| {
            joints.iter().filter_map(|&j| f.2.get(j)).fold(0.0, |a: f64, v| a.max(v.abs()))
        }));
        for (a, b) in [few(&pairs, PLANES), few(&speeds, PLANES)].concat() {
            panels.push(plane("", None, a, b));
        }
        if panels.len() > 16 { 5 } else { 4 }
    };
    let s = &m.statistics;
    let note = format!(
        "{} frames of {} trajectories by {}; coverage {:.1} %, any joint near a stop in {:.0} %, self-contact in {:.0} %",
        m.totals.frames,
        m.totals.episodes,
        sample.agents.join(", "),
        s.coverage * 100.0,
        s.near_limit_any * 100.0,
        s.self_contact * 100.0,
    );
    let figure = Figure::grid(&format!("{}: visited states", m.robot.id), panels, columns);
    super::plot::save(&figure.note(&note).theme(theme), path)
}

fn sample(data: &Dataset) -> Sample {
    let m = data.manifest();
    let every = m.totals.frames.div_ceil(FRAMES).max(1);
    let s = m.qpos_dim();
    let agents: Vec<String> = m.statistics.agents.keys().cloned().collect();
    let mut frames = Vec::new();
    let mut at = 0_u64;
    for e in data.episodes() {
        let agent = agents.iter().position(|a| *a == e.agent).unwrap_or(0);
        let (qpos, qvel, _) = data.frames(e);
        for (q, v) in qpos.chunks_exact(s).zip(qvel.chunks_exact(s)) {
            if at.is_multiple_of(every) {
                let wide = |x: &[f32]| x.iter().map(|&v| f64::from(v)).collect();
                frames.push((agent, wide(q), wide(v)));
            }
            at += 1;
        }
    }
    Sample { agents, frames }
}

/// A histogram of `value`, one line for each agent.
fn lines(sample: &Sample, x: Axis, value: impl Fn(&Frame) -> f64) -> Panel {
    let values: Vec<(usize, f64)> = sample.frames.iter().map(|f| (f.0, value(f))).collect();
    let (lo, hi) = x.range.unwrap_or_else(|| {
        let ends = |(a, b): (f64, f64), v: &(usize, f64)| (a.min(v.1), b.max(v.1));
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), ends)
    });
    let wide = ((hi - lo) / BINS as f64).max(1e-9);
    let several = sample.agents.len() > 1;
    let layers = sample.agents.iter().enumerate().map(|(k, name)| {
        let mut heights = vec![0.0; BINS];
        let mut count = 0.0;
        for &(_, v) in values.iter().filter(|(agent, _)| *agent == k) {
            count += 1.0;
            let bin = ((v - lo) / wide).floor();
            if bin >= 0.0
                && let Some(h) = heights.get_mut((bin as usize).min(BINS - 1))
            {
                *h += 100.0;
            }
        }
        for h in &mut heights {
            *h /= f64::max(count, 1.0);
        }
        if several {
            let middle = |i: usize| lo + wide * (i as f64 + 0.5);
            let points = heights.iter().enumerate().map(|(i, &h)| (middle(i), h)).collect();
            Layer::Line { name: name.clone(), points, color: k, dash: crate::plot::Dash::Solid }
        } else {
            let edges = (0..=BINS).map(|i| lo + wide * i as f64).collect();
            Layer::Histogram { name: String::new(), edges, heights, color: 0 }
        }
    });
    Panel {
        title: String::new(),
        y: Axis::new("frames", "%").from_zero(),
        layers: layers.collect(),
        x: if x.range.is_some() { x } else { x.range(lo, hi.max(lo + 1e-9)) },
        equal: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agents_share_their_axes() {
        let frame = |agent, q: f64, v: f64| (agent, vec![q], vec![v]);
        let frames = vec![frame(0, 1.0, f64::NAN), frame(1, -2.0, 0.5), frame(0, 0.0, 0.5)];
        let sample = Sample { agents: vec!["a".into(), "b".into()], frames };
        let axis = || Axis::new("x", "m");
        assert_eq!(sample.span(axis(), |f| f.1.first().copied()).range, Some((-2.0, 1.0)));
        assert_eq!(sample.span(axis(), |f| f.2.first().copied()).range, None);
    }
}
