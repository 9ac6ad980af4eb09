//! The rules that every clip obeys, whether it was read, edited or built in code.

use std::collections::BTreeSet;

use super::document::{Clip, Goal, Row, Start};
use super::flaw::{Flaw, Invalid, hint, some};
use super::json::escape_step;
use super::path::frames_ahead;
use super::reach::Reach;
use robert_base::limits;
use robert_kinematics::Point;

type Checked = Result<(), Invalid>;

fn fail(pointer: impl Into<String>, flaw: Flaw) -> Checked {
    Err(Invalid { pointer: pointer.into(), flaw })
}

#[cfg(test)]
thread_local! {
    /// The number of times that a whole clip was checked in this thread. The cost of a check grows
    /// with the size of the clip.
    pub(crate) static CHECKS: std::cell::Cell<usize> = const { std::cell::Cell::new(0) };
}

impl Clip {
    /// Checks every rule; order of lists does not matter here.
    ///
    /// # Errors
    /// The first broken rule with its JSON pointer.
    pub fn validate(&self) -> Checked {
        #[cfg(test)]
        CHECKS.set(CHECKS.get() + 1);
        self.validate_head()?;
        self.validate_poses()?;
        self.validate_keys()?;
        self.validate_offsets()?;
        self.validate_masks()?;
        self.validate_markers()
    }

    fn validate_head(&self) -> Checked {
        name("/name", "the name", &self.name, true)?;
        if self.notes.len() > limits::NOTES_BYTES {
            return fail("/notes", Flaw::Notes { bytes: self.notes.len() });
        }
        let robot = &self.robot;
        name("/robot/id", "the robot id", &robot.id, false)?;
        if let Some(model) = &robot.model {
            name("/robot/model", "the model", model, false)?;
        }
        if let Some(sha) = &robot.model_sha256
            && !(sha.len() == 64 && sha.bytes().all(|b| b.is_ascii_hexdigit()))
        {
            return fail("/robot/model_sha256", Flaw::Sha);
        }
        let joints = robot.joints.len();
        if joints == 0 || joints > limits::JOINTS {
            return fail("/robot/joints", Flaw::Joints { count: joints });
        }
        let mut seen = BTreeSet::new();
        for (i, joint) in robot.joints.iter().enumerate() {
            let pointer = format!("/robot/joints/{i}");
            name(&pointer, "a joint name", joint, false)?;
            if !seen.insert(joint.as_str()) {
                return fail(pointer, Flaw::Twice { what: "joint", name: joint.clone() });
            }
        }
        if !robot.units.is_empty() && robot.units.len() != joints {
            return fail("/robot/units", Flaw::Units { found: robot.units.len(), joints });
        }
        if self.length == 0 || self.length > limits::CLIP_FRAMES {
            return fail("/length", Flaw::Length { frames: self.length });
        }
        let count = self.length as usize * joints;
        at_most("/length", "frames times joints", count, limits::CLIP_VALUES)
    }

    fn validate_poses(&self) -> Checked {
        at_most("/poses", "poses", self.poses.len(), limits::CLIP_POSES)?;
        for (pose, row) in &self.poses {
            let pointer = format!("/poses/{}", escape_step(pose));
            name(&pointer, "a pose name", pose, false)?;
            self.validate_row(&pointer, row)?;
        }
        match &self.start {
            None => Ok(()),
            Some(Start::Pose(name)) => {
                self.validate_pose_name("/start/pose", name)?;
                if self.poses.get(name).is_some_and(|row| row.contains(&None)) {
                    return fail("/start/pose", Flaw::StartOpen { name: name.clone() });
                }
                Ok(())
            }
            Some(Start::Q(q)) => {
                let row: Row = q.iter().copied().map(Some).collect();
                self.validate_row("/start/q", &row)
            }
        }
    }

    fn validate_pose_name(&self, pointer: &str, name: &str) -> Checked {
        if self.poses.contains_key(name) {
            return Ok(());
        }
        let mut hint = hint(name, self.poses.keys().map(String::as_str));
        if hint.is_empty() {
            hint = match some(self.poses.keys().map(String::as_str)) {
                none if none.is_empty() => {
                    "; the clip has none: a pose of the robot must be copied into its poses".into()
                }
                own => format!("; the clip has {own}"),
            };
        }
        fail(pointer, Flaw::UnknownPose { name: name.to_owned(), hint })
    }

    fn validate_row(&self, pointer: &str, row: &Row) -> Checked {
        let joints = self.dim();
        if row.len() != joints {
            return fail(pointer, Flaw::RowLength { found: row.len(), joints });
        }
        if row.iter().all(Option::is_none) {
            return fail(pointer, Flaw::RowEmpty);
        }
        for (j, value) in row.iter().enumerate() {
            if let Some(value) = *value
                && !is_value(value)
            {
                return fail(format!("{pointer}/{j}"), Flaw::Value { value });
            }
        }
        Ok(())
    }

    fn joint_names(&self) -> BTreeSet<&str> {
        self.robot.joints.iter().map(String::as_str).collect()
    }

    fn validate_joint(
        &self,
        pointer: impl Fn() -> String,
        joint: &str,
        known: &BTreeSet<&str>,
    ) -> Checked {
        if known.contains(joint) {
            return Ok(());
        }
        let hint = hint(joint, self.robot.joints.iter().map(String::as_str));
        fail(pointer(), Flaw::UnknownJoint { name: joint.to_owned(), hint })
    }

    fn validate_keys(&self) -> Checked {
        at_most("/keys", "keys", self.keys.len(), limits::CLIP_KEYS)?;
        let mut seen = BTreeSet::new();
        let index = self.joint_names();
        let (mut tangents, mut reaches, mut solved) = (0, 0, 0);
        for (i, key) in self.keys.iter().enumerate() {
            let at = |field: &str| format!("/keys/{i}/{field}");
            let frame = key.frame;
            if frame >= self.length {
                return fail(at("frame"), Flaw::Outside { frame, length: self.length });
            }
            if !seen.insert(frame) {
                return fail(at("frame"), Flaw::Occupied { what: "key", frame });
            }
            match &key.goal {
                Goal::Pose(name) => self.validate_pose_name(&at("pose"), name)?,
                Goal::Q(row) => self.validate_row(&at("q"), row)?,
                Goal::Open if key.reach.is_empty() => {
                    return fail(format!("/keys/{i}"), Flaw::NoGoal);
                }
                Goal::Open => {}
            }
            for (n, reach) in key.reach.iter().enumerate() {
                validate_reach(&format!("/keys/{i}/reach/{n}"), reach)?;
            }
            reaches += key.reach.len();
            solved += usize::from(!key.reach.is_empty());
            if key.hold == 0 || key.hold > limits::CLIP_FRAMES {
                return fail(at("hold"), Flaw::Hold { hold: key.hold });
            }
            for (joint, tangent) in &key.tangents {
                let pointer = || format!("/keys/{i}/tangents/{}", escape_step(joint));
                self.validate_joint(pointer, joint, &index)?;
                let typed = tangent.typed().unwrap_or_default();
                if let Some(slope) = typed.into_iter().find(|s| !is_value(*s)) {
                    return fail(pointer(), Flaw::Slope { slope });
                }
            }
            tangents += key.tangents.len();
            name(&at("note"), "a note", &key.note, true)?;
        }
        at_most("/keys", "tangents", tangents, limits::CLIP_TANGENTS)?;
        at_most("/keys", "end-effector goals", reaches, limits::CLIP_REACHES)?;
        solved += frames_ahead(self);
        let what = "frames with end-effector goals";
        at_most("/keys", what, solved, limits::CLIP_REACH_FRAMES)?;
        let own = |k: &super::Key| if let Goal::Q(q) = &k.goal { q.len() } else { 0 };
        let values = self.keys.iter().map(own).sum::<usize>()
            + self.poses.values().map(Vec::len).sum::<usize>();
        at_most("/keys", "values in keys and poses", values, limits::CLIP_VALUES)
    }

    fn validate_offsets(&self) -> Checked {
        at_most("/offsets", "offsets", self.offsets.len(), limits::CLIP_SPANS)?;
        let mut seen = BTreeSet::new();
        let index = self.joint_names();
        let (mut values, mut work) = (0, 0);
        for (i, offset) in self.offsets.iter().enumerate() {
            let at = |field: &str| format!("/offsets/{i}/{field}");
            let frame = offset.frame;
            if frame >= self.length {
                return fail(at("frame"), Flaw::Outside { frame, length: self.length });
            }
            if !seen.insert(frame) {
                return fail(at("frame"), Flaw::Occupied { what: "offset", frame });
            }
            if offset.add.is_empty() {
                return fail(at("add"), Flaw::AddsNothing);
            }
            for (joint, &value) in &offset.add {
                let pointer = || format!("/offsets/{i}/add/{}", escape_step(joint));
                self.validate_joint(pointer, joint, &index)?;
                if !is_value(value) {
                    return fail(pointer(), Flaw::Value { value });
                }
            }
            if offset.hold == 0 || offset.hold > limits::CLIP_FRAMES {
                return fail(at("hold"), Flaw::Hold { hold: offset.hold });
            }
            for (field, frames) in [("in", offset.fade_in), ("out", offset.fade_out)] {
                if frames > limits::CLIP_FRAMES {
                    return fail(at(field), Flaw::Fade { frames });
                }
            }
            values += offset.add.len();
            work += offset.span(self.length).len() * offset.add.len();
        }
        at_most("/offsets", "values in offsets", values, limits::CLIP_OFFSETS)?;
        let what = "frames times joints of offsets";
        at_most("/offsets", what, work, limits::CLIP_VALUES)
    }

    fn validate_masks(&self) -> Checked {
        at_most("/masks", "mask spans", self.masks.len(), limits::CLIP_SPANS)?;
        let index = self.joint_names();
        let mut names = 0;
        for (i, mask) in self.masks.iter().enumerate() {
            let (from, to, length) = (mask.from, mask.to, self.length);
            if from >= to || to > length {
                return fail(format!("/masks/{i}"), Flaw::Span { from, to, length });
            }
            let Some(joints) = &mask.joints else { continue };
            if joints.is_empty() {
                return fail(format!("/masks/{i}/joints"), Flaw::NoJoints);
            }
            names += joints.len();
            let mut seen = BTreeSet::new();
            for (j, joint) in joints.iter().enumerate() {
                let pointer = || format!("/masks/{i}/joints/{j}");
                self.validate_joint(pointer, joint, &index)?;
                if !seen.insert(joint.as_str()) {
                    return fail(pointer(), Flaw::Twice { what: "joint", name: joint.clone() });
                }
            }
        }
        at_most("/masks", "joint names in mask spans", names, limits::CLIP_MASK_JOINTS)
    }

    fn validate_markers(&self) -> Checked {
        at_most("/markers", "markers", self.markers.len(), limits::CLIP_SPANS)?;
        let mut seen = BTreeSet::new();
        for (i, marker) in self.markers.iter().enumerate() {
            let frame = marker.frame;
            let pointer = || format!("/markers/{i}/frame");
            if frame >= self.length {
                return fail(pointer(), Flaw::Outside { frame, length: self.length });
            }
            if !seen.insert(frame) {
                return fail(pointer(), Flaw::Occupied { what: "marker", frame });
            }
            if let Some(to) = marker.to
                && (to <= frame || to > self.length)
            {
                let (from, length) = (frame, self.length);
                return fail(format!("/markers/{i}/to"), Flaw::Span { from, to, length });
            }
            name(&format!("/markers/{i}/name"), "a marker name", &marker.name, false)?;
        }
        Ok(())
    }
}

/// Checks an end-effector goal, but not whether the robot has the point.
fn validate_reach(pointer: &str, reach: &Reach) -> Checked {
    let at = |field: &str| format!("{pointer}/{field}");
    let kind = match &reach.point {
        Point::Site(_) => "site",
        Point::Body { offset, .. } => {
            if let Some(&value) = offset.iter().find(|v| !is_value(**v)) {
                return fail(at("offset"), Flaw::Place { value });
            }
            "body"
        }
    };
    name(&at(kind), "the name of a point", reach.point.name(), false)?;
    if let Some(&value) = reach.pos.iter().find(|v| !is_value(**v)) {
        return fail(at("pos"), Flaw::Place { value });
    }
    let Some(quat) = reach.quat else { return Ok(()) };
    let length = quat.iter().map(|v| v * v).sum::<f64>().sqrt();
    if quat.iter().all(|v| is_value(*v)) && length > 1e-3 {
        return Ok(());
    }
    fail(at("quat"), Flaw::Quaternion)
}

fn is_value(v: f64) -> bool {
    v.is_finite() && v.abs() <= limits::CLIP_VALUE_MAX
}

fn at_most(pointer: &str, what: &'static str, count: usize, cap: usize) -> Checked {
    if count > cap { fail(pointer, Flaw::TooMany { what, count, cap }) } else { Ok(()) }
}

/// Names are shown in tables, CSV headers and terminals, so they must not contain control
/// characters.
fn name(pointer: &str, what: &'static str, text: &str, may_be_empty: bool) -> Checked {
    let reason = if text.is_empty() && !may_be_empty {
        "is empty"
    } else if text.len() > limits::NAME_BYTES {
        "is too long"
    } else if text.chars().any(char::is_control) {
        "contains a control character"
    } else if !may_be_empty && text.trim() != text {
        // CSV files and people lose such spaces, and two names must not look the same.
        "starts or ends with a space"
    } else {
        return Ok(());
    };
    fail(pointer, Flaw::Name { what, reason, name: text.to_owned() })
}
