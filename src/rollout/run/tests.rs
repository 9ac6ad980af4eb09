//! Tests of rollouts: what an edit simulates again, and what a repeat leaves as it is.

use super::*;
use crate::{PolicyConfig, PolicyName};
use robert_base::rng::{Rng, Stream};

fn robot(id: &str) -> Arc<Robot> {
    Arc::new(Robot::builtin(id).unwrap())
}

/// Poses near home at a few frames, masked between.
fn command(robot: &Robot, frames: usize, keys: &[(usize, f64)]) -> Command {
    let dim = robot.state_dim();
    let home = robot.home();
    let (mut q, mut visible) = (vec![0.0_f32; frames * dim], vec![false; frames * dim]);
    for &(f, offset) in keys {
        for (j, joint) in robot.joints().iter().enumerate() {
            let v = (home[j] + offset * (j as f64 + 1.0).sin())
                .clamp(joint.range[0].max(-10.0), joint.range[1].min(10.0));
            q[f * dim + j] = v as f32;
            visible[f * dim + j] = true;
        }
    }
    let start = home.iter().map(|&v| v as f32).collect();
    let names = robot.joints().iter().map(|j| j.name.clone()).collect();
    Command::from_dense(names, start, q, visible).unwrap()
}

fn rollout(robot: &Arc<Robot>, name: PolicyName, command: &Command) -> Rollout {
    let policy = PolicyConfig::new(name).build(robot).unwrap();
    Rollout::new(robot, policy, command, Start::Pose, RolloutConfig::default()).unwrap()
}

fn bits(r: &Rollout) -> Vec<u64> {
    r.reached().iter().chain(r.actions()).map(|v| v.to_bits()).collect()
}

#[test]
fn a_gap_that_is_repeated_without_contact_leaves_the_rollout_as_it_is() {
    let robot = robot("shadow_hand");
    let dim = robot.state_dim();
    let mut ridge = PolicyConfig::new(PolicyName::Ridge);
    ridge.inference.gain = true;
    let cases = [
        (PolicyConfig::new(PolicyName::Pd), "rsp_high_mask"),
        (PolicyConfig::new(PolicyName::Random), "rsp_high_mask"),
        (ridge, "rsp_high_mask"),
    ];
    for (policy, name) in cases {
        let clip = crate::tasks::find(&format!("shadow_hand/{name}"), None).unwrap();
        let command = robert_clip::compile(&clip).unwrap();
        let begun = || {
            let built = policy.build(&robot).unwrap();
            let config = RolloutConfig::default();
            Rollout::new(&robot, built, &command, Start::Pose, config).unwrap()
        };
        let (mut whole, mut cut) = (begun(), begun());
        whole.run(&Cancel::default()).unwrap();
        while cut.frame() < 60 {
            cut.step().unwrap();
        }
        let reached = cut.states()[(HISTORY + 27) * dim..(HISTORY + 61) * dim].to_vec();
        let (memories, simulated) = (cut.memories.clone(), cut.simulated());
        let alone = cut.without_contact(26, 60, &|| false).unwrap();
        // The fingers push the thumb; without contact it stays where it is.
        assert_eq!(alone.len(), reached.len());
        let far = |states: &[f64]| {
            let thumb = states.chunks_exact(dim).map(|q| (q[dim - 1] - reached[dim - 1]).abs());
            thumb.fold(0.0, f64::max)
        };
        if policy.name != PolicyName::Random {
            assert!(far(&alone) < 0.03 && far(&reached) > 0.1, "{policy:?}");
        }
        assert_eq!((cut.frame(), cut.simulated()), (60, simulated));
        assert_eq!(cut.memories, memories, "{policy:?}");
        let stopped = cut.without_contact(26, 60, &|| true);
        assert!(matches!(stopped, Err(Error::Cancelled { frame: 26 })));
        cut.run(&Cancel::default()).unwrap();
        assert_eq!(bits(&cut), bits(&whole), "{policy:?}");
    }
}

#[test]
fn a_gap_without_contact_is_repeated_bit_by_bit() {
    let robot = robot("ur5e");
    let command = command(&robot, 60, &[(0, 0.0), (30, 0.2), (59, -0.1)]);
    let mut rollout = rollout(&robot, PolicyName::Ridge, &command);
    rollout.run(&Cancel::default()).unwrap();
    let alone = rollout.without_contact(10, 40, &|| false).unwrap();
    let dim = robot.state_dim();
    assert_eq!(alone, rollout.states()[(HISTORY + 11) * dim..(HISTORY + 41) * dim]);
}

/// After each of 200 random edits per robot the rollout has the same bits as a rollout from the
/// start, and no frame was simulated that the edit cannot have changed.
#[test]
fn an_edit_resimulates_only_what_it_can_change() {
    let cases = [
        ("pointmass", PolicyName::ComputedTorque, 200, 90),
        ("ur5e", PolicyName::Pd, 200, 90),
        ("ur5e_light", PolicyName::ComputedTorque, 200, 60),
        ("shadow_hand", PolicyName::Pd, 200, 45),
        ("ur5e", PolicyName::Ilqr, 8, 60),
        ("pointmass", PolicyName::PredictiveSampling, 20, 60),
        ("ur5e", PolicyName::Ridge, 200, 90),
        ("shadow_hand", PolicyName::Ridge, 60, 60),
    ];
    let (mut in_sight, mut planned) = (0, 0);
    for (id, name, edits, frames) in cases {
        let robot = robot(id);
        let span = frames as u64 - 1;
        let mut keys: Vec<(usize, f64)> = vec![(0, 0.0), (20, 0.2), (40, -0.1)];
        let mut before = command(&robot, frames, &keys);
        let mut live = rollout(&robot, name, &before);
        live.run(&Cancel::default()).unwrap();
        for edit in 0..edits {
            let mut rng = Rng::new(7, Stream::Test, edit);
            let k = 1 + rng.below(keys.len() as u64 - 1) as usize;
            match rng.below(3) {
                0 => keys[k].1 = rng.range(-0.3, 0.3),
                1 => keys[k].0 = 1 + rng.below(span) as usize,
                _ if keys.len() < 7 => {
                    keys.push((1 + rng.below(span) as usize, rng.range(-0.3, 0.3)));
                }
                _ => drop(keys.pop()),
            }
            let command = command(&robot, frames, &keys);
            let simulated = live.simulated();
            let from = live.set_command(&command).unwrap();
            // The first changed step according to the clip; the plan through a gap may change
            // before. If a goal is always in the window,
            // no virtual keyframe depends on a later one, and 20 frames before the change is
            // exact.
            let changed = command.first_changed_frame(&before);
            let step = command.first_changed_step(&before);
            let plans = live.policy.sees_plan();
            planned += u64::from(plans && (1..frames - 1).contains(&from));
            assert!(plans || from >= step.map_or(frames - 1, |s| s as usize).min(frames - 1));
            if !plans && command.blind_spans().is_empty() && before.blind_spans().is_empty() {
                in_sight += u64::from(changed.is_some());
                let exact = changed.map_or(frames - 1, |f| (f as usize).saturating_sub(20));
                assert_eq!(from, exact.min(frames - 1), "{id} {name:?}, edit {edit}");
            }
            live.run(&Cancel::default()).unwrap();
            assert_eq!(live.simulated() - simulated, frames - 1 - from);
            let mut fresh = rollout(&robot, name, &command);
            fresh.run(&Cancel::default()).unwrap();
            assert!(bits(&live) == bits(&fresh), "{id} {name:?}, edit {edit}");
            before = command;
        }
    }
    assert!(in_sight > 20, "hardly an edit without a blind span: {in_sight}");
    assert!(planned > 20, "policies that see the plan hardly keep a frame: {planned}");
}

/// A wave of every joint, as recorded, without these frames.
fn recording(robot: &Robot, hidden: &[usize]) -> Command {
    let waves: Vec<(usize, f64)> = (0..70)
        .filter(|f| !hidden.contains(f))
        .map(|f| (f, 0.2 * (0.25 * f as f64).sin()))
        .collect();
    command(robot, 70, &waves)
}

#[test]
fn an_edit_near_dropouts_has_the_bits_of_a_rollout_from_the_start() {
    let robot = robot("ur5e");
    let smooth = PolicyConfig { guide: Guide::Smooth, ..PolicyConfig::new(PolicyName::Robert) };
    for policy in [smooth, PolicyConfig::new(PolicyName::Robert)] {
        let begun = |command: &Command| {
            let built = policy.build(&robot).unwrap();
            let config = RolloutConfig { guide: policy.guide, ..RolloutConfig::default() };
            Rollout::new(&robot, built, command, Start::Pose, config).unwrap()
        };
        let gaps = [20, 21, 22, 40, 41, 42, 43, 44, 45, 46, 47, 48, 49];
        let mut edited = begun(&recording(&robot, &gaps));
        edited.run(&Cancel::default()).unwrap();
        for hidden in [&gaps[1..], &gaps[..8], &gaps[..3], &[60, 61]] {
            let changed = recording(&robot, hidden);
            edited.set_command(&changed).unwrap();
            edited.run(&Cancel::default()).unwrap();
            let mut fresh = begun(&changed);
            assert!(fresh.goals().has_dropouts());
            fresh.run(&Cancel::default()).unwrap();
            assert_eq!(bits(&edited), bits(&fresh), "{policy:?} {hidden:?}");
        }
    }
}

#[test]
fn motions_are_compared_by_goals_and_dropouts() {
    let robot = robot("ur5e");
    let command = recording(&robot, &[30, 31, 32]);
    let mut rollout = rollout(&robot, PolicyName::Pd, &command);
    rollout.run(&Cancel::default()).unwrap();
    let Errors { precision, judged: error, .. } = rollout.errors().unwrap();
    assert_eq!(Some(precision), rollout.precision().precision);
    let d = robot.state_dim();
    let off =
        |f: usize, j: usize| (rollout.reached()[f * d + j] - rollout.goals().way_at(f, j)).abs();
    let inside: f64 = (30..33).flat_map(|f| (0..d).map(move |j| off(f, j))).sum();
    let all = (precision * (66 * d) as f64 + inside) / (69 * d) as f64;
    assert!((error - all).abs() < 1e-12 && error != precision, "{error} {all} {precision}");
    // Neither is a dropout a gap in which a joint could overshoot.
    assert!((30..33).all(|f| rollout.sought().any_visible(f) && !rollout.goals().any_visible(f)));
    let trial = crate::Trial::of(&PolicyConfig::new(PolicyName::Pd), &rollout);
    assert_eq!((trial.precision, trial.with_dropouts), (Some(precision), Some(error)));
}

/// Also in a clip with dropouts, and after an edit.
#[test]
fn motions_are_compared_by_the_length_of_tendons_as_well() {
    let robot = robot("shadow_hand");
    let [a, b] = ["FFJ2", "FFJ1"].map(|name| robot.joint_index(name).unwrap());
    let d = robot.state_dim();
    // Of two recordings the second one lacks three frames. In both the tip is far from what the tendon allows.
    let [whole, gaps] = [&[][..], &[30, 31, 32]].map(|hidden| {
        let command = recording(&robot, hidden);
        let mut q = command.filled();
        q.chunks_exact_mut(d).for_each(|row| (row[a], row[b]) = (0.0, 1.2));
        let seen = (0..q.len()).map(|i| command.sees((i / d) as u32, i % d)).collect();
        Command::from_dense(command.joints().to_vec(), command.start().to_vec(), q, seen).unwrap()
    });
    let mut rollout = rollout(&robot, PolicyName::Pd, &whole);
    for (command, dropouts) in [(&whole, false), (&gaps, true), (&whole, false)] {
        rollout.set_command(command).unwrap();
        rollout.run(&Cancel::default()).unwrap();
        let errors = rollout.errors().unwrap();
        assert_eq!(errors.with_dropouts.is_some(), dropouts);
        let (goals, reached) = (rollout.sought(), rollout.reached());
        let frames = 1..goals.frames();
        let off = |f: usize, j: usize| reached[f * d + j] - goals.row(f)[j];
        let together: f64 = frames.clone().map(|f| (off(f, a) + off(f, b)).abs()).sum();
        let least = 0.05 * together / goals.commanded(&frames);
        let more = errors.judged - errors.with_dropouts.unwrap_or(errors.precision);
        assert!(least > 1e-5 && more >= least - 1e-12, "{more} {least}");
    }
}

/// A rollout with corrections that goes on from another one has the bits of one from the start,
/// also with a policy that remembers.
#[test]
fn a_branch_has_the_bits_of_a_rollout_from_the_start() {
    for (id, name) in [("shadow_hand", PolicyName::Pd), ("ur5e", PolicyName::Ilqr)] {
        let robot = robot(id);
        let (frames, dim) = (120, robot.state_dim());
        let keys: Vec<(usize, f64)> =
            (1..frames).map(|f| (f, 0.2 * (f as f64 / 9.0).sin())).collect();
        let command = command(&robot, frames, &keys);
        let moved = |spans: &[(usize, usize)]| {
            let inside = |f: usize| spans.iter().any(|s| (s.0..s.1).contains(&f));
            let by = |i: usize| if inside(i / dim) { 0.1 } else { 0.0 };
            Lead::of((0..frames * dim).map(by).collect())
        };
        let make = || rollout(&robot, name, &command);
        let mut best = make();
        best.correct(moved(&[(50, 55)])).unwrap();
        best.run(&Cancel::default()).unwrap();
        let mut branch = make();
        // Before and after what the best one changed, with frames of another try behind.
        for (spans, steps) in [
            (vec![(50, 55), (90, 95)], 49),
            (vec![(50, 55), (30, 33)], 109),
            (vec![(50, 55), (110, 118)], 29),
            (vec![(50, 55)], 0),
        ] {
            let before = branch.simulated();
            branch.branch(&best, moved(&spans)).unwrap();
            branch.run(&Cancel::default()).unwrap();
            assert_eq!(branch.simulated() - before, steps, "{id} {spans:?}");
            let mut fresh = make();
            fresh.correct(moved(&spans)).unwrap();
            fresh.run(&Cancel::default()).unwrap();
            assert!(bits(&branch) == bits(&fresh), "{id} {spans:?}");
        }
    }
}

#[test]
fn hidden_goals_are_never_read() {
    let alone =
        |n: &PolicyName| *n == PolicyName::Ridge || !n.needs_model() && *n != PolicyName::Auto;
    for name in PolicyName::all().filter(alone) {
        let robot = robot("ur5e");
        let keys = [(0, 0.0), (12, 0.2), (13, 0.2), (14, 0.2)];
        let mut a = rollout(&robot, name, &command(&robot, 24, &keys));
        let mut b = rollout(&robot, name, &command(&robot, 24, &keys));
        // Overwrite what masks hide.
        for i in 0..b.led.frames() * b.led.dim() {
            b.led.poison_hidden(i, 99.0);
        }
        a.run(&Cancel::default()).unwrap();
        b.run(&Cancel::default()).unwrap();
        assert!(bits(&a) == bits(&b), "{name:?}");
    }
}

#[test]
fn simulated_time_is_clip_time() {
    for timestep in [0.001, 0.002, 0.0025, 0.005] {
        let robot = robot("ur5e");
        let command = command(&robot, 41, &[(0, 0.0), (40, 0.1)]);
        let mut r = rollout(&robot, PolicyName::ComputedTorque, &command);
        let mut model = robot.model().duplicate().unwrap();
        model.set_timestep(timestep);
        r.substeps = substeps(&model).unwrap();
        r.plant = Data::new(&Arc::new(model)).unwrap();
        r.rewind().unwrap();
        r.run(&Cancel::default()).unwrap();
        assert_eq!(r.frames_reached().count(), 41, "both ends are there");
        assert!(r.clock_error_secs().abs() < 1e-9, "{timestep}: {}", r.clock_error_secs());
        assert!((r.snapshot(40).unwrap().time_secs - 2.0).abs() < 1e-9);
        assert!(r.frames_reached().last().unwrap().error.is_some(), "the last key is commanded");
    }
    let mut odd = robot("ur5e").model().duplicate().unwrap();
    odd.set_timestep(0.003);
    assert!(matches!(substeps(&odd), Err(Error::Timestep { .. })));
}

/// Counts its calls in its memory, and fails at frame 5 as often as it is told.
struct Stumbles {
    calls: f64,
    failures: usize,
}

impl Policy for Stumbles {
    fn name(&self) -> String {
        "stumbles".into()
    }

    fn reset(&mut self, _seed: u64) {
        self.calls = 0.0;
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.calls += 1.0;
        action.fill(0.1 * self.calls);
        if view.frame == 5 && self.failures > 0 {
            self.failures -= 1;
            action.fill(f64::NAN);
        }
        Ok(())
    }

    fn memory(&self) -> Vec<f64> {
        vec![self.calls]
    }

    fn recall(&mut self, memory: &[f64]) {
        self.calls = memory[0];
    }
}

#[test]
fn a_frame_that_failed_can_be_tried_again() {
    let robot = robot("pointmass");
    let command = command(&robot, 12, &[(0, 0.0), (11, 0.1)]);
    let rollout = |failures| {
        let policy = Box::new(Stumbles { calls: 0.0, failures });
        let config = RolloutConfig::default();
        Rollout::new(&robot, policy, &command, Start::Pose, config).unwrap()
    };
    let (mut sure, mut stumbling) = (rollout(0), rollout(2));
    sure.run(&Cancel::default()).unwrap();
    for _ in 0..2 {
        let e = stumbling.run(&Cancel::default()).unwrap_err();
        assert!(matches!(e, Error::BadAction { frame: 5, .. }), "{e}");
    }
    stumbling.run(&Cancel::default()).unwrap();
    assert!(bits(&sure) == bits(&stumbling));
}

#[test]
fn a_planner_that_knows_the_plant_beats_none() {
    let robot = robot("ur5e");
    let keys: Vec<(usize, f64)> =
        std::iter::once((0, 0.0)).chain((20..40).map(|f| (f, 0.25))).collect();
    let command = command(&robot, 40, &keys);
    let precision = |name| {
        let mut r = rollout(&robot, name, &command);
        r.run(&Cancel::default()).unwrap();
        r.precision().precision.unwrap()
    };
    let (zero, pd) = (precision(PolicyName::Zero), precision(PolicyName::Pd));
    let (ct, ilqr) = (precision(PolicyName::ComputedTorque), precision(PolicyName::Ilqr));
    assert!(zero > 0.05 && pd < 0.02 && ct < 0.002 && ilqr < 0.002, "{zero} {pd} {ct} {ilqr}");
}

#[test]
fn other_joints_are_refused() {
    let (arm, mass) = (robot("ur5e"), robot("pointmass"));
    let policy = PolicyConfig::new(PolicyName::Zero).build(&arm).unwrap();
    let command = command(&mass, 10, &[(0, 0.0)]);
    let e = Rollout::new(&arm, policy, &command, Start::Pose, RolloutConfig::default());
    assert!(matches!(e, Err(Error::Joints { got: 2, want: 5, .. })), "{e:?}");
}

#[test]
fn a_start_pose_whose_parts_overlap_begins_without_a_jolt() {
    let robot = robot("shadow_hand");
    let clip = crate::tasks::find("shadow_hand/flick_a_marble", None).unwrap();
    let command = robert_clip::compile(&clip).unwrap();
    let mut begun = rollout(&robot, PolicyName::Pd, &command);
    let first = begun.reached().to_vec();
    let start = pose(&command);
    let most =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(most(&first, &start) > 0.01, "the thumb is in a finger");
    let after = begun.step().unwrap().unwrap().reached.to_vec();
    // It was .55 when contact threw them apart.
    assert!(most(&after, &first) < 0.3, "{}", most(&after, &first));
    // A clip that begins elsewhere, and this one again.
    let home = self::command(&robot, 60, &[(30, 0.1)]);
    begun.set_command(&home).unwrap();
    assert_eq!(begun.reached(), pose(&home), "nothing overlaps there");
    begun.set_command(&command).unwrap();
    assert_eq!(begun.reached(), first);
}
