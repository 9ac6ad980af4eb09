//! The whole take as one JSON document.

use robert_base::json;
use serde::Serialize;

use super::document::{Take, What, row};
use super::header::Header;
use robert_base::units::CTRL_DT;
use robert_clip::formats;
use robert_rollout::Precision;

#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    header: Header,
    precision: Precision,
    /// Frames x joints; `null` where masked.
    command: Vec<Vec<Option<f32>>>,
    achieved: Vec<Row<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clip: Option<serde_json::Value>,
}

#[derive(Serialize)]
struct Row<'a> {
    frame: usize,
    time: f64,
    position: &'a [f64],
    velocity: &'a [f64],
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    effort: &'a [f64],
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    action: &'a [f64],
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    ctrl: &'a [f64],
    error: Option<f64>,
}

impl Take {
    /// JSON: everything except the body poses. The command has the dense form that can be read as a
    /// clip.
    pub fn to_json(&self, what: What) -> String {
        if what == What::Command {
            return formats::to_command_json(&self.command, &self.robot.id);
        }
        let precision = self.precision();
        let (dim, actions) = (self.state_dim(), self.action_dim());
        let seen = |f: u32| {
            let goal = |(j, v): (usize, &f32)| self.command.sees(f, j).then_some(*v);
            self.command.row(f).iter().enumerate().map(goal).collect()
        };
        let achieved = (0..self.frames())
            .map(|f| Row {
                frame: f,
                time: (f as f64 * CTRL_DT * 100.0).round() / 100.0,
                position: self.state(f),
                velocity: row(&self.velocity, f, dim),
                effort: row(&self.effort, f, dim),
                action: row(&self.actions, f, actions),
                ctrl: row(&self.ctrl, f, actions),
                error: precision.per_frame.get(f).copied().flatten(),
            })
            .collect();
        let document = Document {
            header: Header::of(self),
            command: (0..self.command.frames()).map(seen).collect(),
            achieved,
            clip: self.clip_text.as_ref().and_then(|t| serde_json::from_str(t).ok()),
            precision,
        };
        // Numbers and strings only: serialising cannot fail.
        let mut text = json::line(&document);
        // One frame per line.
        text = text.replace("},{\"frame\":", "},\n{\"frame\":");
        text.push('\n');
        text
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;

    #[test]
    fn json_holds_numbers_exactly() {
        let (_, take) = sample::take("ur5e", 30, 20);
        let json: serde_json::Value = serde_json::from_str(&take.to_json(What::Achieved)).unwrap();
        assert_eq!(json["format"], "robert-take/1");
        assert_eq!(json["frames"], 20);
        assert_eq!(json["achieved"].as_array().unwrap().len(), 20);
        assert_eq!(json["command"].as_array().unwrap().len(), 30);
        assert!(json["command"][1][0].is_null() && json["command"][0][0].is_number());
        let last: Vec<f64> =
            serde_json::from_value(json["achieved"][19]["position"].clone()).unwrap();
        assert_eq!(last, take.state(19));
        let precision: Precision = serde_json::from_value(json["precision"].clone()).unwrap();
        assert_eq!(precision, take.precision());
        assert_eq!(json["clip"]["format"], "robert-clip/1");
        assert_eq!(json["robot"]["id"], "ur5e");
    }
}
