//! Runs on a small made-up plant: learning, resuming, bits, refusals.

use std::path::{Path, PathBuf};

use super::*;
use crate::dataset::{Dataset, EpisodeMeta, Manifest, Robot, Shard, ShardBuilder, Verify};
use crate::net::Model;
use crate::net::checkpoint;
use crate::net::mask::MaskKind;
use crate::net::{SkipKind, TokenKind};
use crate::progress::{Cancel, Progress, Silent};
use crate::rng::{Rng, Stream};
use crate::units::Unit;
use run::paths;

/// Two damped joints with springs, pushed by smooth random forces.
fn dataset(dir: &Path) -> Dataset {
    plant(dir, 0.0)
}

/// The same behind levers: the force of a motor grows by `lever` a radian, which no linear map
/// can undo.
fn plant(dir: &Path, lever: f64) -> Dataset {
    let mut m = Manifest::new(Robot {
        id: "toy".into(),
        model_sha256: "ab".repeat(32),
        joints: vec!["a".into(), "b".into()],
        units: vec![Unit::Rad; 2],
        ranges: vec![Some([-2.0, 2.0]), None],
        near_limit: vec![0.1; 2],
        actuators: vec!["ma".into(), "mb".into()],
        ctrlranges: vec![[-1.0, 1.0]; 2],
    });
    let mut b = ShardBuilder::new(&m.robot, "toy", 0);
    for e in 0..40 {
        let mut rng = Rng::new(9, Stream::Test, e);
        let (mut q, mut v, mut a) = ([0.0_f64; 2], [0.0_f64; 2], [0.0_f64; 2]);
        let (mut qs, mut vs, mut us) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..150 {
            for a in &mut a {
                *a = (0.85 * *a + 0.3 * rng.normal()).clamp(-1.0, 1.0);
            }
            qs.extend(q.map(|x| x as f32));
            vs.extend(v.map(|x| x as f32));
            us.extend(a.map(|x| x as f32));
            for _ in 0..10 {
                for j in 0..2 {
                    let spring = 3.0 * q[j].sin() + q[1 - j] * q[j].cos();
                    let force = 8.0 * (1.0 + (lever * q[j]).tanh());
                    v[j] += 0.005 * (force * a[j] - 10.0 * v[j] - spring);
                    q[j] += 0.005 * v[j];
                }
            }
        }
        let meta = EpisodeMeta { agent: "noise".into(), snapshot_step: 0, seed: e };
        b.push(&meta, &qs, &vs, &us, &[0; 150]).unwrap();
    }
    let file = PathBuf::from("shards/0.safetensors");
    let entry = b.write(dir, &file).unwrap();
    let shard = Shard::open(&dir.join(&file), 2, 2, Some(entry.bytes)).unwrap();
    m.add(entry, &shard);
    m.count();
    m.save(dir).unwrap();
    Dataset::open(dir, Verify::Structure).unwrap()
}

fn small(steps: u64) -> TrainConfig {
    TrainConfig { layers: 2, width: 32, heads: 2, batch: 24, steps, lr: 3e-3, ..Default::default() }
}

fn options<'a>(
    dir: &Path,
    threads: usize,
    cancel: &'a Cancel,
    progress: &'a dyn Progress,
) -> Options<'a> {
    Options {
        dir: dir.to_owned(),
        threads,
        checkpoint_secs: 1e9,
        evaluations: 0,
        progress,
        cancel,
        judge: None,
        perform: None,
        meta: serde_json::Value::Null,
    }
}

fn weights(dir: &Path) -> Model {
    checkpoint::load(&paths::last(dir), None).unwrap()
}

#[test]
fn learns_and_beats_its_linear_answer() {
    let dir = tempfile::tempdir().unwrap();
    let data = plant(&dir.path().join("data"), 1.5);
    let (cancel, run) = (Cancel::default(), dir.path().join("run"));
    let cfg = TrainConfig { average: 0.99, mask: MaskKind::ClUniform, ..small(160) };
    let four = Options { evaluations: 4, ..options(&run, 2, &cancel, &Silent) };
    let done = train(&data, &cfg, four).unwrap();
    assert_eq!((done.step, done.interrupted, done.skipped), (160, false, 0));
    let end = done.held_out.unwrap();
    let text = std::fs::read_to_string(paths::metrics(&run)).unwrap();
    let lines: Vec<serde_json::Value> =
        text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let held: Vec<f64> =
        lines.iter().filter_map(|l| l["held_out"]["nmse_by_hidden"][0].as_f64()).collect();
    assert_eq!(held.len(), 4);
    assert!(end.nmse_by_hidden[0] < 0.1, "{end:?}");
    // An untrained network is the linear answer: no step at all shows what it leaves.
    let (none, straight) = (dir.path().join("none"), TrainConfig { lr: 1e-30, ..small(40) });
    let once = Options { evaluations: 1, ..options(&none, 2, &cancel, &Silent) };
    let linear = train(&data, &straight, once).unwrap().held_out.unwrap();
    assert!(end.nmse_clear < 0.9 * linear.nmse_clear, "{end:?} after {linear:?}");
    let sum = |h: &HeldOut, gaps: usize| h.nmse_by_hidden.iter().take(gaps).sum::<f64>();
    assert!(sum(&end, 2) < 0.9 * sum(&linear, 2), "{end:?} after {linear:?}");
    // Most of what a long gap leaves open nobody can tell; nothing may be lost there.
    assert!(sum(&end, 20) < 1.1 * sum(&linear, 20), "{end:?} after {linear:?}");
    assert!(end.nmse_by_hidden[10] > end.nmse_by_hidden[0], "hidden frames cost something");
    let model = checkpoint::load(&paths::model(&run), None).unwrap();
    assert!(model.optimiser.is_none());
    assert_ne!(model.net.weights[..], weights(&run).net.weights[..], "the average is kept");
    assert_eq!(run::read_config(&run).unwrap(), cfg);
}

/// Stops a run after some steps.
struct StopAfter(u64, Cancel);

impl Progress for StopAfter {
    fn tick(&self, done: u64, _total: u64, _note: &str) {
        if done >= self.0 {
            self.1.cancel();
        }
    }
    fn log(&self, _line: &str) {}
}

#[test]
fn interrupted_and_resumed_is_bit_equal() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    for (i, cfg) in [
        TrainConfig { average: 0.9, ..small(30) },
        TrainConfig {
            bins: 4,
            average: 0.0,
            skip: SkipKind::Off,
            previous_action: true,
            tokens: TokenKind::Pos,
            mask: MaskKind::Cl,
            ..small(30)
        },
    ]
    .into_iter()
    .enumerate()
    {
        let (whole, parts) = (dir.path().join(format!("w{i}")), dir.path().join(format!("p{i}")));
        train(&data, &cfg, options(&whole, 1, &Cancel::default(), &Silent)).unwrap();
        for (stop, threads) in [(7, 2), (8, 1), (20, 2), (1000, 2)] {
            let cancel = Cancel::default();
            let stopper = StopAfter(stop, cancel.clone());
            train(&data, &cfg, options(&parts, threads, &cancel, &stopper)).unwrap();
        }
        let (a, b) = (weights(&whole), weights(&parts));
        assert_eq!(a.card.training.step, 30);
        assert_eq!(a.net.weights[..], b.net.weights[..]);
        assert_eq!(a.optimiser, b.optimiser);
        let read = |d: &Path| std::fs::read(paths::model(d)).unwrap();
        assert_eq!(read(&whole), read(&parts), "the model file is the same to the byte");
    }
}

#[test]
fn a_run_goes_on_only_with_its_own_settings_and_data() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    let (cancel, run) = (Cancel::default(), dir.path().join("run"));
    train(&data, &small(3), options(&run, 1, &cancel, &Silent)).unwrap();
    let other = TrainConfig { lr: 1e-4, ..small(3) };
    let e = train(&data, &other, options(&run, 1, &cancel, &Silent)).unwrap_err();
    assert!(e.to_string().contains("other settings"), "{e}");
}

#[test]
fn steps_that_are_not_finite_are_skipped_counted_and_end_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    let (cancel, run) = (Cancel::default(), dir.path().join("run"));
    train(&data, &small(0), options(&run, 1, &cancel, &Silent)).unwrap();
    let kept = std::fs::read(paths::last(&run)).unwrap();
    // A step this long leaves nothing finite behind it.
    let cfg = TrainConfig { lr: 1e35, ..small(400) };
    let wild = dir.path().join("wild");
    let e = train(&data, &cfg, options(&wild, 2, &cancel, &Silent)).unwrap_err();
    assert!(matches!(e, Error::Diverged { skipped: 10, .. }), "{e}");
    assert_eq!(kept, std::fs::read(paths::last(&run)).unwrap());
    let last = checkpoint::load(&paths::last(&wild), None).unwrap();
    assert!(last.net.weights.iter().all(|w| w.is_finite()));
}

#[test]
fn the_best_by_precision_is_kept() {
    struct Judge(Vec<f64>);
    impl Evaluate for Judge {
        fn evaluate(&mut self, model: &Model) -> Result<Evaluation, String> {
            assert!(model.net.weights.iter().all(|w| w.is_finite()));
            let precision = self.0.remove(0);
            Ok(Evaluation { precision, suites: [("toy".to_owned(), precision)].into() })
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    let (cancel, run) = (Cancel::default(), dir.path().join("run"));
    // The linear answer is judged first; it is the figure to beat, never the best.
    let mut judge = Judge(vec![0.05, 0.3, 0.1, 0.2, 0.4]);
    let opts =
        Options { evaluations: 4, judge: Some(&mut judge), ..options(&run, 1, &cancel, &Silent) };
    let done = train(&data, &small(8), opts).unwrap();
    assert_eq!(done.best, Some((4, 0.1)));
    let record = super::record::Record::read(&run).unwrap();
    assert_eq!(record.linear.as_ref().map(|l| l.precision), Some(0.05));
    assert!(record.worse_than_linear() && paths::curves(&run).exists());
    let best = checkpoint::load(&paths::best(&run), None).unwrap();
    assert_eq!((best.card.training.step, best.card.training.precision["toy"]), (4, 0.1));
}

fn fit_inverse(data: &Dataset, seed: u64, out: &Path) -> fit::Fitted {
    let settings =
        crate::rollout::InverseSettings { width: 24, steps: 500, batch: 64, ..Default::default() };
    fit::mlp_inverse(data, seed, &settings, out, &Silent, &Cancel::default()).unwrap()
}

#[test]
fn fits_infer_held_out_actions() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(dir.path());
    let path = |name: &str| dir.path().join(name);
    let mut ridge = fit::ridge(&data, 0, 2, &path("r")).unwrap();
    let mut nearest = fit::nearest(&data, 0, usize::MAX, &path("n")).unwrap();
    let mut inverse = fit_inverse(&data, 0, &path("i"));
    let errors = [&mut ridge, &mut nearest, &mut inverse]
        .map(|fitted| fit::held_out(&data, 0, fitted).unwrap());
    let next = errors.map(|e| e[0]);
    assert!(next[0] < 0.1 && next[0] < next[1] && next[0] < next[2], "{errors:?}");
    assert!(next.iter().all(|e| *e < 0.8), "better than to do what is done on average: {errors:?}");
    assert!(errors.iter().all(|e| e[2] > e[0]), "hidden frames make it harder: {errors:?}");
}

#[test]
fn a_fit_is_a_function_of_data_and_seed() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(dir.path());
    let path = |name: &str| dir.path().join(name);
    for (name, seed) in [("a", 1), ("b", 1), ("c", 2)] {
        fit_inverse(&data, seed, &path(name));
    }
    let read = |name: &str| std::fs::read(path(name)).unwrap();
    assert!(read("a") == read("b") && read("a") != read("c"));

    // A part of the data is whole trajectories, spread over all of it.
    fit::nearest(&data, 0, 900, &path("n")).unwrap();
    let found = crate::rollout::Nearest::load(&path("n"), None).unwrap();
    let lengths = &found.card().settings.lengths;
    assert_eq!(found.frames(), lengths.iter().sum::<usize>());
    assert!(lengths.iter().all(|&n| n == 150) && lengths.len() == 6, "{lengths:?}");
}

#[test]
fn a_stopped_fit_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(dir.path());
    let cancel = Cancel::default();
    cancel.cancel();
    let out = dir.path().join("i");
    let settings = crate::rollout::InverseSettings { width: 8, batch: 8, ..Default::default() };
    let e = fit::mlp_inverse(&data, 0, &settings, &out, &Silent, &cancel).unwrap_err();
    assert_eq!(crate::exit::HasExit::exit(&e), crate::exit::Exit::Interrupted);
    assert!(!out.exists());
}
