//! `take.json`, the attachment before all messages: everything about a take that is not a time
//! series.

use serde::{Deserialize, Serialize};

use super::document::{Provenance, RobotFacts, Take};
use super::error::Error;
use robert_base::limits;
use robert_base::units::FPS;
use robert_rollout::Precision;

/// The format this program writes.
pub(super) const FORMAT: &str = "robert-take/1";

/// Names of the attachments.
pub(super) const TAKE_JSON: &str = "take.json";
pub(super) const CLIP_JSON: &str = "clip.json";
pub(super) const CONFIG_TOML: &str = "config.toml";
pub(super) const MODEL_CARD: &str = "model_card.json";

/// Figures for people and scripts that read the attachment alone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Figures {
    pub precision: Option<f64>,
    pub masked_mae: Option<f64>,
    pub p95: Option<f64>,
    pub hold_end: Option<f64>,
    pub frames_late: Option<f64>,
    pub mean_abs_du: f64,
    pub saturation: f64,
}

impl From<&Precision> for Figures {
    fn from(p: &Precision) -> Figures {
        Figures {
            precision: p.precision,
            masked_mae: p.masked_mae,
            p95: p.p95,
            hold_end: p.hold_end,
            frames_late: p.frames_late,
            mean_abs_du: p.mean_abs_du,
            saturation: p.saturation,
        }
    }
}

/// The document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Header {
    pub format: String,
    pub fps: u32,
    pub frames: usize,
    pub command_frames: u32,
    /// Command before frame 0; (S).
    pub start: Vec<f32>,
    pub clip_sha256: Option<String>,
    pub robot: RobotFacts,
    pub provenance: Provenance,
    pub figures: Figures,
}

impl Header {
    pub(super) fn of(take: &Take) -> Header {
        Header {
            format: FORMAT.to_owned(),
            fps: FPS,
            frames: take.frames(),
            command_frames: take.command.frames(),
            start: take.command.start().to_vec(),
            clip_sha256: take.clip_sha256(),
            robot: take.robot.clone(),
            provenance: take.provenance.clone(),
            figures: Figures::from(&take.precision()),
        }
    }

    /// Reads and checks it: sizes, versions, names.
    pub(super) fn parse(bytes: &[u8]) -> Result<Header, Error> {
        let wrong = |problem: String| Error::foreign(format!("{TAKE_JSON}: {problem}"));
        // The version is checked first, since a later one may have other fields.
        let peek: serde_json::Value =
            serde_json::from_slice(bytes).map_err(|e| wrong(e.to_string()))?;
        let format = peek.get("format").and_then(serde_json::Value::as_str).unwrap_or_default();
        if format != FORMAT {
            let name: String = format.chars().take(40).collect();
            return Err(wrong(format!("the format is {name:?}; this program reads {FORMAT}")));
        }
        let header: Header = serde_json::from_slice(bytes).map_err(|e| wrong(e.to_string()))?;
        header.check().map_err(wrong)?;
        Ok(header)
    }

    fn check(&self) -> Result<(), String> {
        let robot = &self.robot;
        let dim = robot.joints.len();
        if self.fps != FPS {
            return Err(format!("{} frames a second, not {FPS}", self.fps));
        }
        let cap = limits::CLIP_FRAMES as usize;
        for frames in [self.frames, self.command_frames as usize] {
            if frames == 0 || frames > cap {
                return Err(format!("{frames} frames; 1 to {cap} can be read"));
            }
        }
        if dim == 0 || dim > limits::JOINTS || self.start.len() != dim || robot.units.len() != dim {
            return Err(format!(
                "{dim} joints, {} units and {} start values",
                robot.units.len(),
                self.start.len()
            ));
        }
        if self.start.iter().any(|v| !v.is_finite()) {
            return Err("a start value is not a number".to_owned());
        }
        if robot.actuators.len() > limits::JOINTS || robot.bodies.len() > limits::BODIES {
            let (a, b) = (robot.actuators.len(), robot.bodies.len());
            return Err(format!("{a} actuators and {b} bodies are too many"));
        }
        let values = self.frames.max(self.command_frames as usize).saturating_mul(dim);
        if values > limits::CLIP_VALUES {
            return Err(format!("{} frames of {dim} joints are too many", self.frames));
        }
        let names = robot.joints.iter().chain(&robot.actuators).chain(&robot.bodies);
        if let Some(long) = names.map(String::len).find(|n| *n > limits::NAME_BYTES) {
            return Err(format!("a name of {long} bytes"));
        }
        for (i, joint) in robot.joints.iter().enumerate() {
            if robot.joints.iter().take(i).any(|j| j == joint) {
                return Err(format!("joint {joint:?} appears twice"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;

    fn problem(change: impl Fn(&mut serde_json::Value)) -> String {
        let (_, take) = sample::take("pointmass", 5, 5);
        let mut json = serde_json::to_value(Header::of(&take)).unwrap();
        change(&mut json);
        let bytes = serde_json::to_vec(&json).unwrap();
        Header::parse(&bytes).map_or_else(|e| e.to_string(), |_| "fine".to_owned())
    }

    #[test]
    fn caps_and_versions_are_checked() {
        assert_eq!(problem(|_| ()), "fine");
        assert!(problem(|j| j["format"] = "robert-take/2".into()).contains("reads robert-take/1"));
        assert!(problem(|j| j["fps"] = 30.into()).contains("30 frames a second"));
        let cap = limits::CLIP_FRAMES;
        assert_eq!(problem(|j| j["frames"] = cap.into()), "fine");
        assert!(problem(|j| j["frames"] = (cap + 1).into()).contains("frames"));
        assert!(problem(|j| j["frames"] = 0.into()).contains("frames"));
        let names = |n: usize| (0..n).map(|i| format!("n{i}")).collect::<Vec<_>>();
        assert_eq!(problem(|j| j["robot"]["bodies"] = names(limits::BODIES).into()), "fine");
        let many = names(limits::BODIES + 1);
        assert!(problem(|j| j["robot"]["bodies"] = many.clone().into()).contains("too many"));
        assert!(
            problem(|j| j["robot"]["joints"][1] = j["robot"]["joints"][0].clone())
                .contains("twice")
        );
        assert!(
            problem(|j| j["robot"]["joints"][0] = "x".repeat(300).into()).contains("300 bytes")
        );
        assert!(problem(|j| j["start"] = serde_json::json!([0.0])).contains("start values"));
        assert!(problem(|j| j["more"] = 1.into()) == "fine", "later minor fields are passed over");
    }
}
