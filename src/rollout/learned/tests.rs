use std::sync::Arc;

use super::*;
use crate::{Linear, load, robot_card};
use crate::{Rollout, RolloutConfig, Start};
use robert_net::observer::SEEN;
use robert_net::ridge::Ridge;
use robert_net::token::RIDGE_HEADS;
use robert_net::{
    Card, Encoder, Facts, JointFacts, MaskGranularity, Mixing, Net, NetConfig, Normaliser,
    SkipKind, TokenConfig, Tokeniser, checkpoint,
};
use robert_robot::Robot;

/// A gated network around a linear prediction of constant actions, for the puck.
fn model(robot: &Robot, granularity: MaskGranularity) -> Model {
    let s = robot.state_dim();
    let joints = vec![JointFacts { hinge: false, range: None }; s];
    let facts = Facts { joints, actions: robot.action_dim() };
    let one = |x: f64| vec![x; s];
    let norm = Normaliser { mean: one(0.0), std: one(1.0), std_d1: one(0.05), std_d2: one(0.01) };
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
        let (a, b) = (run(Box::new(robert)), run(Box::new(Linear::new(model.encoder).unwrap())));
        assert!(a.iter().any(|x| x.abs() > 0.01), "it does something");
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}

#[test]
fn ensembles_resume_where_they_were() {
    let robot = Arc::new(Robot::builtin("pointmass").unwrap());
    let model = model(&robot, MaskGranularity::State);
    let options = net::NetPolicyConfig { ensemble: 4, ..Default::default() };
    let policy = Box::new(Learned::new(model, options).unwrap());
    let start = Start::Pose;
    let mut r =
        Rollout::new(&robot, policy, &command(&robot), start, RolloutConfig::default()).unwrap();
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
    assert!(refused.contains("0 to 100 percent") && refused.contains("model.safe"), "{refused}");
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
