//! The figures in the viewport: the reached motion, the command, the ghost.

use robert_render as render;

/// One of the robots that are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Figure {
    /// The reached motion, solid.
    Robot,
    /// The command, translucent.
    Command,
    /// The key before.
    Past,
    /// The key after.
    Future,
    /// A take to compare with.
    Beside,
}

impl Figure {
    /// Everyone.
    pub(super) const ALL: [Figure; 5] =
        [Figure::Robot, Figure::Command, Figure::Past, Figure::Future, Figure::Beside];
    /// The figures that are in the scene from the start; the compared take is added when it is
    /// needed.
    pub(super) const FROM_THE_START: [Figure; 4] =
        [Figure::Robot, Figure::Command, Figure::Past, Figure::Future];

    /// Its node.
    pub(super) fn root(self) -> &'static str {
        match self {
            Figure::Robot => "/robot",
            Figure::Command => "/command",
            Figure::Past => "/past",
            Figure::Future => "/future",
            Figure::Beside => "/beside",
        }
    }

    /// sRGB and opacity that replace the robot's own colours: blue for the command, green for past
    /// keys, amber for future keys, magenta for the compared take.
    pub(super) fn tint(self) -> Option<([u8; 3], f64)> {
        match self {
            Figure::Robot => None,
            Figure::Command => Some((render::error_color(0.0), 0.3)),
            Figure::Past => Some(([41, 166, 112], 0.18)),
            Figure::Future => Some(([237, 148, 36], 0.18)),
            Figure::Beside => Some(([201, 79, 168], 0.45)),
        }
    }
}
