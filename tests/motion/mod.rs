//! From clip to motion through the command line: rollout, eval, tasks, examples.

mod diverge;
mod eval;
mod examples;
mod rollout;
mod shipped;

/// A puck that goes from one goal to another: small enough to plan for in no time.
pub(crate) const HOP: &str = r#"{
  "format": "robert-clip/1",
  "name": "hop",
  "robot": {"id": "pointmass", "joints": ["x", "y"]},
  "fps": 20, "length": 21, "fill": "mask",
  "keys": [
    {"frame": 0, "q": [0, 0]},
    {"frame": 12, "q": [0.2, -0.1], "hold": 9}
  ]
}
"#;
