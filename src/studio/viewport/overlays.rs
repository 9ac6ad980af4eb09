//! The figures and poses that are shown beside the robot.

use super::motion_path::MotionPath;

/// The visible figures, and the poses that were requested for them.
#[derive(Debug)]
pub(super) struct Overlays {
    /// The parts that the page wants to see.
    pub(super) show: Show,
    /// The commanded pose at a frame that is not simulated, and the frame.
    pub(super) ghost: Option<(usize, Vec<f32>)>,
    /// A question for it is under way.
    pub(super) ghost_asked: bool,
    /// The keys around the playhead whose poses are shown.
    pub(super) onion: [Option<u32>; 2],
    /// Those poses: body transforms; (2, nbody * 7), empty before they are known.
    pub(super) onion_bodies: Vec<Vec<f32>>,
    /// A question for them is under way.
    pub(super) onion_asked: bool,
    /// A take stands beside.
    pub(super) beside: bool,
    /// The pose that can be reached at the playhead.
    pub(super) reachable: Reachable,
    /// The way of what is selected.
    pub(super) path: MotionPath,
    /// Ground and light.
    pub(super) look: Look,
}

/// What is known of the reachable pose at the playhead.
#[derive(Debug)]
pub(super) struct Reachable {
    /// The page wants to see it.
    pub(super) wanted: bool,
    /// Its figure is in the scene.
    pub(super) in_scene: bool,
    /// The pose whose transforms were asked for last, in state order.
    pub(super) asked: Option<Vec<f64>>,
    /// The pose whose transforms are known.
    pub(super) pose: Option<Vec<f64>>,
    /// Its body transforms; (nbody, 7).
    pub(super) bodies: Vec<f32>,
}

impl Default for Reachable {
    fn default() -> Self {
        Reachable { wanted: true, in_scene: false, asked: None, pose: None, bodies: Vec::new() }
    }
}

impl Reachable {
    /// Another robot, or the same one built anew.
    pub(super) fn forget(&mut self) {
        *self = Reachable { wanted: self.wanted, ..Reachable::default() };
    }
}

/// What pages choose about ground and light.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Look {
    /// For a dark page.
    pub(super) dark: bool,
    /// The robot casts a shadow. A browser that draws in software is several times slower with it.
    pub(super) shadows: bool,
}

/// Figures that a page can hide.
#[derive(Clone, Copy, Debug)]
pub(super) struct Show {
    /// The achieved motion.
    pub(super) achieved: bool,
    /// The command.
    pub(super) command: bool,
    /// The neighbouring keys.
    pub(super) ghosts: bool,
}

impl Default for Overlays {
    fn default() -> Self {
        Overlays {
            show: Show { achieved: true, command: true, ghosts: false },
            ghost: None,
            ghost_asked: false,
            onion: [None; 2],
            onion_bodies: Vec::new(),
            onion_asked: false,
            beside: false,
            reachable: Reachable::default(),
            path: MotionPath::default(),
            look: Look::default(),
        }
    }
}
