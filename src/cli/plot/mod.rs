//! `robert plot`: draws charts from takes, tables and results.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::failure::{Failure, Outcome};
use super::{input, motion, out};
use crate::plot::{
    self, Axis, Curve, Figure, JointTrack, Panel, Theme, bars, coverage, curves, histogram, joints,
    xy,
};
use crate::take::{Take, What as Asked};
use crate::units::FPS;
use crate::{fsio, limits};

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert plot joints achieved.csv --command command.csv -o joints.png\n  robert plot xy achieved.csv --command command.csv -o star.svg\n  robert plot precision pd=a.csv ilqr=b.csv --command command.csv -o precision.png\n  robert plot curves runs/a/metrics.jsonl runs/b/metrics.jsonl --y loss --log -o loss.png\n  robert plot coverage achieved.csv -o coverage.png\n  robert plot precision pd=pd.mcap ilqr=ilqr.mcap -o precision.png   takes contain their command\n  robert eval --robot ur5e --suite manual -p pd,ilqr --json > eval.json\n  robert plot bars eval.json -o bars.png\n\nA motion is a take (.mcap) or a CSV file with the columns frame, time, mask and one per joint; an empty cell is masked."
)]
pub(super) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Args, Debug)]
struct Common {
    /// The file to write, .png or .svg; - writes SVG to stdout.
    #[arg(short, long, alias = "output")]
    out: PathBuf,
    /// Title of the chart.
    #[arg(long, default_value = "")]
    title: String,
    /// Use a dark background.
    #[arg(long)]
    dark: bool,
}

/// The columns of a motion that are drawn.
#[derive(clap::Args, Debug)]
struct Selection {
    /// Draw only these joints.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    #[command(flatten)]
    unit: Units,
}

/// The unit of the values in a file.
#[derive(clap::Args, Debug)]
struct Units {
    /// Unit of the joints [default: a take's own; rad for a table].
    #[arg(long)]
    unit: Option<String>,
}

#[derive(clap::Subcommand, Debug)]
enum What {
    /// Command and reached motion, one small chart per joint.
    #[command(
        after_help = "Examples:\n  robert plot joints wave.mcap -o joints.png\n  robert plot joints achieved.csv --command command.csv --only elbow,wrist_1 -o joints.svg"
    )]
    Joints {
        /// Achieved motion: a take or CSV.
        achieved: PathBuf,
        /// Command, CSV [default: the take's own].
        #[arg(long)]
        command: Option<PathBuf>,
        #[command(flatten)]
        joints: Selection,
        #[command(flatten)]
        common: Common,
    },
    /// Paths in the plane of the first two columns.
    #[command(
        after_help = "Examples:\n  robert plot xy star.mcap -o star.svg\n  robert plot xy pd=a.csv ilqr=b.csv --command command.csv --unit m -o star.png"
    )]
    Xy {
        /// Achieved motions, takes or CSV; `name=file` names a path.
        achieved: Vec<String>,
        /// Command, CSV [default: that of the first take].
        #[arg(long)]
        command: Option<PathBuf>,
        #[command(flatten)]
        unit: Units,
        #[command(flatten)]
        common: Common,
    },
    /// Mean absolute error over time.
    #[command(
        after_help = "Examples:\n  robert plot precision pd=pd.mcap ilqr=ilqr.mcap -o precision.png"
    )]
    Precision {
        /// Achieved motions, takes or CSV; `name=file` names a method.
        achieved: Vec<String>,
        /// Command, CSV [default: that of the first take].
        #[arg(long)]
        command: Option<PathBuf>,
        #[command(flatten)]
        unit: Units,
        #[command(flatten)]
        common: Common,
    },
    /// A figure over training steps, from metrics.jsonl files. Files with the same name become a
    /// mean with its 95 % interval.
    #[command(
        after_help = "Examples:\n  robert plot curves runs/a/metrics.jsonl runs/b/metrics.jsonl --y loss --log -o loss.png"
    )]
    Curves {
        /// Metrics, one JSON object per line; `name=file` names a run.
        metrics: Vec<String>,
        /// Field on the x axis.
        #[arg(long, default_value = "step")]
        x: String,
        /// Field on the y axis.
        #[arg(long, default_value = "loss")]
        y: String,
        /// Unit of y.
        #[arg(long, default_value = "")]
        unit: String,
        /// Use a logarithmic y axis.
        #[arg(long)]
        log: bool,
        #[command(flatten)]
        common: Common,
    },
    /// Bars with 95 % intervals from the JSON of `robert eval`, or from `{"unit": "rad", "groups":
    /// [..], "sets": [{"name": .., "mean": [..], "ci95": [..]}]}`.
    #[command(
        after_help = "Examples:\n  robert eval --robot ur5e --suite manual -p pd,ilqr --json > eval.json\n  robert plot bars eval.json -o bars.png"
    )]
    Bars {
        /// The file.
        file: PathBuf,
        /// The suite to draw [default: the first of the report].
        #[arg(long)]
        suite: Option<String>,
        #[command(flatten)]
        common: Common,
    },
    /// Histograms of joint values, and the first two joints against each other.
    #[command(after_help = "Examples:\n  robert plot coverage achieved.csv -o coverage.png")]
    Coverage {
        /// Motion: a take or CSV.
        motion: PathBuf,
        #[command(flatten)]
        joints: Selection,
        #[command(flatten)]
        common: Common,
    },
}

pub(super) fn run(args: &Args) -> Outcome {
    let fps = f64::from(FPS);
    let (figure, common) = match &args.what {
        What::Joints { achieved, command, joints: Selection { only, unit }, common } => {
            let command = asked(command.as_deref(), [achieved.as_path()])?;
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
            (joints(&common.title, &tracks, fps), common)
        }
        What::Xy { achieved, command, unit, common } => {
            let mut paths = Vec::new();
            let files = named(achieved)?;
            let command = asked(command.as_deref(), files.iter().map(|f| f.1.as_path()))?;
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
            (xy(&common.title, &paths, &crosses, x, y), common)
        }
        What::Precision { achieved, command, unit, common } => {
            let files = named(achieved)?;
            let command = asked(command.as_deref(), files.iter().map(|f| f.1.as_path()))?;
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
                let points =
                    (0..command.frames).map(|f| (f as f64, command.error(&reached, f))).collect();
                lines.push(Curve { name, points, ci95: vec![] });
            }
            let masked = command.masked();
            let unit = own.unwrap_or_default();
            (plot::precision(&common.title, &lines, &unit, &masked, fps), common)
        }
        What::Curves { metrics, x, y, unit, log, common } => {
            let mut runs: BTreeMap<String, Vec<Vec<(f64, f64)>>> = BTreeMap::new();
            for (name, path) in named(metrics)? {
                runs.entry(name).or_default().push(series(&path, x, y)?);
            }
            let lines: Vec<Curve> =
                runs.into_iter().map(|(name, runs)| mean(name, &runs)).collect();
            let axis = Axis::new(y, unit);
            let axis = if *log { axis.log() } else { axis };
            (curves(&common.title, &lines, Axis::new(x, ""), axis), common)
        }
        What::Bars { file, suite, common } => {
            (bar_chart(file, suite.as_deref(), &common.title)?, common)
        }
        What::Coverage { motion, joints: Selection { only, unit }, common } => {
            let columns = Columns::read(motion)?;
            let names = columns.pick(only)?;
            let of = |n: &str| columns.of(n).cloned().unwrap_or_default();
            let axis = |label: &str, n: &str| Axis::new(label, &columns.unit_of(n, unit));
            let mut panels: Vec<_> =
                names.iter().map(|n| histogram(n, &of(n), 40, axis("", n))).collect();
            if let [a, b, ..] = names.as_slice() {
                let points: Vec<(f64, f64)> = of(a).into_iter().zip(of(b)).collect();
                let title = format!("{a} against {b}");
                panels.push(coverage(&title, &points, 48, axis(a, a), axis(b, b)));
            }
            let across = panels.len().clamp(1, 4);
            (Figure::grid(&common.title, panels, across).panel_size(300, 230), common)
        }
    };
    let theme = if common.dark { Theme::Dark } else { Theme::Light };
    save(&figure.theme(theme), &common.out)?;
    if input::is_standard(&common.out) {
        return Ok(());
    }
    out::line(&common.out.display().to_string())
}

/// Writes a figure; on stdout it is SVG.
pub(super) fn save(figure: &Figure, path: &Path) -> Outcome {
    if input::is_standard(path) {
        return out::bytes(figure.svg()?.as_bytes());
    }
    Ok(figure.save(path)?)
}

/// Checks before the work whether a chart can be written to this file.
pub(super) fn may_save(path: &Path) -> Outcome {
    if !input::is_standard(path) {
        Figure::may_save(path)?;
        fsio::writable(path)?;
    }
    Ok(())
}

/// `name=file`, or a file that is named after its folder (`metrics.jsonl`) or its stem. If the
/// whole text is an existing file, its name contains an equals sign.
fn named(list: &[String]) -> Outcome<Vec<(String, PathBuf)>> {
    if list.is_empty() {
        return Err(Failure::usage("at least one file is needed"));
    }
    let stem = |p: &Path| p.file_stem().map(|s| s.to_string_lossy().into_owned());
    let one = |text: &String| match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !Path::new(text).exists() => {
            (name.to_owned(), PathBuf::from(path))
        }
        _ => {
            let path = PathBuf::from(text);
            let folder = path.parent().and_then(Path::file_name);
            let name = match (stem(&path), folder) {
                (Some(s), Some(f)) if s == "metrics" => f.to_string_lossy().into_owned(),
                (Some(s), _) => s,
                (None, _) => text.clone(),
            };
            (name, path)
        }
    };
    Ok(list.iter().map(one).collect())
}

/// The joint columns of a motion CSV.
struct Columns {
    names: Vec<String>,
    /// Units by joint, if the file knows them.
    units: BTreeMap<String, &'static str>,
    values: Vec<Vec<f64>>,
    frames: usize,
}

/// The command of a chart: the named file, else that of the first take.
fn asked<'a>(
    file: Option<&Path>,
    motions: impl IntoIterator<Item = &'a Path>,
) -> Outcome<Option<Columns>> {
    if let Some(file) = file {
        return Columns::of_file(file, Asked::Command).map(Some);
    }
    let take = motions.into_iter().find(|p| motion::is_take(p));
    take.map(|p| Columns::of_file(p, Asked::Command)).transpose()
}

impl Columns {
    /// The motion in a file.
    fn read(path: &Path) -> Outcome<Columns> {
        Columns::of_file(path, Asked::Achieved)
    }

    fn of_file(path: &Path, what: Asked) -> Outcome<Columns> {
        if motion::is_take(path) {
            return Ok(Columns::of_take(&input::take(path)?, what));
        }
        Columns::parse(path, &input::read(path, limits::TABLE_BYTES)?)
    }

    fn of_take(take: &Take, what: Asked) -> Columns {
        let (robot, command) = (&take.robot, &take.command);
        let goal = |f: usize, j: usize| {
            let seen = command.sees(f as u32, j);
            if seen { f64::from(command.row(f as u32)[j]) } else { f64::NAN }
        };
        let value = |f: usize, j: usize| match what {
            Asked::Achieved => take.state(f)[j],
            Asked::Command => goal(f, j),
        };
        let (names, frames) = match what {
            Asked::Achieved => (&robot.joints[..], take.frames()),
            Asked::Command => (command.joints(), command.frames() as usize),
        };
        let joint = |j: usize| (0..frames).map(|f| value(f, j)).collect();
        Columns {
            names: names.to_vec(),
            units: robot
                .joints
                .iter()
                .cloned()
                .zip(robot.units.iter().map(|u| u.symbol()))
                .collect(),
            values: (0..names.len()).map(joint).collect(),
            frames,
        }
    }

    fn parse(path: &Path, bytes: &[u8]) -> Outcome<Columns> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
        let bad =
            |line: u64, why: String| Failure::invalid(format!("{}:{line}: {why}", path.display()));
        let head = reader.headers().map_err(|e| bad(1, e.to_string()))?.clone();
        let first = |name: &str| head.iter().position(|h| h == name);
        let frame = first("frame");
        // A joint may have one of these names; its column is the second.
        let lead = [frame, first("time"), first("mask")];
        let picked: Vec<(usize, String)> = head
            .iter()
            .enumerate()
            .filter(|(i, h)| !h.is_empty() && !lead.contains(&Some(*i)))
            .map(|(i, h)| (i, h.to_owned()))
            .collect();
        if picked.is_empty() {
            return Err(bad(1, "no joint columns; expected frame,time,mask,<joint>...".into()));
        }
        let mut values = vec![Vec::new(); picked.len()];
        let mut frames = 0;
        for (row, record) in reader.records().enumerate() {
            let line = row as u64 + 2;
            let record = record.map_err(|e| bad(line, e.to_string()))?;
            // The start, which is no frame of the motion.
            if frame.and_then(|i| record.get(i)).is_some_and(|cell| cell.starts_with('-')) {
                continue;
            }
            for ((i, name), column) in picked.iter().zip(&mut values) {
                let cell = record.get(*i).unwrap_or("");
                let value = if cell.is_empty() {
                    f64::NAN
                } else {
                    cell.parse()
                        .map_err(|_e| bad(line, format!("{name}: {cell:?} is not a number")))?
                };
                column.push(value);
            }
            frames += 1;
        }
        if frames == 0 {
            return Err(bad(2, "no rows".into()));
        }
        let names = picked.into_iter().map(|p| p.1).collect();
        Ok(Columns { names, units: BTreeMap::new(), values, frames })
    }

    fn of(&self, name: &str) -> Option<&Vec<f64>> {
        self.names.iter().position(|n| n == name).and_then(|i| self.values.get(i))
    }

    /// The unit of a joint: from the command line, else its own, else rad.
    fn unit_of(&self, name: &str, asked: &Units) -> String {
        let own = || self.units.get(name).copied().unwrap_or("rad").to_owned();
        asked.unit.clone().unwrap_or_else(own)
    }

    /// The unit of a mean over all joints.
    fn unit(&self, asked: &Units) -> String {
        let mut units: Vec<String> = self.names.iter().map(|n| self.unit_of(n, asked)).collect();
        units.sort_by(|a, b| b.cmp(a));
        units.dedup();
        units.join(" or ")
    }

    fn shares_any(&self, other: &Columns) -> bool {
        self.names.iter().any(|n| other.of(n).is_some())
    }

    /// Refuses a motion that was not made from this command.
    fn foreign(&self, motion: &Columns, path: &Path) -> Failure {
        let list = |names: &[String]| {
            let first = names.iter().take(4).cloned().collect::<Vec<_>>().join(", ");
            if names.len() > 4 { format!("{first}, ...") } else { first }
        };
        Failure::invalid(format!(
            "{}: its joints are {}, but those of the command are {}: is it another robot?",
            path.display(),
            list(&motion.names),
            list(&self.names)
        ))
    }

    fn pick(&self, only: &[String]) -> Outcome<Vec<String>> {
        if let Some(missing) = only.iter().find(|n| self.of(n).is_none()) {
            return Err(Failure::invalid(format!(
                "no column {missing:?}; there are: {}",
                self.names.join(", ")
            )));
        }
        Ok(if only.is_empty() { self.names.clone() } else { only.to_vec() })
    }

    /// The axes of the first two columns.
    fn plane_axes(&self, asked: &Units, path: &Path) -> Outcome<[Axis; 2]> {
        match self.names.as_slice() {
            [x, y, ..] => Ok([x, y].map(|n| Axis::new(n, &self.unit_of(n, asked)))),
            _ => Err(Failure::invalid(format!("{}: two columns are needed", path.display()))),
        }
    }

    fn plane(&self, path: &Path) -> Outcome<Vec<(f64, f64)>> {
        match self.values.as_slice() {
            [x, y, ..] => Ok(x.iter().copied().zip(y.iter().copied()).collect()),
            _ => Err(Failure::invalid(format!("{}: two columns are needed", path.display()))),
        }
    }

    /// Mean absolute error of a frame over the joints with a goal; NaN if there is no goal.
    fn error(&self, reached: &Columns, frame: usize) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for (name, goal) in self.names.iter().zip(&self.values) {
            let a = reached.of(name).and_then(|v| v.get(frame));
            if let (Some(a), Some(c)) = (a, goal.get(frame))
                && a.is_finite()
                && c.is_finite()
            {
                sum += (a - c).abs();
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { f64::NAN }
    }

    /// Stretches of more than one frame without a goal.
    fn masked(&self) -> Vec<(f64, f64)> {
        let seen = |f: usize| self.values.iter().any(|c| c.get(f).is_some_and(|v| v.is_finite()));
        let mut out = Vec::new();
        let mut from = None;
        for f in 0..=self.frames {
            match (f < self.frames && !seen(f), from) {
                (true, None) => from = Some(f),
                (false, Some(a)) => {
                    if f > a + 1 {
                        out.push((a as f64, (f - 1) as f64));
                    }
                    from = None;
                }
                _ => {}
            }
        }
        out
    }
}

/// The values of two fields in a file of JSON lines. Lines that lack one of them are other events.
fn series(path: &Path, x: &str, y: &str) -> Outcome<Vec<(f64, f64)>> {
    let bytes = input::read(path, limits::TABLE_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut points = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let value: serde_json::Value = serde_json::from_str(line)
            .map_err(|e| Failure::invalid(format!("{}:{}: {e}", path.display(), i + 1)))?;
        let field = |k: &str| value.get(k).and_then(serde_json::Value::as_f64);
        if let (Some(x), Some(y)) = (field(x), field(y)) {
            points.push((x, y));
        }
    }
    if points.is_empty() {
        return Err(Failure::invalid(format!("{}: no line has {x:?} and {y:?}", path.display())));
    }
    Ok(points)
}

/// Combines runs of one name into their mean at common x, with its interval.
fn mean(name: String, runs: &[Vec<(f64, f64)>]) -> Curve {
    if let [only] = runs {
        return Curve { name, points: only.clone(), ci95: Vec::new() };
    }
    let mut at: BTreeMap<u64, (f64, Vec<f64>)> = BTreeMap::new();
    for (x, y) in runs.iter().flatten().filter(|p| p.0 >= 0.0) {
        // Bits of a positive number sort as the number does.
        at.entry(x.to_bits()).or_insert_with(|| (*x, Vec::new())).1.push(*y);
    }
    let (mut points, mut ci95) = (Vec::new(), Vec::new());
    for (x, ys) in at.into_values().filter(|(_, ys)| ys.len() == runs.len()) {
        if let Some(i) = crate::rollout::mean_ci95(&ys) {
            points.push((x, i.mean));
            ci95.push(i.ci95.unwrap_or(0.0));
        }
    }
    Curve { name, points, ci95 }
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BarFile {
    #[serde(default)]
    unit: String,
    #[serde(default)]
    label: String,
    groups: Vec<String>,
    sets: Vec<BarSet>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BarSet {
    name: String,
    mean: Vec<Option<f64>>,
    #[serde(default)]
    ci95: Vec<Option<f64>>,
}

/// The part of `robert eval --json` that is read.
#[derive(serde::Deserialize)]
struct EvalFile {
    unit: String,
    results: Vec<EvalResult>,
}

#[derive(serde::Deserialize)]
struct EvalResult {
    policy: String,
    suite: String,
    precision_mean: Option<f64>,
    ci95: Option<f64>,
    tasks: Vec<EvalTask>,
}

#[derive(serde::Deserialize)]
struct EvalTask {
    name: String,
    precision: Option<f64>,
    ci95: Option<f64>,
}

impl EvalFile {
    /// Tasks and their mean as groups, policies as sets.
    fn bars(&self, path: &Path, suite: Option<&str>) -> Outcome<BarFile> {
        let wanted = suite.or(self.results.first().map(|r| r.suite.as_str())).unwrap_or_default();
        let results: Vec<&EvalResult> = self.results.iter().filter(|r| r.suite == wanted).collect();
        let Some(first) = results.first() else {
            let mut known: Vec<&str> = self.results.iter().map(|r| r.suite.as_str()).collect();
            known.dedup();
            return Err(Failure::invalid(format!(
                "{}: no suite {wanted:?}; there are: {}",
                path.display(),
                known.join(", ")
            )));
        };
        let mut groups: Vec<String> = first.tasks.iter().map(|t| t.name.clone()).collect();
        groups.push("mean".to_owned());
        let sets = results
            .iter()
            .map(|r| BarSet {
                name: r.policy.clone(),
                mean: r.tasks.iter().map(|t| t.precision).chain([r.precision_mean]).collect(),
                ci95: r.tasks.iter().map(|t| t.ci95).chain([r.ci95]).collect(),
            })
            .collect();
        Ok(BarFile { unit: self.unit.clone(), label: "Precision".to_owned(), groups, sets })
    }
}

fn bar_chart(path: &Path, suite: Option<&str>, title: &str) -> Outcome<Figure> {
    let bytes = input::read(path, limits::TABLE_BYTES)?;
    let bad = |e: serde_json::Error| {
        Failure::invalid(format!("{}:{}:{}: {e}", path.display(), e.line(), e.column()))
    };
    let value: serde_json::Value = serde_json::from_slice(&bytes).map_err(bad)?;
    let file: BarFile = if value.get("results").is_some() {
        serde_json::from_slice::<EvalFile>(&bytes).map_err(bad)?.bars(path, suite)?
    } else {
        serde_json::from_slice(&bytes).map_err(bad)?
    };
    file.check(path)?;
    Ok(file.figure(title))
}

impl BarFile {
    /// Refuses a file whose chart would be misleading.
    fn check(&self, path: &Path) -> Outcome {
        let bad = |why: String| Err(Failure::invalid(format!("{}: {why}", path.display())));
        if self.groups.is_empty() || self.sets.is_empty() {
            return bad("there is nothing to draw: no groups or no sets".to_owned());
        }
        let groups = self.groups.len();
        for s in &self.sets {
            if s.mean.len() != groups || !(s.ci95.is_empty() || s.ci95.len() == groups) {
                return bad(format!(
                    "set {:?} has {} means and {} intervals for {groups} groups",
                    s.name,
                    s.mean.len(),
                    s.ci95.len()
                ));
            }
        }
        Ok(())
    }

    fn figure(self, title: &str) -> Figure {
        let file = self;
        let set = |s: BarSet| {
            let values = (0..file.groups.len())
                .map(|i| {
                    let at = |v: &[Option<f64>]| v.get(i).copied().flatten();
                    (at(&s.mean).unwrap_or(f64::NAN), at(&s.ci95).unwrap_or(0.0))
                })
                .collect();
            (s.name, values)
        };
        let sets: Vec<_> = file.sets.into_iter().map(set).collect();
        let label = if file.label.is_empty() { "precision" } else { &file.label };
        bars(title, &file.groups, &sets, Axis::new(label, &file.unit))
    }
}

/// Every suite of an evaluation as bars with 95 % intervals; `report` as `robert eval --json`
/// prints it.
pub(super) fn of_evaluation(title: &str, report: serde_json::Value) -> Outcome<Figure> {
    let file: EvalFile = serde_json::from_value(report).map_err(std::io::Error::other)?;
    let mut suites: Vec<&str> = file.results.iter().map(|r| r.suite.as_str()).collect();
    suites.dedup();
    let several = suites.len() > 1;
    let (mut panels, mut size) = (Vec::new(), (0, 0));
    for suite in suites {
        let figure = file.bars(Path::new("the evaluation"), Some(suite))?.figure("");
        size = (size.0.max(figure.panel.0), size.1.max(figure.panel.1));
        let name = if several { suite } else { "" };
        panels.extend(figure.panels.into_iter().map(|p| Panel { title: name.to_owned(), ..p }));
    }
    Ok(Figure::grid(title, panels, 1).panel_size(size.0, size.1))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::clip::{Clip, compile};
    use crate::progress::Cancel;
    use crate::robot::Robot;
    use crate::rollout::{PolicyConfig, PolicyName, Rollout, RolloutConfig, Start};
    use crate::take::Provenance;

    /// A take whose start differs from its first goal, and whose joints have names of columns.
    fn take() -> Take {
        let text = r#"{"format": "robert-clip/1", "robot": {"id": "pointmass", "joints": ["x", "y"]},
            "fps": 20, "length": 5, "start": {"q": [0, 0]},
            "keys": [{"frame": 0, "q": [0.1, null]}, {"frame": 4, "q": [0.2, 0.3]}]}"#;
        let clip = Clip::parse(text).unwrap();
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let command = compile(&clip).unwrap();
        let (policy, config) = (PolicyConfig::new(PolicyName::Pd), RolloutConfig::default());
        let built = policy.build(&robot).unwrap();
        let mut rollout =
            Rollout::new(&robot, built, &command, Start::Pose, config.clone()).unwrap();
        rollout.run(&Cancel::default()).unwrap();
        let provenance = Provenance::new(&robot, &policy, &config).unwrap();
        let mut take = Take::record(&rollout, &command, Some(&clip), provenance).unwrap();
        take.robot.joints = vec!["time".to_owned(), "error".to_owned()];
        take
    }

    #[test]
    fn every_joint_of_a_take_is_a_column() {
        let take = take();
        let reached = Columns::of_take(&take, Asked::Achieved);
        assert_eq!(reached.names, ["time", "error"]);
        assert_eq!((reached.frames, reached.values[1].len()), (5, 5));
        assert_eq!(reached.values[1][4], take.state(4)[1]);
        // A CSV has its start before frame 0; here frame 0 is the first.
        let goals = Columns::of_take(&take, Asked::Command);
        assert!((goals.values[0][0] - 0.1).abs() < 1e-6 && goals.values[1][0].is_nan());
        assert!((goals.values[1][4] - 0.3).abs() < 1e-6 && goals.values[1].len() == 5);
    }

    #[test]
    fn a_table_may_have_a_joint_called_time() {
        let text = "frame,time,mask,time,error\n-1,-0.05,1,7,7\n0,0,0,1,2\n1,0.05,0,3,\n";
        let table = Columns::parse(Path::new("a.csv"), text.as_bytes()).unwrap();
        assert_eq!(table.names, ["time", "error"]);
        assert_eq!((table.frames, &table.values[0][..]), (2, &[1.0, 3.0][..]));
        assert!(table.values[1][1].is_nan());
    }
}
