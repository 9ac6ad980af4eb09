//! The parts that `rollout` and `export` share: the options of a rollout, and performing it.

use std::str::FromStr;
use std::sync::Arc;
use std::time::Instant;

use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::global::{Global, Threads};
use super::interrupt::cancel_on_ctrl_c;
use super::{motion, out};
use crate::clip::{self, Clip};
use crate::progress::{Cancel, Progress as _};
use crate::robot::{self, PlantConfig, Robot};
use crate::rollout::{
    Chosen, ClipFacts as _, Contenders, Error, Guide, PolicyConfig, PolicyName, Rollout,
    RolloutConfig, Start, Trial,
};
use crate::take::{Provenance, Take};
use crate::units::significant;

/// The policy, its conditions, the seed and the robot.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct PerformArgs {
    /// The policy [default: auto, the best of several]; --help lists all.
    #[arg(short, long, long_help = who("The policy [default: auto]:"))]
    pub(super) policy: Option<String>,
    #[command(flatten)]
    conditions: Conditions,
    /// Seed of the policy's random choices.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The robot, if it is not the clip's own.
    #[arg(long, value_name = "ID|DIR")]
    pub(super) robot: Option<String>,
    #[command(flatten)]
    threads: Threads,
}

/// Every policy with its argument, and the options that may follow it.
pub(super) fn who(head: &str) -> String {
    let rows: Vec<String> =
        PolicyName::usages().map(|(usage, what)| format!("  {usage:<25} {what}")).collect();
    format!(
        "{head}\n{}\nOptions after the name: +guide and +smooth are --guide linear and smooth, +refine is --refine, for this policy alone (robert:adaptive is best with +guide). +ilc repeats the clip six times in simulation and moves the goals by what was missed; where joints stay away, it follows the path of iLQR, and then searches at random; where gaps jolt, it tries softer motion. auto does so too, unless it refines, and takes iLQR itself where that is clearly nearer and the error of the others could be seen. robert also has +ensemble=N (mean over N windows, 1 to 21), +sample (draws the action bin), +mean (takes the mean of all bins), +masks (the network fills the gaps itself) and +ahead=N (the network sees one goal a window, N frames ahead). ridge also has +gain (scales its answer by what past actions reveal of the robot). robert and ridge have +observer=N (adds what past motion shows to be missing in the actions, such as torque for a load; the newest frame counts N percent, 30 is usual, and 0 turns off what the model's file says; robert:adaptive cannot have it).",
        rows.join("\n")
    )
}

/// The conditions for every policy; shared with `robert eval`.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct Conditions {
    /// The goals that fill masked frames before the policy sees them.
    #[arg(long, value_enum, default_value_t = GuideArg::None)]
    guide: GuideArg,
    /// Improve each action on the robot's model before it is applied.
    #[arg(long)]
    refine: bool,
    /// Simulate another plant than the robot's file: factors such as
    /// mass=1.25,damping=1.5,gear=0.85, and payload=2, a mass of 2 kg at the tool. robert eval also
    /// accepts ranges such as mass=0.7..1.4 and draws one plant per seed.
    #[arg(long, value_name = "FACTORS")]
    plant: Option<String>,
}

impl Conditions {
    /// A policy as it is typed, under these conditions.
    pub(super) fn policy(&self, text: &str) -> Outcome<PolicyConfig> {
        motion::policy(text, self.guide.into(), self.refine)
    }

    /// The simulated plant, or the range of plants.
    pub(super) fn plant<P: FromStr<Err = robot::Error> + Default>(&self) -> Outcome<P> {
        Ok(self.plant.as_deref().map(str::parse).transpose()?.unwrap_or_default())
    }
}

impl PerformArgs {
    /// The options of a rollout that were given; without effect where nothing is performed.
    pub(super) fn given(&self) -> Vec<&'static str> {
        let all = [
            ("--policy", self.policy.is_some()),
            ("--guide", self.conditions.guide != GuideArg::None),
            ("--refine", self.conditions.refine),
            ("--plant", self.conditions.plant.is_some()),
            ("--seed", self.seed != 0),
            ("--threads", self.threads.threads.is_some()),
        ];
        all.into_iter().filter(|(_, given)| *given).map(|(flag, _)| flag).collect()
    }

    /// Refuses options of a rollout when the input is a take, which has been performed already.
    pub(super) fn must_be_absent(&self, take: &str) -> Outcome {
        self.given().first().map_or(Ok(()), |flag| Err(performed_already(take, flag)))
    }

    /// The policy from the command line, else auto.
    fn policy(&self) -> Outcome<PolicyConfig> {
        Ok(self.named()?.unwrap_or_else(|| PolicyConfig {
            guide: self.conditions.guide.into(),
            refine: self.conditions.refine,
            ..PolicyConfig::new(PolicyName::Auto)
        }))
    }

    /// The policy from the command line. It is parsed before the robot is loaded, so that a typo
    /// shows at once.
    pub(super) fn named(&self) -> Outcome<Option<PolicyConfig>> {
        self.policy.as_deref().map(|p| self.conditions.policy(p)).transpose()
    }
}

/// The refusal of an option of a rollout for a take.
pub(super) fn performed_already(take: &str, flag: &str) -> Failure {
    // `robert rollout` has one policy, whatever the option is called elsewhere.
    let there = flag.replace("--compare-policy", "--policy");
    Failure::usage(format!(
        "{take} is a take, which has been performed already; {flag} is only for clips (robert rollout {take} {there} ... performs its clip again)"
    ))
}

/// [`Guide`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum GuideArg {
    /// The policy sees the masks.
    None,
    /// The straight line from the reached state to the next goal.
    Linear,
    /// A smooth curve from goal to goal through the whole gap.
    Smooth,
}

impl From<GuideArg> for Guide {
    fn from(arg: GuideArg) -> Guide {
        match arg {
            GuideArg::None => Guide::None,
            GuideArg::Linear => Guide::Linear,
            GuideArg::Smooth => Guide::Smooth,
        }
    }
}

/// A clip on its way through a policy.
#[derive(Debug)]
pub(super) struct Performed {
    pub clip: Clip,
    pub command: clip::Command,
    pub robot: Arc<Robot>,
    pub rollout: Rollout,
    pub policy: PolicyConfig,
    /// All policies that were tried, if auto chose the policy.
    pub tried: Vec<Trial>,
    pub config: RolloutConfig,
    /// Seconds of all of it, from the policy's loading on.
    pub wall_secs: f64,
    /// Seconds of the frames alone; `None` if they were simulated while policies were compared.
    pub frame_secs: Option<f64>,
    /// Why it ended early, if it did. The frames before that are kept.
    pub broke: Option<Error>,
    /// Whether the search for a better motion was stopped. The motion is the best one until then.
    pub stopped: bool,
}

impl Performed {
    /// Milliseconds of a frame, without loading and comparing policies.
    pub(super) fn ms_per_frame(&self) -> Option<f64> {
        self.frame_secs.map(|secs| 1e3 * secs / self.rollout.frame().max(1) as f64)
    }

    /// Whether a model of the robot was used: by the policy, or by the simulation that chose it.
    pub(super) fn uses_model(&self) -> bool {
        self.rollout.uses_model() || !self.tried.is_empty()
    }

    /// The recording.
    pub(super) fn take(&self) -> Outcome<Take> {
        let provenance = Provenance::new(&self.robot, &self.policy, &self.config)?;
        Ok(Take::record(&self.rollout, &self.command, Some(&self.clip), provenance)?)
    }
}

/// Performs a clip (a file, or a built-in task) with a progress bar on stderr.
pub(super) fn perform(text: &str, args: &PerformArgs, global: Global) -> Outcome<Performed> {
    let clip = motion::clip(text, args.robot.as_deref())?;
    let robot = motion::robot_for(args.robot.as_deref(), &clip.robot.id)?;
    let asked = args.policy()?;
    let plant: PlantConfig = args.conditions.plant()?;
    let command = motion::command(&clip, &robot, text)?;
    let cancel = cancel_on_ctrl_c();
    let begin = Instant::now();
    let searches = asked.is_tried();
    let (policy, chosen) = if searches {
        let chosen = choose(&robot, &asked, &command, args, &cancel, global);
        if chosen.is_err() && !global.quiet && !cancel.is_cancelled() {
            warn(&clip, &command, &robot);
        }
        let chosen = chosen?;
        // The policies are compared on the nominal plant; on another one the best performs again.
        (chosen.policy.clone(), Some(chosen))
    } else {
        (asked, None)
    };
    let config = RolloutConfig { seed: args.seed, guide: policy.guide, plant };
    let (mut rollout, tried) = match chosen {
        Some(chosen) if config.plant == PlantConfig::default() => (chosen.rollout, chosen.tried),
        Some(chosen) => {
            let again = chosen.again(&command, &Start::Pose, args.seed, config.plant)?;
            (again, chosen.tried)
        }
        None => {
            let built = policy.build(&robot)?;
            let fresh = Rollout::new(&robot, built, &command, Start::Pose, config.clone())?;
            (fresh, Vec::new())
        }
    };
    let bar = Bar::new(&policy.label(), "frames", global.quiet);
    let steps = rollout.frames().saturating_sub(1) as u64;
    let unit = motion::unit(&robot);
    let (first, simulated) = (rollout.frame(), Instant::now());
    let broke = loop {
        // What was found until a search was stopped is whole.
        if cancel.is_cancelled() && !rollout.is_done() {
            break Some(Error::Cancelled { frame: rollout.frame() });
        }
        match rollout.step() {
            Ok(Some(frame)) => {
                let note = frame
                    .error
                    .map_or_else(String::new, |e| format!("error {} {unit}", significant(e)));
                bar.tick(frame.frame as u64, steps, &note);
            }
            Ok(None) => break None,
            Err(e) => break Some(e),
        }
    };
    let frame_secs = (rollout.frame() > first).then(|| simulated.elapsed().as_secs_f64());
    let wall_secs = begin.elapsed().as_secs_f64();
    bar.finish();
    let stopped = searches && cancel.is_cancelled() && broke.is_none();
    if !global.quiet {
        if stopped {
            out::aside("stopped: this is the best motion that was found until then");
        }
        warn(&clip, &command, &robot);
    }
    Ok(Performed {
        clip,
        command,
        robot,
        rollout,
        policy,
        tried,
        config,
        wall_secs,
        frame_secs,
        broke,
        stopped,
    })
}

/// Prints what is wrong with a clip, and end-effector goals that are out of reach. The motion of such a
/// clip says little about the policy.
fn warn(clip: &Clip, command: &clip::Command, robot: &Robot) {
    let found = clip::lint(clip, command, &robot.joint_table(), None);
    let (wrong, missed): (Vec<_>, Vec<_>) = found
        .iter()
        .filter(|l| l.level == clip::Level::Error || l.rule == clip::Rule::Unreachable)
        .partition(|l| l.level == clip::Level::Error);
    for list in [wrong, missed] {
        if let Some(first) = list.first() {
            let more = match list.len() {
                1 => String::new(),
                n => format!(", and {} more", n - 1),
            };
            out::aside(format!("warning: {}{more}: see robert clip check", first.message));
        }
    }
}

/// Tries all contenders, with a progress bar.
fn choose(
    robot: &Arc<Robot>,
    asked: &PolicyConfig,
    command: &clip::Command,
    args: &PerformArgs,
    cancel: &Cancel,
    global: Global,
) -> Outcome<Chosen> {
    let contenders = Contenders::new(robot, asked)?;
    let bar = Bar::new(&asked.label(), "frames", global.quiet);
    let threads = args.threads.count();
    let chosen = contenders.perform(command, &Start::Pose, args.seed, threads, &bar, cancel);
    bar.finish();
    Ok(chosen?)
}
