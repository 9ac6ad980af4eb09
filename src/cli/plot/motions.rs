//! Charts of motions: joints, paths, precision and coverage.

use std::path::{Path, PathBuf};

use super::columns::{Columns, Selection, Units, asked};
use crate::cli::failure::{Failure, Outcome};
use crate::plot::{self, Axis, Curve, Figure, JointTrack, coverage, histogram, joints, xy};
use crate::units::FPS;

/// Command and reached motion, one small chart per joint.
pub(super) fn joint_chart(
    achieved: &Path,
    command: Option<&Path>,
    Selection { only, unit }: &Selection,
    title: &str,
) -> Outcome<Figure> {
    let command = asked(command, [achieved])?;
    let file = achieved;
    let achieved = Columns::read(achieved)?;
    if let Some(command) = command.as_ref().filter(|c| !c.shares_any(&achieved)) {
        return Err(command.foreign(&achieved, file));
    }
    let names = achieved.pick(only)?;
    let tracks: Vec<JointTrack> = names
        .iter()
        .map(|n| JointTrack {
            name: n.clone(),
            unit: achieved.unit_of(n, unit),
            commanded: command.as_ref().and_then(|c| c.of(n)).cloned().unwrap_or_default(),
            achieved: achieved.of(n).cloned().unwrap_or_default(),
        })
        .collect();
    Ok(joints(title, &tracks, f64::from(FPS)))
}

/// Paths in the plane of the first two columns.
pub(super) fn path_chart(
    files: Vec<(String, PathBuf)>,
    command: Option<&Path>,
    unit: &Units,
    title: &str,
) -> Outcome<Figure> {
    let mut paths = Vec::new();
    let command = asked(command, files.iter().map(|f| f.1.as_path()))?;
    let mut axes: Option<[Axis; 2]> = None;
    for (name, path) in files {
        let columns = Columns::read(&path)?;
        let own = columns.plane_axes(unit, &path)?;
        let common = axes.get_or_insert_with(|| own.clone());
        if *common != own {
            return Err(Failure::invalid(format!(
                "{}: its plane is {}, but that of the first file is {}",
                path.display(),
                own.each_ref().map(Axis::text).join(", "),
                common.each_ref().map(Axis::text).join(", ")
            )));
        }
        let points = columns.plane(&path)?;
        paths.push(Curve { name, points, ci95: vec![] });
    }
    let crosses = match command {
        Some(command) => command.plane(Path::new("the command"))?,
        None => Vec::new(),
    };
    let [x, y] = axes.unwrap_or_default();
    Ok(xy(title, &paths, &crosses, x, y))
}

/// Mean absolute error over time.
pub(super) fn precision_chart(
    files: Vec<(String, PathBuf)>,
    command: Option<&Path>,
    unit: &Units,
    title: &str,
) -> Outcome<Figure> {
    let command = asked(command, files.iter().map(|f| f.1.as_path()))?;
    let Some(command) = command else {
        return Err(Failure::usage(
            "there is no command to compare with: CSV files contain none; give --command FILE, or a take (.mcap)",
        ));
    };
    let mut lines = Vec::new();
    let mut own = None;
    for (name, path) in files {
        let reached = Columns::read(&path)?;
        if !command.names.iter().all(|n| reached.of(n).is_some()) {
            return Err(command.foreign(&reached, &path));
        }
        own.get_or_insert_with(|| reached.unit(unit));
        let points = (0..command.frames).map(|f| (f as f64, command.error(&reached, f))).collect();
        lines.push(Curve { name, points, ci95: vec![] });
    }
    let masked = command.masked();
    let unit = own.unwrap_or_default();
    Ok(plot::precision(title, &lines, &unit, &masked, f64::from(FPS)))
}

/// Histograms of joint values, and the first two joints against each other.
pub(super) fn coverage_chart(
    motion: &Path,
    Selection { only, unit }: &Selection,
    title: &str,
) -> Outcome<Figure> {
    let columns = Columns::read(motion)?;
    let names = columns.pick(only)?;
    let of = |n: &str| columns.of(n).cloned().unwrap_or_default();
    let axis = |label: &str, n: &str| Axis::new(label, &columns.unit_of(n, unit));
    let mut panels: Vec<_> = names.iter().map(|n| histogram(n, &of(n), 40, axis("", n))).collect();
    if let [a, b, ..] = names.as_slice() {
        let points: Vec<(f64, f64)> = of(a).into_iter().zip(of(b)).collect();
        let title = format!("{a} against {b}");
        panels.push(coverage(&title, &points, 48, axis(a, a), axis(b, b)));
    }
    let across = panels.len().clamp(1, 4);
    Ok(Figure::grid(title, panels, across).panel_size(300, 230))
}
