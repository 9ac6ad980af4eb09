//! The selection and its gizmo.

use std::collections::BTreeSet;

use super::space::{self, Place};
use super::stage::Stage;
use crate::protocol::{Event, Pin, Selection};
use robert_base::units::Unit;
use robert_take::viser::{Message, TransformControlsProps};

/// The node of the gizmo.
pub(super) const GIZMO: &str = "/gizmo";

impl Stage {
    pub(super) fn select(&mut self, mut selection: Selection) {
        let Some(facts) = self.robot.clone() else {
            self.hand.selection = Selection::default();
            return;
        };
        if selection.joint.is_none()
            && let Some(body) = &selection.body
        {
            let body = facts.body(body);
            let joint = body.and_then(|b| facts.moving_joint(b, &BTreeSet::new()));
            selection.joint = joint.and_then(|j| facts.table.joints.get(j)).map(|j| j.name.clone());
        }
        let joint = selection.joint.as_ref();
        if joint.is_some_and(|j| facts.table.joint(j).is_none()) {
            selection.joint = None;
        }
        if selection.site.as_ref().is_some_and(|s| !facts.ik_sites.iter().any(|k| &k.name == s)) {
            selection.site = None;
        }
        if selection == self.hand.selection {
            return;
        }
        self.hand.selection = selection;
        self.hand.drag = None;
        self.shared.edit(|scene| scene.remove(GIZMO));
        self.refresh();
        self.hub.send(&Event::Select(self.hand.selection.clone()));
    }

    /// Sets the joints that stay fixed.
    pub(super) fn lock(&mut self, joints: Vec<String>) {
        let known = |j: &String| self.robot.as_ref().is_some_and(|f| f.table.joint(j).is_some());
        let locked: BTreeSet<String> = joints.into_iter().filter(known).collect();
        if locked == self.hand.locked {
            return;
        }
        self.hand.locked = locked;
        self.shared.set_locked(self.hand.locked.iter().cloned().collect());
        self.hub.send(&Event::Locked { joints: self.hand.locked.iter().cloned().collect() });
        self.shared.edit(|scene| scene.remove(GIZMO));
        self.place_gizmo();
    }

    /// Sets the sites that inverse kinematics keeps in place; sites that the robot does not have
    /// are left out.
    pub(super) fn pin(&mut self, pins: Vec<Pin>) {
        let known = |s: &String| {
            self.robot.as_ref().is_some_and(|f| f.ik_sites.iter().any(|k| &k.name == s))
        };
        let sane = |p: &Pin| {
            let numbers = p.pos.iter().flatten().chain(p.quat.iter().flatten());
            known(&p.site)
                && p.to.as_ref().map_or(p.pos.is_some(), |to| known(to) && *to != p.site)
                && numbers.into_iter().all(|v| v.abs() <= robert_base::limits::CLIP_VALUE_MAX)
        };
        let mut pins: Vec<Pin> = pins.into_iter().filter(sane).collect();
        pins.truncate(robert_base::limits::PINS);
        if pins == self.hand.pins {
            return;
        }
        self.hand.pins = pins;
        self.shared.set_pins(self.hand.pins.clone());
        self.hub.send(&Event::Pinned { pins: self.hand.pins.clone() });
    }

    pub(super) fn place_gizmo(&mut self) {
        let (Some(nodes), Some(facts)) = (&self.nodes, &self.robot) else { return };
        let Some(bodies) = self.reference() else { return };
        let scale = nodes.gizmo_scale();
        if let Some(name) = &self.hand.selection.site {
            let Some(pos) = self.site_place(name) else { return };
            let props = TransformControlsProps {
                scale,
                disable_rotations: true,
                depth_test: false,
                ..TransformControlsProps::default()
            };
            self.put_gizmo(props, Place { pos, quat: [1.0, 0.0, 0.0, 0.0] });
            return;
        }
        let Some(joint) = self.selected_joint().filter(|j| !facts.is_locked(*j, &self.hand.locked))
        else {
            return;
        };
        let Some((anchor, axis)) = self.axis(&bodies, joint) else { return };
        let hinge = facts.table.joints.get(joint).is_some_and(|j| j.unit == Unit::Rad);
        // The ring of the x-y plane turns about z, which lies along the joint's axis.
        let props = TransformControlsProps {
            scale,
            active_axes: if hinge { [true, true, false] } else { [false, false, true] },
            disable_axes: hinge,
            disable_sliders: true,
            disable_rotations: !hinge,
            depth_test: false,
            ..TransformControlsProps::default()
        };
        self.put_gizmo(props, Place { pos: anchor, quat: space::from_z(axis) });
    }

    /// Sends the gizmo's place even if it has not changed here, because a client's drag may have
    /// moved it.
    pub(super) fn place_gizmo_anew(&mut self) {
        self.shared.edit(|scene| scene.remove(GIZMO));
        self.place_gizmo();
    }

    pub(super) fn put_gizmo(&self, props: TransformControlsProps, place: Place) {
        self.shared.edit(|scene| {
            scene.put(Message::create(GIZMO, props));
            scene.put(Message::position(GIZMO, place.pos));
            scene.put(Message::orientation(GIZMO, place.quat));
        });
    }
}
