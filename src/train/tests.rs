//! Tests: runs on a small made-up plant (learning, resuming, equal bits, refusals).

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::fitted_ridge::FittedRidge;
use super::*;
use robert_base::progress::{Cancel, Progress, Silent};
use robert_base::rng::{Rng, Stream};
use robert_base::units::Unit;
use robert_dataset::{
    Dataset, EpisodeMeta, Manifest, Part, Robot, Shard, ShardBuilder, Verify, Windows,
};
use robert_explore::{CollectConfig, collect};
use robert_net::Model;
use robert_net::checkpoint;
use robert_net::mask::MaskKind;
use robert_net::{Batch, Ridge, SkipKind, TokenKind, WINDOW};
use robert_robot::Robot as Built;

/// A robot of the program, 3,000 transitions of noise in `folder`, and a network that knows
/// no more than their linear prediction.
pub(super) fn untrained(robot: &str, seed: u64, folder: &Path) -> (Arc<Built>, Dataset, Model) {
    let robot = Arc::new(Built::builtin(robot).unwrap());
    let config = CollectConfig { transitions: 3000, seed, ..CollectConfig::new(&robot) };
    collect(&robot, &config, folder, false, 2, &Silent, &Cancel::default()).unwrap();
    let data = Dataset::open(folder, Verify::Structure).unwrap();
    let cfg = TrainConfig::preset("instant").unwrap();
    let (card, net, encoder) = prepare::prepare(&data, &cfg, None, 2, &Cancel::default()).unwrap();
    (robot, data, Model { card, net, encoder, optimiser: None })
}

/// Two damped joints with springs, pushed by smooth random forces.
pub(super) fn dataset(dir: &Path) -> Dataset {
    plant(dir, 0.0)
}

/// The plant of [`dataset`] behind levers: the force of a motor grows by `lever` a radian, which no
/// linear map can undo.
fn plant(dir: &Path, lever: f64) -> Dataset {
    trajectories(dir, lever, 150)
}

/// Forty trajectories of this many frames.
fn trajectories(dir: &Path, lever: f64, frames: usize) -> Dataset {
    touching(dir, lever, &vec![0; frames])
}

/// Forty trajectories with self-contact in these frames.
fn touching(dir: &Path, lever: f64, touches: &[u8]) -> Dataset {
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
        for _ in touches {
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
        b.push(&meta, &qs, &vs, &us, touches).unwrap();
    }
    let file = PathBuf::from("shards/0.safetensors");
    let entry = b.write(dir, &file).unwrap();
    let shard = Shard::open(&dir.join(&file), 2, 2, Some(entry.bytes)).unwrap();
    m.add(entry, &shard);
    m.count();
    m.save(dir).unwrap();
    Dataset::open(dir, Verify::Structure).unwrap()
}

pub(super) fn small(steps: u64) -> TrainConfig {
    TrainConfig { layers: 2, width: 32, heads: 2, batch: 24, steps, lr: 3e-3, ..Default::default() }
}

pub(super) fn options<'a>(
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
        patience: 0,
        progress,
        cancel,
        evaluator: None,
        perform: None,
        engines: None,
        linear: None,
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
    let by_hidden = |h: &HeldOut| h.nmse_by_hidden.iter().flatten().copied().collect::<Vec<_>>();
    assert!(by_hidden(&end).len() == 20 && by_hidden(&end)[0] < 0.1, "{end:?}");
    // Nothing in this data touches itself: that is no error of zero.
    assert_eq!((end.nmse_contact, end.shares[2]), (None, 0.0));
    // An untrained network is the linear prediction: no step at all shows what it leaves.
    let (none, straight) = (dir.path().join("none"), TrainConfig { lr: 1e-30, ..small(40) });
    let once = Options { evaluations: 1, ..options(&none, 2, &cancel, &Silent) };
    let linear = train(&data, &straight, once).unwrap().held_out.unwrap();
    let clear = |h: &HeldOut| h.nmse_clear.unwrap();
    assert!(clear(&end) < 0.9 * clear(&linear), "{end:?} after {linear:?}");
    let sum = |h: &HeldOut, gaps: usize| by_hidden(h).iter().take(gaps).sum::<f64>();
    assert!(sum(&end, 2) < 0.9 * sum(&linear, 2), "{end:?} after {linear:?}");
    // Most of a long gap cannot be predicted; the network must not be worse there.
    assert!(sum(&end, 20) < 1.1 * sum(&linear, 20), "{end:?} after {linear:?}");
    assert!(by_hidden(&end)[10] > by_hidden(&end)[0], "hidden frames cost something");
    let model = checkpoint::load(&paths::model(&run), None).unwrap();
    assert!(model.optimiser.is_none());
    assert_ne!(model.net.weights[..], weights(&run).net.weights[..], "the average is kept");
    assert_eq!(read_config(&run).unwrap(), cfg);
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
fn in_contact_the_linear_answer_can_be_what_is_learned() {
    let dir = tempfile::tempdir().unwrap();
    let touches: Vec<u8> = (0..150).map(|i| u8::from(i % 5 < 2)).collect();
    let data = touching(dir.path(), 0.0, &touches);
    let filled = |contact_target| {
        let cfg = TrainConfig { contact_target, ..small(10) };
        let (_, net, encoder) = prepare::prepare(&data, &cfg, None, 1, &Cancel::default()).unwrap();
        let mut batch = Batch::zeros(&net.cfg, 2);
        let windows = Windows::new(&data, WINDOW, Part::Train, cfg.seed).unwrap();
        let source = source::Source::new(&data, &encoder, &cfg);
        source::BatchSampler::new(&source, &windows, &[]).train(3, 0, 1, &mut batch);
        (windows.draw(cfg.seed, 3 * cfg.batch as u64).start, batch)
    };
    let (start, applied) = filled(ContactTarget::Action);
    let (_, batch) = filled(ContactTarget::Linear);
    assert_eq!(applied.linear, batch.linear);
    for i in 0..WINDOW {
        let row = 2 * (WINDOW + i)..2 * (WINDOW + i) + 2;
        let touches = touches[start + i] != 0;
        let want = if touches { &batch.linear } else { &applied.actions };
        assert_eq!(batch.actions[row.clone()], want[row.clone()], "frame {i}, {touches}");
        assert_ne!(applied.actions[row.clone()], applied.linear[row], "frame {i}");
    }
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
    // A file edited by hand would put wrong settings on record.
    let text = std::fs::read_to_string(paths::config(&run)).unwrap();
    std::fs::write(paths::config(&run), text.replace("lr = 0.003", "lr = 0.004")).unwrap();
    let edited = read_config(&run).unwrap();
    assert_eq!(edited.lr, 0.004);
    let e = train(&data, &edited, options(&run, 1, &cancel, &Silent)).unwrap_err();
    assert!(e.to_string().contains("was changed since"), "{e}");
    std::fs::write(paths::config(&run), text).unwrap();
    train(&data, &small(3), options(&run, 1, &cancel, &Silent)).unwrap();
}

/// Keeps the lines of a log.
#[derive(Default)]
struct Log(std::sync::Mutex<Vec<String>>);

impl Log {
    fn skipped(&self) -> Vec<String> {
        let lines = self.0.lock().unwrap();
        lines.iter().filter(|l| l.contains("skipped")).cloned().collect()
    }
}

impl Progress for Log {
    fn tick(&self, _done: u64, _total: u64, _note: &str) {}
    fn log(&self, line: &str) {
        self.0.lock().unwrap().push(line.to_owned());
    }
}

#[test]
fn the_checkpoint_kept_is_one_that_can_go_on() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    // One step of this length leaves finite weights, and nothing finite after them.
    let cfg = TrainConfig { lr: 1e30, ..small(60) };
    let (cancel, run) = (Cancel::default(), dir.path().join("run"));
    let each = || Options { checkpoint_secs: 0.0, ..options(&run, 1, &cancel, &Silent) };
    let e = train(&data, &cfg, each()).unwrap_err();
    assert!(matches!(e, Error::Diverged { skipped: 10, .. }), "{e}");
    assert!(e.to_string().contains("begin a new one with a smaller lr"), "{e}");
    let kept = weights(&run).card.training.step;
    let log = Log::default();
    let again = Options { progress: &log, ..each() };
    assert!(matches!(train(&data, &cfg, again).unwrap_err(), Error::Diverged { .. }));
    let skipped = log.skipped();
    assert_eq!(skipped.len(), 10, "counted from the checkpoint on");
    let next = format!("step {kept}:");
    assert!(skipped.iter().all(|l| !l.starts_with(&next)), "{skipped:?}");
    // At the end nothing follows that could tell: it is tried.
    let short = dir.path().join("short");
    let cfg = TrainConfig { lr: 1e30, ..small(3) };
    let e = train(&data, &cfg, options(&short, 1, &cancel, &Silent)).unwrap_err();
    assert!(matches!(e, Error::Diverged { .. }), "{e}");
    assert!(weights(&short).card.training.step < 3);
}

#[test]
fn a_finished_run_still_has_its_figures() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    let (cancel, run) = (Cancel::default(), dir.path().join("run"));
    let twice = || Options { evaluations: 2, ..options(&run, 1, &cancel, &Silent) };
    let first = train(&data, &small(4), twice()).unwrap();
    assert!(first.held_out.is_some());
    let model = std::fs::read(paths::model(&run)).unwrap();
    let again = train(&data, &small(4), twice()).unwrap();
    assert_eq!((again.step, again.held_out), (4, first.held_out));
    assert_eq!(model, std::fs::read(paths::model(&run)).unwrap());
}

/// Evaluates by a list, and is stopped at the entry that is missing.
struct Listed(Vec<Option<f64>>, Cancel);

impl Evaluate for Listed {
    fn evaluate(&mut self, model: &Model, cancel: &Cancel) -> Result<Option<Evaluation>, String> {
        assert!(model.net.weights.iter().all(|w| w.is_finite()));
        let Some(precision) = self.0.remove(0) else {
            self.1.cancel();
            assert!(cancel.is_cancelled(), "the run's own");
            return Ok(None);
        };
        Ok(Some(Evaluation { precision, suites: [("toy".to_owned(), precision)].into() }))
    }
}

fn figures(run: &Path, key: &str) -> Vec<(u64, f64)> {
    let text = std::fs::read_to_string(paths::metrics(run)).unwrap();
    let lines = text.lines().map(|l| serde_json::from_str::<serde_json::Value>(l).unwrap());
    lines.filter_map(|l| Some((l["step"].as_u64()?, l.get(key)?["precision"].as_f64()?))).collect()
}

#[test]
fn a_stop_cuts_an_evaluation_short_and_resuming_makes_up_for_it() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    let run = dir.path().join("run");
    let session = |list: &[Option<f64>]| {
        let cancel = Cancel::default();
        let mut evaluator = Listed(list.to_vec(), cancel.clone());
        let evaluator: &mut dyn Evaluate = &mut evaluator;
        let two = options(&run, 1, &cancel, &Silent);
        train(&data, &small(8), Options { evaluations: 2, evaluator: Some(evaluator), ..two })
            .unwrap()
    };
    // Stopped while the linear prediction is evaluated, at step 4, at the end; then let alone.
    for (list, step) in
        [(&[None][..], 0), (&[Some(0.5), None], 4), (&[Some(0.4), None], 8), (&[None], 8)]
    {
        let done = session(list);
        assert_eq!((done.step, done.interrupted), (step, true), "{list:?}");
        assert_eq!(weights(&run).card.training.step, step);
        let precision = weights(&run).card.training.precision;
        assert!(precision.is_empty(), "figures of another step: {precision:?}");
    }
    let done = session(&[Some(0.3)]);
    assert_eq!((done.step, done.interrupted, done.best), (8, false, Some((8, 0.3))));
    assert_eq!(figures(&run, "linear"), [(0, 0.5)]);
    assert_eq!(figures(&run, "evaluation"), [(4, 0.4), (8, 0.3)]);
    let whole = dir.path().join("whole");
    let cancel = Cancel::default();
    let mut evaluator = Listed(vec![Some(0.5), Some(0.4), Some(0.3)], cancel.clone());
    let two = options(&whole, 1, &cancel, &Silent);
    train(&data, &small(8), Options { evaluations: 2, evaluator: Some(&mut evaluator), ..two })
        .unwrap();
    let model = |dir: &Path| std::fs::read(paths::model(dir)).unwrap();
    assert!(model(&run) == model(&whole), "to the byte that of a run nobody stopped");
}

#[test]
fn trajectories_too_short_for_self_correction_are_refused_at_the_start() {
    struct Nobody;
    impl hindsight::Perform for Nobody {
        fn perform(
            &mut self,
            _model: &Model,
            _data: &Dataset,
            _job: &hindsight::Round<'_>,
            _cancel: &Cancel,
        ) -> Result<bool, String> {
            panic!("not before the data were looked at");
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let data = trajectories(&dir.path().join("data"), 0.0, 100);
    let cfg = TrainConfig { self_correct: 1, ..small(4) };
    let (cancel, run) = (Cancel::default(), dir.path().join("run"));
    let mut nobody = Nobody;
    let opts = Options { perform: Some(&mut nobody), ..options(&run, 1, &cancel, &Silent) };
    let e = train(&data, &cfg, opts).unwrap_err().to_string();
    assert!(e.contains("111"), "{e}");
    assert!(!paths::config(&run).exists(), "nothing was begun");
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
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(&dir.path().join("data"));
    // The linear prediction is evaluated first: an untrained network, and the one to keep where no
    // step was better.
    for (linear, want) in [(0.15, (4, 0.1)), (0.05, (0, 0.05))] {
        let (cancel, run) = (Cancel::default(), dir.path().join(format!("run-{linear}")));
        let list = [linear, 0.3, 0.1, 0.2, 0.4].map(Some).to_vec();
        let mut evaluator = Listed(list, cancel.clone());
        let four = options(&run, 1, &cancel, &Silent);
        let four = Options { evaluations: 4, evaluator: Some(&mut evaluator), ..four };
        let done = train(&data, &small(8), four).unwrap();
        assert_eq!((done.best, done.linear), (Some(want), Some(linear)));
        let record = super::record::Record::read(&run).unwrap();
        assert_eq!(record.best().map(|(s, e)| (s, e.precision)), Some(want));
        assert_eq!(record.linear.as_ref().map(|l| l.precision), Some(linear));
        assert!(record.worse_than_linear() && paths::curves(&run).exists());
        let best = checkpoint::load(&paths::best(&run), None).unwrap();
        let training = best.card.training;
        assert_eq!((training.step, training.precision["toy"]), want);
    }
}

fn fit_inverse(data: &Dataset, seed: u64, out: &Path) -> fit::Fitted {
    let settings =
        robert_rollout::InverseSettings { width: 24, steps: 500, batch: 64, ..Default::default() };
    fit::mlp_inverse(data, seed, &settings, out, &Silent, &Cancel::default()).unwrap()
}

#[test]
fn fits_infer_held_out_actions() {
    let dir = tempfile::tempdir().unwrap();
    let data = dataset(dir.path());
    let path = |name: &str| dir.path().join(name);
    let mut ridge = fit::ridge(&data, 0, 2, &path("r"), &Cancel::default()).unwrap();
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
    let found = robert_rollout::Nearest::load(&path("n"), None).unwrap();
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
    let settings = robert_rollout::InverseSettings { width: 8, batch: 8, ..Default::default() };
    let e = fit::mlp_inverse(&data, 0, &settings, &out, &Silent, &cancel).unwrap_err();
    assert_eq!(robert_base::exit::HasExit::exit(&e), robert_base::exit::Exit::Interrupted);
    assert!(!out.exists());
}

#[test]
fn a_fit_is_taken_over_only_where_it_is_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let (_, data, _) = untrained("pointmass", 0, dir.path());
    let (cfg, cancel) = (small(2), Cancel::default());
    let run = dir.path().join("run");
    train(&data, &cfg, options(&run, 2, &cancel, &Silent)).unwrap();
    let model = checkpoint::load(&paths::last(&run), None).unwrap();
    let weights = model.encoder.ridge.as_ref().unwrap().weights().to_vec();
    let (_, _, fresh) = prepare::prepare(&data, &cfg, None, 1, &cancel).unwrap();
    assert_eq!(fresh.ridge.unwrap().weights(), weights, "the file has them in full");
    let linear = FittedRidge::of(model).unwrap();
    let of =
        |cfg: &TrainConfig| linear.suiting(&data, cfg, &prepare::tokeniser(&data, cfg).unwrap());
    assert_eq!(of(&cfg).unwrap().weights(), weights);
    // The network may be another one; the fit may not.
    assert!(of(&TrainConfig { layers: 1, steps: 9, lr: 1e-4, ..cfg.clone() }).is_some());
    for other in [
        TrainConfig { seed: 1, ..cfg.clone() },
        TrainConfig { ridge_penalty: Some(0.1), ..cfg.clone() },
        TrainConfig { ridge_history: 5, ..cfg.clone() },
        TrainConfig { leave_pressing: true, ..cfg.clone() },
        TrainConfig { skip: SkipKind::Off, ..cfg.clone() },
    ] {
        assert!(of(&other).is_none(), "{other:?}");
    }
    // A prepared network has the weights that were handed over, bit by bit.
    let changed: Vec<f32> = weights.iter().map(|w| 2.0 * w).collect();
    let tokens = prepare::tokeniser(&data, &cfg).unwrap();
    let changed = Ridge::new(tokens.ridge_inputs(), tokens.facts().actions, changed).unwrap();
    let given = FittedRidge::new(&data, &cfg, tokens, changed.clone());
    let (_, _, encoder) = prepare::prepare(&data, &cfg, Some(&given), 2, &cancel).unwrap();
    assert_eq!(encoder.ridge.unwrap().weights(), changed.weights());
}
