//! The actors of roll-outs, and the snapshot file of a trained agent.
//!
//! A snapshot is one safetensors file with the actor and the scaling of its observations,
//! small and read-only; its weights are packed once for all products of a roll-out.

use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::action_noise::{ActionNoise, NoiseBounds};
use super::aps;
use super::babble::{Babble, BabbleRule};
use super::error::Error;
use super::noise::{Noise, NoiseRule};
use robert_base::fsio;
use robert_base::limits;
use robert_base::rng::{Rng, Stream};
use robert_linalg::{Init, Mat, MatMut, Packed, gemm_packed, simd};
use robert_robot::{Gravity, Robot};

/// Format name of a snapshot.
const FORMAT: &str = "robert-agent/1";
/// Key of its header.
const KEY: &str = "robert";

/// The header of a snapshot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SnapshotHeader {
    /// `robert-agent/1`.
    pub(crate) format: String,
    /// Robot id.
    pub(crate) robot: String,
    /// Sha-256 of its MJCF.
    pub(crate) model_sha256: String,
    /// Agent name.
    pub(crate) agent: String,
    /// Environment steps of its training.
    pub(crate) step: u64,
    /// Observations o.
    pub(crate) obs: usize,
    /// Actions A.
    pub(crate) act: usize,
    /// Length of skills, 0 for none.
    pub(crate) skill: usize,
    /// Hidden width.
    pub(crate) hidden: usize,
}

/// Actor parameters and scaling, as stored.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Snapshot {
    pub(crate) header: SnapshotHeader,
    pub(crate) actor: Vec<f32>,
    pub(crate) mean: Vec<f32>,
    pub(crate) inv: Vec<f32>,
}

impl Snapshot {
    /// The file's bytes; the same snapshot gives the same bytes.
    pub(crate) fn bytes(&self) -> Result<Vec<u8>, String> {
        let json = serde_json::to_string(&self.header).map_err(|e| e.to_string())?;
        let tensors =
            [("actor", &self.actor), ("obs_inv_std", &self.inv), ("obs_mean", &self.mean)];
        let mut views = Vec::new();
        for (name, data) in tensors {
            let view = TensorView::new(Dtype::F32, vec![data.len()], bytemuck::cast_slice(data));
            views.push((name, view.map_err(|e| e.to_string())?));
        }
        safetensors::serialize(views, Some(HashMap::from([(KEY.to_owned(), json)])))
            .map_err(|e| e.to_string())
    }

    /// Reads and checks a snapshot.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Checkpoint`].
    pub(crate) fn load(path: &Path) -> Result<Self, Error> {
        let bytes = fsio::read_capped(path, limits::TENSOR_HEADER_BYTES)?;
        Self::parse(&bytes).map_err(|message| Error::Checkpoint { message, path: path.to_owned() })
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let (_, meta) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
        let json = meta.metadata().as_ref().and_then(|m| m.get(KEY));
        let json = json.ok_or("the header has no \"robert\" entry")?;
        let header: SnapshotHeader = serde_json::from_str(json).map_err(|e| e.to_string())?;
        if header.format != FORMAT {
            return Err(format!("format is \"{}\", not \"{FORMAT}\"", header.format));
        }
        let tensors = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
        let read = |name: &str, len: usize| {
            let t = tensors.tensor(name).map_err(|e| e.to_string())?;
            let values: Vec<f32> = bytemuck::pod_collect_to_vec(t.data());
            if t.dtype() != Dtype::F32 || values.len() != len {
                return Err(format!("tensor \"{name}\" does not have {len} f32 values"));
            }
            if values.iter().any(|v| !v.is_finite()) {
                return Err(format!("tensor \"{name}\" contains values that are not finite"));
            }
            Ok(values)
        };
        let sizes = [header.obs, header.act, header.skill, header.hidden];
        if sizes.iter().any(|&n| n > 1 << 14) {
            return Err("the sizes are implausible".to_owned());
        }
        Ok(Snapshot {
            actor: read("actor", header.params())?,
            mean: read("obs_mean", header.obs)?,
            inv: read("obs_inv_std", header.obs)?,
            header,
        })
    }
}

impl SnapshotHeader {
    /// Header of a new snapshot.
    pub(crate) fn new(
        robot: &robert_robot::Robot,
        agent: &str,
        skill: usize,
        hidden: usize,
    ) -> Self {
        SnapshotHeader {
            format: FORMAT.to_owned(),
            robot: robot.id().to_owned(),
            model_sha256: robot.model_sha256().to_owned(),
            agent: agent.to_owned(),
            step: 0,
            obs: 2 * robot.state_dim(),
            act: robot.action_dim(),
            skill,
            hidden,
        }
    }

    fn params(&self) -> usize {
        let (i, h, a) = (self.obs + self.skill, self.hidden, self.act);
        (i + 1) * h + 2 * h + (h + 1) * h + (h + 1) * a
    }
}

/// An actor with its weights packed.
#[derive(Debug)]
pub(crate) struct Actor {
    header: SnapshotHeader,
    mean: Vec<f32>,
    inv: Vec<f32>,
    weights: [Packed<f32>; 3],
    biases: [Vec<f32>; 3],
    gain: Vec<f32>,
    shift: Vec<f32>,
}

/// Work space of [`Actor::act`].
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    x: Vec<f32>,
    a: Vec<f32>,
    b: Vec<f32>,
    stats: Vec<[f32; 2]>,
}

impl Actor {
    /// Packs a snapshot.
    pub(crate) fn new(s: &Snapshot) -> Self {
        let h = &s.header;
        let shapes = [(h.obs + h.skill, h.hidden), (h.hidden, h.hidden), (h.hidden, h.act)];
        let mut rest = s.actor.as_slice();
        let mut take = |n: usize| {
            let (head, tail) = rest.split_at(n.min(rest.len()));
            rest = tail;
            head
        };
        // Order of parameters: as laid out by the network, W b, gain bias, W b, W b.
        let first =
            Packed::new(Mat::new(take(shapes[0].0 * shapes[0].1), shapes[0].0, shapes[0].1));
        let first_bias = take(h.hidden).to_vec();
        let (gain, shift) = (take(h.hidden).to_vec(), take(h.hidden).to_vec());
        let second =
            Packed::new(Mat::new(take(shapes[1].0 * shapes[1].1), shapes[1].0, shapes[1].1));
        let second_bias = take(h.hidden).to_vec();
        let third =
            Packed::new(Mat::new(take(shapes[2].0 * shapes[2].1), shapes[2].0, shapes[2].1));
        let third_bias = take(h.act).to_vec();
        Actor {
            header: h.clone(),
            mean: s.mean.clone(),
            inv: s.inv.clone(),
            weights: [first, second, third],
            biases: [first_bias, second_bias, third_bias],
            gain,
            shift,
        }
    }

    /// Mean actions for observations (rows, o) and skills (rows, k); (rows, A).
    pub(crate) fn act<'s>(
        &self,
        obs: &[f32],
        skills: &[f32],
        rows: usize,
        s: &'s mut Scratch,
    ) -> &'s [f32] {
        let h = &self.header;
        let inputs = h.obs + h.skill;
        s.x.clear();
        for i in 0..rows {
            let row = &obs[i * h.obs..(i + 1) * h.obs];
            s.x.extend(row.iter().zip(&self.mean).zip(&self.inv).map(|((x, m), k)| (x - m) * k));
            s.x.extend_from_slice(&skills[i * h.skill..(i + 1) * h.skill]);
        }
        s.a.resize(rows * h.hidden, 0.0);
        s.b.resize(rows * h.hidden, 0.0);
        s.stats.resize(rows, [0.0; 2]);
        gemm_packed(
            MatMut::new(&mut s.a, rows, h.hidden),
            Init::Bias(&self.biases[0]),
            Mat::new(&s.x, rows, inputs),
            &self.weights[0],
        );
        simd::layer_norm(&s.a, &self.gain, &self.shift, &mut s.b, &mut s.stats);
        simd::tanh(&mut s.b);
        gemm_packed(
            MatMut::new(&mut s.a, rows, h.hidden),
            Init::Bias(&self.biases[1]),
            Mat::new(&s.b, rows, h.hidden),
            &self.weights[1],
        );
        s.a.iter_mut().for_each(|x| *x = x.max(0.0));
        s.b.resize(rows * h.act, 0.0);
        gemm_packed(
            MatMut::new(&mut s.b, rows, h.act),
            Init::Bias(&self.biases[2]),
            Mat::new(&s.a, rows, h.hidden),
            &self.weights[2],
        );
        simd::tanh(&mut s.b);
        &s.b
    }
}

/// An actor.
#[derive(Debug)]
pub(crate) enum ExplorePolicy {
    /// Smooth noise.
    Noise(NoiseRule),
    /// Random references behind weak servos.
    Babble(BabbleRule),
    /// A fresh uniform torque every frame: the naive baseline.
    Uniform,
    /// A trained agent with its exploration noise; one skill for the whole episode.
    Actor(Box<Actor>, NoiseBounds),
}

/// The state of an actor during one episode.
#[derive(Debug)]
pub(crate) enum ActorState {
    Noise(Box<Noise>),
    Babble(Box<Babble>),
    Uniform(Rng),
    Actor(ActionNoise),
}

impl ExplorePolicy {
    /// The gravity that this policy compensates; `None` if the robot has none or the policy does
    /// not compensate it.
    ///
    /// # Errors
    /// [`Error::Robot`].
    pub(crate) fn weight(&self, robot: &Robot) -> Result<Option<Gravity>, Error> {
        match self {
            ExplorePolicy::Babble(_) => Ok(Gravity::of(robot)?),
            _ => Ok(None),
        }
    }

    /// Length of skills.
    pub(crate) fn skill(&self) -> usize {
        match self {
            ExplorePolicy::Actor(a, _) => a.header.skill,
            _ => 0,
        }
    }

    /// Begins the episode with this seed; its skill goes to `skill` (k).
    pub(crate) fn begin(&self, seed: u64, skill: &mut [f32]) -> ActorState {
        match self {
            ExplorePolicy::Noise(rule) => ActorState::Noise(Box::new(Noise::new(rule, seed))),
            ExplorePolicy::Babble(rule) => ActorState::Babble(Box::new(Babble::new(rule, seed))),
            ExplorePolicy::Uniform => ActorState::Uniform(Rng::new(seed, Stream::Noise, 0)),
            ExplorePolicy::Actor(actor, spread) => {
                let mut rng = Rng::new(seed, Stream::Noise, 0);
                if !skill.is_empty() {
                    let w = aps::skill(&mut rng);
                    skill.iter_mut().zip(w).for_each(|(s, w)| *s = w as f32);
                }
                ActorState::Actor(ActionNoise::new(spread, actor.header.act, rng))
            }
        }
    }

    /// Mean actions of all episodes; (rows, A), empty unless a network acts.
    pub(crate) fn think<'s>(
        &self,
        obs: &[f32],
        skills: &[f32],
        rows: usize,
        s: &'s mut Scratch,
    ) -> &'s [f32] {
        match self {
            ExplorePolicy::Actor(a, _) => a.act(obs, skills, rows, s),
            _ => &[],
        }
    }
}

impl ActorState {
    /// The action of one episode. It gets positions and speeds (2 S), the torque against gravity
    /// (S) if the policy compensates it, and the mean action (A) if a network acts.
    pub(crate) fn act(&mut self, obs: &[f32], weight: &[f64], mean: &[f32], action: &mut [f32]) {
        match self {
            ActorState::Noise(noise) => noise.next(action),
            ActorState::Babble(babble) => {
                let (q, v) = obs.split_at(obs.len() / 2);
                babble.next(q, v, weight, action);
            }
            ActorState::Uniform(rng) => {
                for a in action {
                    *a = rng.range(-1.0, 1.0) as f32;
                }
            }
            ActorState::Actor(noise) => noise.act(mean, action),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::ddpg::Ddpg;
    use super::super::mlp::Tape;
    use super::*;

    #[test]
    fn packed_actor_is_the_trained_one() {
        let robot = Robot::builtin("ur5e").unwrap();
        let agent = Ddpg::<f32>::new(10, 5, 10, 24, 3);
        let mut header = SnapshotHeader::new(&robot, "aps", 10, 24);
        header.step = 7;
        let snapshot = Snapshot {
            header,
            actor: agent.actor.params.clone(),
            mean: vec![0.5; 10],
            inv: vec![2.0; 10],
        };
        let bytes = snapshot.bytes().unwrap();
        assert_eq!(Snapshot::parse(&bytes).unwrap(), snapshot);
        assert!(Snapshot::parse(&bytes[..bytes.len() - 4]).is_err());
        let obs: Vec<f32> = (0..30).map(|i| (i as f32 * 0.7).sin()).collect();
        let skills: Vec<f32> = (0..30).map(|i| (i as f32 * 0.3).cos()).collect();
        let mut s = Scratch::default();
        let got = Actor::new(&snapshot).act(&obs, &skills, 3, &mut s).to_vec();
        let mut x = Vec::new();
        for i in 0..3 {
            x.extend(obs[i * 10..(i + 1) * 10].iter().map(|o| (o - 0.5) * 2.0));
            x.extend_from_slice(&skills[i * 10..(i + 1) * 10]);
        }
        assert_eq!(got, agent.actor.forward(&x, 3, &mut Tape::default()));
    }
}
