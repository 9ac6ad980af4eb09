//! The learned policies: `robert`, a trained network, and `ridge`, the linear prediction inside
//! its model file. Both see only the window, and their own past actions.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::Error;
use super::policy::{Policy, View};
use super::reachable::Reachable;
use super::window::Window;
use robert_net::forward::Forwards;
use robert_net::observer::{self, SEEN};
use robert_net::reach::Reach;
use robert_net::{
    self as net, ActionHistory, COMMAND, CURRENT, Encoder, HISTORY, MaskGranularity, Model,
    Observer, RobotCard, WINDOW, checkpoint,
};
use robert_robot::Robot;

/// The robot in the form of a model card.
pub fn robot_card(robot: &Robot) -> RobotCard {
    RobotCard {
        id: robot.id().to_owned(),
        model_sha256: robot.model_sha256().to_owned(),
        joints: robot.joints().iter().map(|j| j.name.clone()).collect(),
        actuators: robot.actuators().iter().map(|a| a.name.clone()).collect(),
    }
}

/// The model file that a path refers to: the file itself; in a run directory the best model, or
/// else the last one; in a dataset's folder the fit.
pub fn model_path(path: &Path) -> PathBuf {
    let inside = ["ckpt/best.safetensors", "model.safetensors", "ridge.safetensors"];
    let inside = inside.map(|name| path.join(name));
    inside.into_iter().find(|p| p.exists()).unwrap_or_else(|| path.to_owned())
}

/// Run directories near a path, for error messages: those in its folder and in `runs`, as they
/// would be typed.
pub fn runs_near(path: &Path) -> Vec<String> {
    let mut folders = vec![path.parent().map_or_else(PathBuf::new, Path::to_path_buf)];
    if folders[0] != Path::new("runs") {
        folders.push(PathBuf::from("runs"));
    }
    let mut found = Vec::new();
    for folder in folders {
        let here = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        for entry in here.read_dir().ok().into_iter().flatten().flatten() {
            if entry.path().join("config.toml").is_file() {
                found.push(folder.join(entry.file_name()).display().to_string());
            }
        }
    }
    found.sort();
    found
}

/// Loads the model of a path and checks that it is for this robot.
///
/// # Errors
/// [`Error::Model`].
pub fn load(robot: &Robot, path: &Path) -> Result<Model, Error> {
    Ok(checkpoint::load(&model_path(path), Some(&robot_card(robot)))?)
}

/// Converts a window of a rollout for the network.
#[derive(Clone, Debug)]
struct Frames {
    granularity: MaskGranularity,
    reachable: Option<Arc<Reachable>>,
    /// Whether masked frames are left to the network.
    masks: bool,
    /// See [`super::inference::Inference::ahead`].
    ahead: usize,
    q: Vec<f32>,        // (51, S)
    visible: Vec<bool>, // (51, S)
}

impl Frames {
    fn new(encoder: &Encoder, reach: Option<&Reach>) -> Self {
        let n = WINDOW * encoder.tokens.state();
        let granularity = encoder.tokens.config().granularity;
        let reachable = reach.map(|r| Arc::new(Reachable::new(r)));
        let (q, visible) = (vec![0.0; n], vec![true; n]);
        Frames { granularity, reachable, masks: false, ahead: 0, q, visible }
    }

    fn sees_plan(&self) -> bool {
        self.reachable.is_some() && !self.masks
    }

    fn fill(&mut self, window: &Window) {
        let s = window.dim();
        let mut put = |window: &Window| {
            let states = window.history.iter().chain(&window.current).chain(&window.command);
            for (to, &x) in self.q.iter_mut().zip(states) {
                *to = x as f32;
            }
            let command = &mut self.visible[(CURRENT + 1) * s..];
            command.copy_from_slice(&window.visible);
        };
        let mut window = window.clone();
        match &self.reachable {
            Some(reachable) if !self.masks => reachable.fill(&mut window),
            // This network was trained on whole frames.
            _ if self.granularity == MaskGranularity::State => window.complete_partial_frames(),
            _ => {}
        }
        if let Some(reachable) = &self.reachable {
            reachable.project(&mut window);
        }
        put(&window);
        if self.ahead > 0 {
            show_one(&mut self.visible[(CURRENT + 1) * s..], s, self.ahead - 1);
        }
    }
}

/// Hides all goals of each joint but one: the first visible one from frame `from` on, or else the last before it.
fn show_one(visible: &mut [bool], joints: usize, from: usize) {
    for j in 0..joints {
        let seen = |i: &usize| visible[i * joints + j];
        let one = (from..COMMAND).find(seen).or_else(|| (0..from).rev().find(seen));
        for i in (0..COMMAND).filter(|i| Some(*i) != one) {
            visible[i * joints + j] = false;
        }
    }
}

/// A trained network.
#[derive(Clone, Debug)]
pub struct Learned {
    policy: net::NetPolicy,
    frames: Frames,
    card: Option<String>,
}

impl Learned {
    /// Whether a device computes; see [`Policy::on`].
    pub fn is_on_device(&self) -> bool {
        self.policy.is_on_device()
    }

    /// The network of a model.
    ///
    /// # Errors
    /// [`Error::Model`].
    pub fn new(model: Model, options: net::NetPolicyConfig) -> Result<Self, Error> {
        let frames = Frames::new(&model.encoder, model.card.reach.as_ref());
        let card = serde_json::to_string_pretty(&model.card).ok();
        Ok(Learned {
            policy: net::NetPolicy::new(model.net, model.encoder, options)?,
            frames,
            card,
        })
    }

    /// Leaves masked frames to the network, even if the model contains data to fill gaps.
    #[must_use]
    pub fn with_masks(mut self, masks: bool) -> Self {
        self.frames.masks = masks;
        self
    }

    /// Shows the network a single goal of each window; see [`super::inference::Inference::ahead`].
    #[must_use]
    pub fn with_ahead(mut self, ahead: usize) -> Self {
        self.frames.ahead = ahead;
        self
    }
}

impl Policy for Learned {
    fn name(&self) -> String {
        "robert".to_owned()
    }

    fn sees_plan(&self) -> bool {
        self.frames.sees_plan()
    }

    fn card(&self) -> Option<String> {
        self.card.clone()
    }

    fn reset(&mut self, seed: u64) {
        self.policy.reset(seed);
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.frames.fill(view.window);
        let found = self.policy.act(&self.frames.q, &self.frames.visible, view.frame as u64);
        for (to, &x) in action.iter_mut().zip(found) {
            *to = f64::from(x);
        }
        Ok(())
    }

    fn applied(&mut self, action: &[f64]) {
        self.policy.applied(action);
    }

    fn on(&mut self, device: &dyn Forwards) {
        self.policy.on(device);
    }

    fn fork(&self) -> Option<Box<dyn Policy>> {
        Some(Box::new(self.clone()))
    }

    fn memory(&self) -> Vec<f64> {
        self.policy.memory()
    }

    fn recall(&mut self, memory: &[f64]) {
        self.policy.recall(memory);
    }
}

/// The linear prediction alone, without a network; fitted in seconds.
#[derive(Clone, Debug)]
pub struct Linear {
    encoder: Arc<Encoder>,
    frames: Frames,
    scratch: net::token::Scratch,
    features: Vec<f32>,
    answer: Vec<f32>,
    /// The actions of the last frames, oldest first, (at most 30, A), if the prediction is scaled by
    /// what they reveal.
    past: Option<Vec<f32>>,
    observer: Option<Observer>,
    card: Option<String>,
}

impl Linear {
    /// The linear prediction inside a model.
    ///
    /// # Errors
    /// [`Error::Needs`] when the model has none.
    pub fn new(encoder: Encoder) -> Result<Self, Error> {
        if encoder.ridge.is_none() {
            return Err(Error::Needs {
                policy: "ridge".to_owned(),
                needs: "a model with a linear skip; this one was trained without".to_owned(),
            });
        }
        Ok(Linear {
            frames: Frames::new(&encoder, None),
            scratch: encoder.tokens.scratch(),
            features: Vec::new(),
            answer: vec![0.0; encoder.tokens.facts().actions],
            encoder: Arc::new(encoder),
            past: None,
            observer: None,
            card: None,
        })
    }

    /// Adds the card of its model, and the observer that it names.
    #[must_use]
    pub fn with_card(self, card: &net::Card) -> Self {
        let frames = Frames::new(&self.encoder, card.reach.as_ref());
        let observer = Observer::new(card.observer, self.answer.len());
        Linear { card: serde_json::to_string_pretty(card).ok(), frames, observer, ..self }
    }

    /// Adds the disturbance that past motion shows to each action; the newest frame counts `percent`
    /// in it, and 0 is off. `None` is what the card says.
    ///
    /// # Errors
    /// [`Error::Model`] if `percent` is above 100, or the observed frame has too few frames before it.
    pub fn with_observer(self, percent: Option<u8>) -> Result<Self, Error> {
        let Some(percent) = percent else { return Ok(self) };
        observer::check(percent, self.encoder.tokens.config())?;
        let observer = Observer::new(percent, self.answer.len());
        Ok(Linear { observer, ..self })
    }

    /// Scales each actuator's prediction by the ratio of applied to predicted actions over the last
    /// 30 frames, which reveals a robot that is heavier, more damped or weaker than those of the fit.
    #[must_use]
    pub fn with_gain(self, gain: bool) -> Self {
        Linear { past: gain.then(Vec::new), ..self }
    }

    /// The action for this window, (A).
    pub fn answer(&mut self, window: &Window, action: &mut [f64]) {
        debug_assert_eq!(window.history.len(), HISTORY * window.dim());
        self.frames.fill(window);
        let (tokens, now) = (&self.encoder.tokens, CURRENT..CURRENT + 1);
        tokens.read(&self.frames.q, &self.frames.visible, &mut self.scratch);
        let gain = self.gain();
        let Some(ridge) = &self.encoder.ridge else {
            unreachable!("a linear policy is made from an encoder with a linear prediction")
        };
        let tokens = &self.encoder.tokens;
        ridge.answers(tokens, &self.scratch, now, &mut self.features, &mut self.answer);
        for (j, (to, &x)) in action.iter_mut().zip(&self.answer).enumerate() {
            let gain = gain.as_ref().map_or(1.0, |g| 1.0 + g.gain()[j]);
            *to = f64::from((gain * x).clamp(-1.0, 1.0));
        }
        self.observe(gain.as_ref(), action);
        self.remember(action);
    }

    /// Adds the disturbance that the window which was just read reveals to `action`, (A).
    fn observe(&mut self, gain: Option<&ActionHistory>, action: &mut [f64]) {
        let (Some(observer), Some(ridge)) = (&mut self.observer, &self.encoder.ridge) else {
            return;
        };
        let (tokens, seen) = (&self.encoder.tokens, SEEN..SEEN + 1);
        ridge.answers(tokens, &self.scratch, seen, &mut self.features, &mut self.answer);
        if let Some(gain) = gain {
            self.answer.iter_mut().zip(gain.gain()).for_each(|(x, g)| *x *= 1.0 + g);
        }
        let mut sum: Vec<f32> = action.iter().map(|&x| x as f32).collect();
        observer.correct(&self.answer, &mut sum);
        action.iter_mut().zip(&sum).for_each(|(to, &x)| *to = f64::from(x));
    }

    /// What the past of the window that was just read reveals.
    fn gain(&mut self) -> Option<ActionHistory> {
        let (past, ridge) = (self.past.as_ref()?, self.encoder.ridge.as_ref()?);
        let tokens = &self.encoder.tokens;
        let actions = tokens.facts().actions;
        let mut history = ActionHistory::new(actions);
        // The oldest frames of the window have no past from which to predict.
        let back = tokens.config().ridge_history;
        let first = (CURRENT - past.len() / actions).max(back);
        let past = &past[past.len() - (CURRENT - first) * actions..];
        let mut predicted = vec![0.0; past.len()];
        ridge.answers(tokens, &self.scratch, first..CURRENT, &mut self.features, &mut predicted);
        for (applied, predicted) in past.chunks(actions).zip(predicted.chunks(actions)) {
            history.see(applied, predicted);
        }
        Some(history)
    }

    /// Adds an applied action to the past.
    fn remember(&mut self, action: &[f64]) {
        if let Some(past) = &mut self.past {
            let most = HISTORY * action.len();
            past.extend(action.iter().map(|&x| x as f32));
            past.drain(..past.len().saturating_sub(most));
        }
        if let Some(observer) = &mut self.observer {
            observer.remember(action.iter().map(|&x| x as f32));
        }
    }
}

impl Policy for Linear {
    fn name(&self) -> String {
        "ridge".to_owned()
    }

    fn sees_plan(&self) -> bool {
        self.frames.sees_plan()
    }

    fn card(&self) -> Option<String> {
        self.card.clone()
    }

    fn reset(&mut self, _seed: u64) {
        self.past.iter_mut().for_each(Vec::clear);
        if let Some(observer) = &mut self.observer {
            observer.reset();
        }
    }

    fn fork(&self) -> Option<Box<dyn Policy>> {
        Some(Box::new(self.clone()))
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.answer(view.window, action);
        Ok(())
    }

    fn applied(&mut self, action: &[f64]) {
        let narrow = || action.iter().map(|&x| x as f32);
        if let Some(past) = &mut self.past {
            past.truncate(past.len().saturating_sub(action.len()));
            past.extend(narrow());
        }
        if let Some(observer) = &mut self.observer {
            observer.replace(narrow());
        }
    }

    fn memory(&self) -> Vec<f64> {
        let past = self.past.iter().flatten().map(|&x| f64::from(x));
        let Some(observer) = &self.observer else { return past.collect() };
        let seen: Vec<f64> = observer.memory().collect();
        std::iter::once(seen.len() as f64).chain(seen).chain(past).collect()
    }

    fn recall(&mut self, memory: &[f64]) {
        let mut rest = memory;
        if let (Some(observer), Some((&seen, all))) = (&mut self.observer, memory.split_first()) {
            let (seen, past) = all.split_at(seen as usize);
            observer.recall(seen);
            rest = past;
        }
        if let Some(past) = &mut self.past {
            past.clear();
            past.extend(rest.iter().map(|&x| x as f32));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Rollout, RolloutConfig, Start};
    use robert_net::ridge::Ridge;
    use robert_net::token::RIDGE_HEADS;
    use robert_net::{
        Card, Facts, JointFacts, Mixing, Net, NetConfig, Normaliser, SkipKind, TokenConfig,
        Tokeniser,
    };

    /// A gated network around a linear prediction of constant actions, for the puck.
    fn model(robot: &Robot, granularity: MaskGranularity) -> Model {
        let s = robot.state_dim();
        let joints = vec![JointFacts { hinge: false, range: None }; s];
        let facts = Facts { joints, actions: robot.action_dim() };
        let one = |x: f64| vec![x; s];
        let norm =
            Normaliser { mean: one(0.0), std: one(1.0), std_d1: one(0.05), std_d2: one(0.01) };
        let cfg = TokenConfig { granularity, ..TokenConfig::for_robot(&facts) };
        let tokens = Tokeniser::new(cfg, facts, &norm).unwrap();
        let inputs = tokens.ridge_inputs();
        let mut weights = vec![0.0; RIDGE_HEADS * inputs * robot.action_dim()];
        // Proportional to the goal velocity of each joint.
        for head in weights.chunks_mut(inputs * s) {
            for j in 0..s {
                head[(s + j) * s + j] = 0.3;
            }
        }
        let ridge = Ridge::new(inputs, s, weights).unwrap();
        let encoder = Encoder::new(tokens, Some(ridge)).unwrap();
        let net_cfg = NetConfig {
            layers: 2,
            width: 32,
            heads: 2,
            inputs: encoder.inputs(),
            actions: robot.action_dim(),
            bins: 1,
            offset_weight: 10.0,
            mask_replaces: false,
            skip: SkipKind::Gated,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        };
        let net = Net::init(net_cfg.clone(), None, 1).unwrap();
        let training = net::checkpoint::TrainingCard::default();
        let card = Card::new(robot_card(robot), net_cfg, &encoder.tokens, norm, training);
        Model { card, net, encoder, optimiser: None }
    }

    fn command(robot: &Robot) -> robert_clip::Command {
        let joints: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
        let (n, s) = (60, robot.state_dim());
        let q: Vec<f32> = (0..n * s).map(|i| if i / s >= 30 { 0.2 } else { 0.0 }).collect();
        let visible: Vec<bool> =
            (0..n * s).map(|i| i / s % 15 == 0 || i % s == 0 && i / s > 40).collect();
        robert_clip::Command::from_dense(joints, vec![0.0; s], q, visible).unwrap()
    }

    #[test]
    fn an_untrained_gate_is_the_linear_answer() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        for granularity in [MaskGranularity::State, MaskGranularity::Joint] {
            let model = model(&robot, granularity);
            let run = |policy: Box<dyn Policy>| {
                let start = Start::Pose;
                let config = RolloutConfig::default();
                let mut r = Rollout::new(&robot, policy, &command(&robot), start, config).unwrap();
                r.run(&robert_base::progress::Cancel::default()).unwrap();
                r.actions().to_vec()
            };
            let robert = Learned::new(model.clone(), net::NetPolicyConfig::default()).unwrap();
            let (a, b) =
                (run(Box::new(robert)), run(Box::new(Linear::new(model.encoder).unwrap())));
            assert!(a.iter().any(|x| x.abs() > 0.01), "it does something");
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }

    #[test]
    fn one_goal_of_a_window_is_shown() {
        let shown = |goals: &[usize], ahead: usize| -> Vec<usize> {
            // The second joint has its only goal in the last frame.
            let of = |i: usize| [goals.contains(&(i + 1)), i + 1 == COMMAND];
            let mut visible: Vec<bool> = (0..COMMAND).flat_map(of).collect();
            show_one(&mut visible, 2, ahead - 1);
            let second: Vec<bool> = visible.iter().skip(1).step_by(2).copied().collect();
            assert_eq!(second.iter().position(|v| *v), Some(COMMAND - 1));
            let first = visible.iter().step_by(2).enumerate();
            first.filter_map(|(i, v)| v.then_some(i + 1)).collect()
        };
        let all: Vec<usize> = (1..=COMMAND).collect();
        assert_eq!(shown(&all, 2), [2]);
        assert_eq!(shown(&all, COMMAND), [COMMAND]);
        assert_eq!(shown(&[1, 7, 9], 2), [7]);
        assert_eq!(shown(&[1, 3], 5), [3]);
        assert!(shown(&[], 5).is_empty());
    }

    #[test]
    fn ensembles_resume_where_they_were() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let model = model(&robot, MaskGranularity::State);
        let options = net::NetPolicyConfig { ensemble: 4, ..Default::default() };
        let policy = Box::new(Learned::new(model, options).unwrap());
        let start = Start::Pose;
        let mut r = Rollout::new(&robot, policy, &command(&robot), start, RolloutConfig::default())
            .unwrap();
        let cancel = robert_base::progress::Cancel::default();
        r.run(&cancel).unwrap();
        let whole = r.actions().to_vec();
        // A goal near the end is changed and changed back, so frames are simulated again from
        // there.
        let joints: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
        let s = robot.state_dim();
        let rest = robert_clip::Command::from_dense(
            joints,
            vec![0.0; s],
            (0..60 * s).map(|i| if i / s >= 45 { 0.4 } else { 0.0 }).collect(),
            vec![true; 60 * s],
        )
        .unwrap();
        r.set_command(&rest).unwrap();
        r.run(&cancel).unwrap();
        assert_ne!(whole, r.actions());
        r.set_command(&command(&robot)).unwrap();
        r.run(&cancel).unwrap();
        assert_eq!(whole, r.actions());
    }

    fn of(task: &str) -> robert_clip::Command {
        robert_clip::compile(&crate::tasks::find(task, None).unwrap()).unwrap()
    }

    /// A task of the UR5e on this plant, performed by a policy as it is typed.
    fn arm(plant: robert_robot::PlantConfig, policy: &str, task: &str) -> Rollout {
        let robot = Arc::new(Robot::builtin("ur5e").unwrap());
        let policy: crate::PolicyConfig = policy.parse().unwrap();
        let policy = policy.build(&robot).unwrap();
        let config = RolloutConfig { plant, ..RolloutConfig::default() };
        let mut r = Rollout::new(&robot, policy, &of(task), Start::Pose, config).unwrap();
        r.run(&robert_base::progress::Cancel::default()).unwrap();
        r
    }

    #[test]
    fn past_actions_reveal_a_weak_motor() {
        let plant = robert_robot::PlantConfig { gear: 0.6, ..Default::default() };
        let cancel = robert_base::progress::Cancel::default();
        let run = |policy: &str, task| arm(plant, policy, task);
        let (task, other) = ("ur5e/ellipse_air", "ur5e/drift");
        let error = |policy| run(policy, task).precision().precision.unwrap();
        let (fixed, scaled) = (error("ridge"), error("ridge+gain"));
        assert!(scaled < 0.3 * fixed, "{scaled} {fixed}");
        // It goes on from any frame, with the actions before it.
        let mut changed = run("ridge+gain", other);
        changed.set_command(&of(task)).unwrap();
        changed.run(&cancel).unwrap();
        assert_eq!(changed.actions(), run("ridge+gain", task).actions());
    }

    #[test]
    fn an_observer_holds_a_load_that_the_model_does_not_know() {
        let plant = robert_robot::PlantConfig { payload: 3.0, ..Default::default() };
        let cancel = robert_base::progress::Cancel::default();
        let run = |policy: &str, task| arm(plant, policy, task);
        let task = "ur5e/ellipse_air";
        let error = |policy: &str| run(policy, task).precision().precision.unwrap();
        for policy in ["ridge", "robert"] {
            let (without, with) = (error(policy), error(&format!("{policy}+observer=30")));
            assert!(with < 0.4 * without, "{policy}: {with} {without}");
        }
        // It goes on from a frame in the middle, with what was observed before it.
        let of_all = of(task);
        let mut values = of_all.filled();
        let (frames, dim) = (of_all.frames() as usize, of_all.dim());
        values[(frames - 10) * dim..].iter_mut().for_each(|x| *x += 0.1);
        let start = of_all.start().to_vec();
        let joints = of_all.joints().to_vec();
        let seen = vec![true; frames * dim];
        let ended = robert_clip::Command::from_dense(joints, start, values, seen).unwrap();
        let all = [
            "ridge+observer=30",
            "ridge+gain+observer=30",
            "robert+observer=30+ensemble=3",
            "ridge+observer=30+refine",
        ];
        for policy in all {
            let mut changed = run(policy, task);
            let whole = changed.actions().to_vec();
            let from = changed.set_command(&ended).unwrap();
            assert!(from > 0, "{policy}");
            changed.run(&cancel).unwrap();
            assert_ne!(changed.actions(), whole, "{policy}");
            assert!(changed.set_command(&of_all).unwrap() > 0, "{policy}");
            changed.run(&cancel).unwrap();
            assert_eq!(changed.actions(), whole, "{policy}");
        }
    }

    #[test]
    fn the_observer_of_a_card_is_used_by_both_policies() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let run = |policy: Box<dyn Policy>| {
            // The mass is five times as heavy as the model believes.
            let plant = robert_robot::PlantConfig { mass: 5.0, ..Default::default() };
            let config = RolloutConfig { plant, ..RolloutConfig::default() };
            let goals = command(&robot);
            let mut r = Rollout::new(&robot, policy, &goals, Start::Pose, config).unwrap();
            r.run(&robert_base::progress::Cancel::default()).unwrap();
            r.actions().to_vec()
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.safetensors");
        let file = |observer| {
            let mut model = model(&robot, MaskGranularity::State);
            model.card.observer = observer;
            // So strong that actions reach their bounds.
            let ridge = model.encoder.ridge.take().unwrap();
            let strong = ridge.weights().iter().map(|w| 20.0 * w).collect();
            let ridge = Ridge::new(model.encoder.tokens.ridge_inputs(), 2, strong).unwrap();
            checkpoint::save(&path, &model.card, &model.net, Some(&ridge), None).unwrap();
        };
        let all = |options: &str| {
            ["robert", "ridge"].map(|name| {
                let text = format!("{name}:{}{options}", path.display());
                run(text.parse::<crate::PolicyConfig>().unwrap().build(&robot).unwrap())
            })
        };
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        file(0);
        let (without, with) = (all(""), all("+observer=30"));
        assert!(without[0].iter().any(|x| x.abs() == 1.0), "bounds are reached");
        assert!(near(&with[0], &with[1]), "an untrained network is the linear prediction");
        assert!(!near(&without[0], &with[0]));
        file(30);
        assert_eq!((all(""), all("+observer=0")), (with, without));
        // A network that has not learned to infer past actions cannot have one.
        let mut card = model(&robot, MaskGranularity::State).card;
        assert!(card.may_observe(30).is_ok());
        card.tokens.ridge_history = SEEN;
        assert!(card.may_observe(30).is_err() && card.may_observe(0).is_ok());
        let mut card = model(&robot, MaskGranularity::State).card;
        card.training.config = serde_json::json!({ "current_only": true });
        assert!(card.may_observe(30).is_err() && card.may_observe(0).is_ok());
        // What no program writes is refused with the file.
        file(101);
        let refused = load(&robot, &path).unwrap_err().to_string();
        assert!(
            refused.contains("0 to 100 percent") && refused.contains("model.safe"),
            "{refused}"
        );
    }

    #[test]
    fn a_model_of_another_robot_is_refused() {
        let robot = Robot::builtin("pointmass").unwrap();
        let model = model(&robot, MaskGranularity::State);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.safetensors");
        let ridge = model.encoder.ridge.as_ref();
        checkpoint::save(&path, &model.card, &model.net, ridge, None).unwrap();
        assert!(load(&robot, dir.path()).is_ok(), "a run directory will do");
        let other = Robot::builtin("ur5e").unwrap();
        let e = load(&other, &path).unwrap_err().to_string();
        assert!(e.contains("trained for pointmass") && e.contains("ur5e"), "{e}");
    }
}
