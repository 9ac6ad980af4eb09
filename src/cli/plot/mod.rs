//! `robert plot`: draws charts from takes, tables and results.

mod columns;
mod evaluation;
mod metrics;
mod motions;

use std::path::{Path, PathBuf};

use super::failure::{Failure, Outcome};
use super::{input, out, output};
use crate::plot::{Axis, Figure, Theme};
use columns::{Selection, Units};

pub(super) use evaluation::of_evaluation;

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

/// Several motions with one command.
#[derive(clap::Args, Debug)]
struct Compared {
    /// Achieved motions, takes or CSV; `name=file` names one in the legend.
    achieved: Vec<String>,
    /// Command, CSV [default: that of the first take].
    #[arg(long)]
    command: Option<PathBuf>,
    #[command(flatten)]
    unit: Units,
    #[command(flatten)]
    common: Common,
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
    Xy(Compared),
    /// Mean absolute error over time.
    #[command(
        after_help = "Examples:\n  robert plot precision pd=pd.mcap ilqr=ilqr.mcap -o precision.png"
    )]
    Precision(Compared),
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
    let (figure, common) = match &args.what {
        What::Joints { achieved, command, joints, common } => {
            (motions::joint_chart(achieved, command.as_deref(), joints, &common.title)?, common)
        }
        What::Xy(Compared { achieved, command, unit, common }) => {
            let files = named(achieved)?;
            (motions::path_chart(files, command.as_deref(), unit, &common.title)?, common)
        }
        What::Precision(Compared { achieved, command, unit, common }) => {
            let files = named(achieved)?;
            (motions::precision_chart(files, command.as_deref(), unit, &common.title)?, common)
        }
        What::Curves { metrics, x, y, unit, log, common } => {
            let axis = Axis::new(y, unit);
            let axis = if *log { axis.log() } else { axis };
            (metrics::curve_chart(named(metrics)?, x, y, axis, &common.title)?, common)
        }
        What::Bars { file, suite, common } => {
            (evaluation::bar_chart(file, suite.as_deref(), &common.title)?, common)
        }
        What::Coverage { motion, joints, common } => {
            (motions::coverage_chart(motion, joints, &common.title)?, common)
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
        output::may_create(path)?;
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
