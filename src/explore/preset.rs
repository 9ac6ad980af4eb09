//! Sizes and schedules of the agents.

use robert_base::json;
use serde::{Deserialize, Serialize};

use super::action_noise::NoiseBounds;
use super::error::Error;

/// A number of environment steps that no training reaches.
const LONG: u64 = 1_000_000_000;

/// Sizes and schedules of an agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preset {
    /// Name.
    pub name: String,
    /// Hidden width of all networks.
    pub hidden: usize,
    /// Transitions in an update.
    pub batch: usize,
    /// Environments side by side.
    pub envs: usize,
    /// Environment steps per update.
    pub update_every: u64,
    /// Steps of uniform random torque before learning starts.
    pub seed_steps: u64,
    /// Steps that the replay memory holds.
    pub capacity: usize,
    /// Whether observations are scaled by their running mean and deviation.
    pub scale_obs: bool,
    /// Learning rate of every network.
    pub lr: f64,
    /// Exploration noise, in training and in roll-outs.
    pub spread: NoiseBounds,
    /// An episode ends when a joint has stood at a stop for this many frames, in training and
    /// in roll-outs; 0 for never. A joint that starts there may stay there. Not for hands,
    /// whose joints reach a stop within a second.
    pub pinned_frames: u64,
    /// Default length of training, environment steps.
    pub steps: u64,
    /// Snapshots are taken at multiples of this, or at the published four when 0.
    pub snapshot_every: u64,
}

impl Preset {
    /// The published sizes of URLB: one environment, h 1024, batch 1024, 2 M steps.
    pub fn urlb() -> Self {
        Preset {
            name: "urlb".to_owned(),
            hidden: 1024,
            batch: 1024,
            envs: 1,
            update_every: 2,
            seed_steps: 4000,
            capacity: 1_000_000,
            scale_obs: false,
            lr: 1e-4,
            spread: NoiseBounds::WHITE,
            pinned_frames: 0,
            steps: 2_000_010,
            snapshot_every: 0,
        }
    }

    /// For a CPU: many environments, few updates, small networks (the direction of parallel
    /// Q-learning, arXiv 2307.12983). One update of RND at the published size costs 54
    /// GFLOP; here .4. Observations are scaled, because an arm's velocities of +-10 beside angles
    /// of +-6 distort the distances of ICM and APT.
    pub fn url_fast() -> Self {
        Preset {
            name: "url-fast".to_owned(),
            hidden: 128,
            batch: 256,
            envs: 16,
            update_every: 8,
            seed_steps: 4000,
            capacity: 1_000_000,
            scale_obs: true,
            lr: 1e-3,
            spread: NoiseBounds { sigma: [0.1, 0.8], tau_secs: [0.06, 4.0] },
            pinned_frames: 0,
            steps: 200_000,
            snapshot_every: 10_000,
        }
    }

    /// The preset of this name.
    ///
    /// # Errors
    /// [`Error::Argument`].
    pub fn named(name: &str) -> Result<Self, Error> {
        match name {
            "urlb" => Ok(Self::urlb()),
            "url-fast" => Ok(Self::url_fast()),
            _ => Err(Error::Argument {
                name: "preset",
                must: "urlb or url-fast".to_owned(),
                got: name.to_owned(),
            }),
        }
    }

    /// Changes one setting, as in `lr=3e-4` or `spread.sigma=[.1,.5]`.
    ///
    /// # Errors
    /// [`Error::Argument`]: no such setting, or a value of another kind.
    pub fn set(&mut self, assignment: &str) -> Result<(), Error> {
        let fail = |must: String| Error::Argument { name: "set", must, got: assignment.to_owned() };
        let (key, text) = assignment.split_once('=').ok_or_else(|| fail("key=value".to_owned()))?;
        let mut all = json::value(&*self);
        let place = all.pointer_mut(&format!("/{}", key.trim().replace('.', "/")));
        let Some(place) = place.filter(|p| !p.is_object()) else {
            return Err(fail("a setting of the preset".to_owned()));
        };
        *place = serde_json::from_str(text).map_err(|e| fail(format!("a value ({e})")))?;
        let next: Preset = serde_json::from_value(all).map_err(|e| fail(e.to_string()))?;
        // The snapshots of a wider network could not be read back; the others would need all
        // memory.
        let bounds = [
            ("hidden", next.hidden as u64, 1, 4096),
            ("batch", next.batch as u64, 1, 1 << 16),
            ("envs", next.envs as u64, 1, 4096),
            ("capacity", next.capacity as u64, 1, 1 << 24),
            ("update_every", next.update_every, 1, LONG),
            ("seed_steps", next.seed_steps, 0, LONG),
        ];
        if let Some((name, _, lo, hi)) = bounds.iter().find(|(_, n, lo, hi)| n < lo || n > hi) {
            return Err(fail(format!("{name} from {lo} to {hi}")));
        }
        let ordered = |[lo, hi]: [f64; 2]| lo >= 0.0 && hi >= lo && hi.is_finite();
        let rate = next.lr > 0.0 && next.lr < 1.0;
        if !(rate && ordered(next.spread.sigma) && ordered(next.spread.tau_secs)) {
            return Err(fail("a possible value".to_owned()));
        }
        *self = next;
        Ok(())
    }

    /// The preset for a training of `steps`: short ones learn from a fifth of their steps on
    /// and still take about twenty snapshots (none closer than 500 steps).
    #[must_use]
    pub fn lasting(mut self, steps: u64) -> Self {
        self.steps = steps;
        self.seed_steps = self.seed_steps.min(steps / 5);
        if self.snapshot_every > 0 {
            self.snapshot_every = self.snapshot_every.min((steps / 20).max(500)).max(1);
        }
        self
    }

    /// Steps at which snapshots are taken, ascending; the last is the end.
    pub fn snapshots(&self) -> Vec<u64> {
        let published = [100_000, 500_000, 1_000_000, 2_000_000];
        let mut at: Vec<u64> = match self.steps.checked_div(self.snapshot_every) {
            None => published.into_iter().filter(|&s| s < self.steps).collect(),
            Some(n) => (1..=n).map(|i| i * self.snapshot_every).collect(),
        };
        if at.last().is_none_or(|&l| l < self.steps && self.snapshot_every > 0) {
            at.push(self.steps);
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_checked() {
        let mut p = Preset::url_fast();
        p.set("lr=3e-4").unwrap();
        p.set("spread.sigma=[0.1,0.5]").unwrap();
        p.set("envs=8").unwrap();
        assert_eq!((p.lr, p.spread.sigma, p.envs), (3e-4, [0.1, 0.5], 8));
        for bad in ["lr", "lr=x", "speed=1", "spread=3", "spread.sigma=[0.5,0.1]", "envs=0"] {
            let before = p.clone();
            assert!(p.set(bad).is_err(), "{bad}");
            assert_eq!(p, before);
        }
    }

    #[test]
    fn sizes_that_cannot_work_are_refused() {
        for (key, most) in [
            ("hidden", 4096),
            ("batch", 65_536),
            ("envs", 4096),
            ("update_every", LONG),
            ("seed_steps", LONG),
        ] {
            let mut p = Preset::url_fast();
            p.set(&format!("{key}={most}")).unwrap();
            let e = p.set(&format!("{key}={}", most + 1)).unwrap_err().to_string();
            assert!(e.contains(&format!("to {most}")), "{e}");
        }
    }

    #[test]
    fn snapshots_end_at_the_end() {
        let fast = Preset::url_fast();
        assert_eq!(fast.snapshots().len(), 20);
        assert_eq!(fast.clone().lasting(2000).snapshots(), [500, 1000, 1500, 2000]);
        assert_eq!(fast.lasting(700).snapshots(), [500, 700]);
        assert_eq!(Preset::urlb().snapshots(), [100_000, 500_000, 1_000_000, 2_000_000]);
        assert_eq!(Preset::urlb().lasting(100).snapshots(), [100]);
    }
}
