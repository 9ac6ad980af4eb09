//! A robot's model that contains keyframes, so that simulators can load the file alone.

use super::Robot;

impl Robot {
    /// The MJCF with the `<keyframe>` block of `keys` (an export that contains nothing else) before
    /// its end. `None` if either is not closed properly.
    ///
    /// Meshes stay separate files, so such a text belongs in the robot's folder; see
    /// [`Robot::has_assets`].
    pub fn mjcf_with_keys(&self, keys: &str) -> Option<String> {
        let from = keys.find("<keyframe>")?;
        let to = keys.find("</keyframe>")? + "</keyframe>".len();
        let end = self.mjcf().rfind("</mujoco>")?;
        let (model, tail) = self.mjcf().split_at(end);
        Some(format!("{}\n\n  {}\n{tail}", model.trim_end(), keys.get(from..to)?))
    }

    /// Whether the model refers to other files, such as meshes.
    pub fn has_assets(&self) -> bool {
        !self.assets.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_mujoco::Model;

    #[test]
    fn every_robot_with_keys_loads_by_itself() {
        for id in Robot::builtin_ids() {
            let robot = Robot::builtin(id).unwrap();
            let q: Vec<String> = robot.home().iter().map(ToString::to_string).collect();
            let keys = format!(
                "<mujoco>\n  <!-- names -->\n  <keyframe>\n    <key name=\"a\" time=\"0.5\" qpos=\"{}\"/>\n  </keyframe>\n</mujoco>\n",
                q.join(" ")
            );
            let text = robot.mjcf_with_keys(&keys).unwrap();
            let files: [(&str, &[u8]); 1] = [("robot.xml", text.as_bytes())];
            let model = Model::from_assets("robot.xml", &files).unwrap();
            assert_eq!(model.nq(), robot.state_dim(), "{id}");
            assert_eq!(text.matches("<key ").count(), 1, "{id}");
            assert!(!robot.has_assets());
            // The export alone is not a model of this robot.
            let alone: [(&str, &[u8]); 1] = [("keys.xml", keys.as_bytes())];
            assert!(Model::from_assets("keys.xml", &alone).is_err(), "{id}");
        }
    }
}
