//! Messages of the viser client. It runs in a browser, so nothing in them is trusted.

use serde::Deserialize;

use super::page_camera::PageCamera;
use super::space::unit;

/// A message of the client; unknown ones are ignored, as upstream adds some every month.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "type")]
#[allow(missing_docs)]
pub(crate) enum Incoming {
    /// A gizmo is taken.
    TransformControlsDragStartMessage { name: String },
    /// It moves; pose in its parent's frame.
    TransformControlsUpdateMessage { name: String, wxyz: [f64; 4], position: [f64; 3] },
    /// It is let go.
    TransformControlsDragEndMessage { name: String },
    /// A node was clicked.
    SceneNodeClickMessage {
        name: String,
        /// The origin of the click's ray, in the world.
        #[serde(default)]
        ray_origin: Option<[f64; 3]>,
        #[serde(default)]
        ray_direction: Option<[f64; 3]>,
    },
    /// A node is dragged.
    SceneNodeDragMessage {
        phase: Phase,
        name: String,
        start_position: [f64; 3],
        end_position: [f64; 3],
        #[serde(default)]
        modifier: Option<String>,
    },
    /// The position of the camera: OpenCV's axes (x right, y down, z ahead), and the picture's
    /// size.
    ViewerCameraMessage {
        wxyz: [f64; 4],
        position: [f64; 3],
        fov: f64,
        image_height: f64,
        image_width: f64,
    },
    /// Anything else.
    #[serde(other)]
    Unknown,
}

/// Part of a drag.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Phase {
    /// It begins.
    Start,
    /// It goes on.
    Update,
    /// It ends.
    End,
}

impl Incoming {
    /// Reads a binary frame; `None` if it is not a message, or contains numbers that are not
    /// finite.
    pub(crate) fn read(bytes: &[u8]) -> Option<Incoming> {
        let message: Incoming = rmp_serde::from_slice(bytes).ok()?;
        let finite = match &message {
            Incoming::TransformControlsUpdateMessage { wxyz, position, .. } => {
                wxyz.iter().chain(position).all(|v| v.is_finite())
            }
            Incoming::SceneNodeDragMessage { start_position, end_position, .. } => {
                start_position.iter().chain(end_position).all(|v| v.is_finite())
            }
            Incoming::SceneNodeClickMessage { ray_origin, ray_direction, .. } => {
                ray_origin.iter().chain(ray_direction).flatten().all(|v| v.is_finite())
            }
            Incoming::ViewerCameraMessage { wxyz, position, fov, image_height, image_width } => {
                let sizes = [fov, image_height, image_width];
                wxyz.iter().chain(position).chain(sizes).all(|v| v.is_finite())
                    && sizes.iter().all(|v| **v > 0.0)
                    && (1e-6..=1e6).contains(&(image_width / image_height))
            }
            _ => true,
        };
        finite.then_some(message)
    }

    /// The camera that it tells of.
    pub(super) fn camera(&self) -> Option<PageCamera> {
        match self {
            Incoming::ViewerCameraMessage { wxyz, position, fov, image_height, image_width } => {
                Some(PageCamera {
                    eye: *position,
                    turn: unit(*wxyz),
                    slope: (fov.clamp(0.01, 3.0) / 2.0).tan(),
                    aspect: image_width / image_height,
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Serialize;

    #[derive(Serialize)]
    struct Update<'a> {
        #[serde(rename = "type")]
        kind: &'a str,
        name: &'a str,
        wxyz: [f64; 4],
        position: (i64, f64, f64),
        owner: &'a str,
    }

    #[test]
    fn numbers_may_be_whole_and_unknown_types_pass() {
        let mut update = Update {
            kind: "TransformControlsUpdateMessage",
            name: "/gizmo",
            wxyz: [1.0, 0.0, 0.0, 0.0],
            position: (0, 0.5, 1.0),
            owner: "",
        };
        let read = |u: &Update<'_>| Incoming::read(&rmp_serde::to_vec_named(u).unwrap());
        assert_eq!(
            read(&update),
            Some(Incoming::TransformControlsUpdateMessage {
                name: "/gizmo".into(),
                wxyz: [1.0, 0.0, 0.0, 0.0],
                position: [0.0, 0.5, 1.0]
            })
        );
        update.wxyz[2] = f64::NAN;
        assert_eq!(read(&update), None);
        update.kind = "ShareUrlRequest";
        assert_eq!(read(&update), Some(Incoming::Unknown));
        assert_eq!(Incoming::read(&[0xc1, 7, 7]), None);
        let camera = |width: f64| {
            let message = serde_json::json!({"type": "ViewerCameraMessage",
                "wxyz": [0.5, 0.5, 0.5, 0.5], "position": [3.0, 3.0, 3.0], "fov": 1.3,
                "image_height": 1e-300, "image_width": width});
            Incoming::read(&rmp_serde::to_vec_named(&message).unwrap())
        };
        assert!(camera(2e-300).is_some());
        assert_eq!(camera(1e300), None, "the rays of such a picture have no direction");
    }

    /// Fifty thousand damaged messages in a normal run, or as many as `ROBERT_FUZZ` says.
    #[test]
    fn any_bytes_are_a_message_or_none() {
        use robert_base::rng::{Rng, Stream};
        let number = |name| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
        let asked = number("ROBERT_FUZZ");
        let (rounds, first) = (asked.unwrap_or(50_000), number("ROBERT_FUZZ_FROM").unwrap_or(0));
        let seeds = [
            serde_json::json!({"type": "TransformControlsUpdateMessage", "name": "/gizmo",
                "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0, 0.5, 1.0]}),
            serde_json::json!({"type": "SceneNodeClickMessage", "name": "/robot/arm",
                "ray_origin": [0.5, 0.25, 1.5], "ray_direction": [0.0, 1.0, 0.0]}),
            serde_json::json!({"type": "SceneNodeDragMessage", "phase": "update", "name": "/hand",
                "start_position": [0.1, 0.2, 0.3], "end_position": [1, 2, 3], "modifier": "shift"}),
            serde_json::json!({"type": "ViewerCameraMessage", "wxyz": [0.5, 0.5, 0.5, 0.5],
                "position": [3.0, 3.0, 3.0], "fov": 1.3, "image_height": 720, "image_width": 1280}),
        ]
        .map(|m| rmp_serde::to_vec_named(&m).unwrap());
        let begin = std::time::Instant::now();
        let mut taken = 0_u64;
        for round in first..first + rounds {
            let rng = &mut Rng::new(41, Stream::Test, round);
            let mut bytes = seeds[rng.below(4) as usize].clone();
            for _ in 0..=rng.below(4) {
                let at = rng.below(bytes.len() as u64) as usize;
                let end = (at + rng.below(12) as usize).min(bytes.len());
                match rng.below(6) {
                    0 => bytes[at] ^= 1 << rng.below(8),
                    1 => bytes[at] = rng.below(256) as u8,
                    // Marks of MessagePack: lengths, nothing, numbers, maps and lists.
                    2 => bytes[at] = 0xc0 + rng.below(64) as u8,
                    3 => bytes[at..end].fill(0xff),
                    4 if bytes.len() > 32 => drop(bytes.drain(at..end)),
                    _ => bytes.insert(at, rng.below(256) as u8),
                }
            }
            if let Some(message) = Incoming::read(&bytes) {
                taken += 1;
                let camera = message.camera();
                assert!(camera.is_none_or(|c| c.slope.is_finite() && c.slope > 0.0), "{round}");
            }
        }
        assert!(taken > rounds / 20 && taken < rounds, "{taken} of {rounds}");
        if asked.is_some() {
            let secs = begin.elapsed().as_secs_f64();
            println!("viser: {rounds} inputs, {taken} taken, {secs:.0} s");
        }
    }
}
