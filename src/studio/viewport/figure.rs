//! The figures in the viewport: the reached motion, the command, the ghosts.

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
    /// The pose in which the robot rests where it cannot hold the commanded one.
    Reachable,
}

impl Figure {
    /// Everyone.
    pub(super) const ALL: [Figure; 6] = [
        Figure::Robot,
        Figure::Command,
        Figure::Past,
        Figure::Future,
        Figure::Beside,
        Figure::Reachable,
    ];
    /// The figures that are in the scene from the start; the others are added when they are needed.
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
            Figure::Reachable => "/reachable",
        }
    }

    /// sRGB and opacity that replace the robot's own colours: blue for the command, green for past
    /// keys, amber for future keys, magenta for the compared take, teal for the reachable pose.
    pub(super) fn tint(self) -> Option<([u8; 3], f64)> {
        match self {
            Figure::Robot => None,
            Figure::Command => Some((render::error_color(0.0), 0.3)),
            Figure::Past => Some(([41, 166, 112], 0.18)),
            Figure::Future => Some(([237, 148, 36], 0.18)),
            Figure::Beside => Some(([201, 79, 168], 0.45)),
            Figure::Reachable => Some(([0, 150, 158], 0.6)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The middle of the background, dark and light (`ui/src/viewport.tsx`).
    const BACKGROUNDS: [[u8; 3]; 2] = [[52, 59, 70], [255, 255, 255]];

    fn linear(color: [u8; 3]) -> [f64; 3] {
        color.map(|c| {
            let v = f64::from(c) / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        })
    }

    fn luminance(color: [u8; 3]) -> f64 {
        linear(color).iter().zip([0.2126, 0.7152, 0.0722]).map(|(v, w)| v * w).sum()
    }

    /// CIE 1976 L*a*b*, white point D65.
    fn lab(color: [u8; 3]) -> [f64; 3] {
        const TO_XYZ: [[f64; 3]; 3] = [
            [0.4124 / 0.9505, 0.3576 / 0.9505, 0.1805 / 0.9505],
            [0.2126, 0.7152, 0.0722],
            [0.0193 / 1.089, 0.1192 / 1.089, 0.9505 / 1.089],
        ];
        let rgb = linear(color);
        let [x, y, z] = TO_XYZ.map(|row| {
            let t: f64 = row.iter().zip(rgb).map(|(a, b)| a * b).sum();
            if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 }
        });
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    #[test]
    fn the_reachable_pose_is_told_from_every_other_figure_in_both_themes() {
        let tint = |f: Figure| f.tint().map(|(color, _)| color);
        let own = tint(Figure::Reachable).unwrap();
        for ground in BACKGROUNDS {
            let (a, b) = (luminance(own), luminance(ground));
            let contrast = (a.max(b) + 0.05) / (a.min(b) + 0.05);
            assert!(contrast >= 3.0, "{contrast:.2} on {ground:?}");
        }
        for other in Figure::ALL.into_iter().filter(|f| *f != Figure::Reachable) {
            let Some(color) = tint(other) else { continue };
            let apart = lab(own).iter().zip(lab(color)).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            assert!(apart.sqrt() >= 30.0, "{other:?}: {:.0}", apart.sqrt());
        }
    }
}
