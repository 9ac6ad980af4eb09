//! Films of episodes, for datasets with a camera.

use std::ops::Range;

use serde_json::{Value, json};

use super::super::error::Error;
use super::lerobot_layout::LeRobotVersion;
use robert_base::units::FPS;
use robert_render::Picture;
use robert_render::encode::{Film, FilmFormat, FilmStream};

/// The feature's name.
pub(super) const KEY: &str = "observation.images.front";
/// Frames in one file: at two kilobytes per frame far below the 200 MB of the format.
const FILE_FRAMES: usize = 80_000;
/// The distance between two pixels that count in the statistics, along each edge.
const SAMPLE_PX: usize = 16;

/// Films of all episodes.
#[derive(Clone, Debug, Default)]
pub struct Films {
    /// Content and episodes of each file.
    pub(super) files: Vec<(Vec<u8>, Range<usize>)>,
    /// Red, green, blue of some pixels of each episode, 0 to 1; (episodes)(samples, 3).
    pub(super) samples: Vec<Vec<f64>>,
    size: (u32, u32),
}

impl Films {
    /// Draws all episodes: `draw` makes the picture of an episode's frame, `frames` are the lengths
    /// of the episodes. In version 2.1 a file contains one episode, in version 3 as many as fit.
    ///
    /// # Errors
    /// Those of `draw`; [`Error::Render`].
    pub fn draw<E: From<Error>>(
        version: LeRobotVersion,
        frames: &[usize],
        (width, height): (u32, u32),
        mut draw: impl FnMut(usize, usize) -> Result<Picture, E>,
    ) -> Result<Films, E> {
        let encode = |e: robert_render::Error| E::from(Error::Render(e));
        let mut films = Films { size: (width, height), ..Films::default() };
        for group in groups(version, frames) {
            let film = Film {
                format: FilmFormat::Mp4,
                fps: FPS,
                width,
                height,
                frames: frames[group.clone()].iter().sum::<usize>() as u32,
            };
            let mut stream = FilmStream::new(&film).map_err(encode)?;
            for episode in group.clone() {
                let mut samples = Vec::new();
                for frame in 0..frames[episode] {
                    let picture = draw(episode, frame)?;
                    sample(&picture, &mut samples);
                    stream.push(&picture).map_err(encode)?;
                }
                films.samples.push(samples);
            }
            films.files.push((stream.finish().map_err(encode)?, group));
        }
        Ok(films)
    }

    /// Its entry in `info.json`.
    pub(super) fn feature(&self) -> Value {
        let (width, height) = self.size;
        json!({
            "dtype": "video",
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": height,
                "video.width": width,
                "video.codec": "h264",
                "video.pix_fmt": "yuv420p",
                "video.is_depth_map": false,
                "video.fps": FPS,
                "video.channels": 3,
                "has_audio": false,
                "is_depth_map": false,
            }
        })
    }
}

/// Episodes of each file.
fn groups(version: LeRobotVersion, frames: &[usize]) -> Vec<Range<usize>> {
    let mut groups: Vec<Range<usize>> = Vec::new();
    let mut held = 0;
    for (episode, n) in frames.iter().enumerate() {
        match groups.last_mut() {
            Some(group) if version == LeRobotVersion::V3 && held + n <= FILE_FRAMES => {
                group.end = episode + 1;
                held += n;
            }
            _ => {
                groups.push(episode..episode + 1);
                held = *n;
            }
        }
    }
    groups
}

fn sample(picture: &Picture, into: &mut Vec<f64>) {
    let width = picture.width as usize;
    for y in (0..picture.height as usize).step_by(SAMPLE_PX) {
        for x in (0..width).step_by(SAMPLE_PX) {
            let at = 4 * (y * width + x);
            into.extend(picture.rgba[at..at + 3].iter().map(|v| f64::from(*v) / 255.0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_hold_whole_episodes() {
        let v3 = |frames: &[usize]| groups(LeRobotVersion::V3, frames);
        assert_eq!(v3(&[10, 20, 30]).first(), Some(&(0..3)));
        assert_eq!(v3(&[79_990, 10, 1, 80_000]), [0..2, 2..3, 3..4]);
        assert_eq!(groups(LeRobotVersion::V2, &[10, 20]), [0..1, 1..2]);
    }

    #[test]
    fn every_frame_is_drawn_once_in_order() {
        let mut seen = Vec::new();
        let films = Films::draw(LeRobotVersion::V3, &[3, 2], (32, 16), |e, f| {
            seen.push((e, f));
            Ok::<_, Error>(Picture::filled(32, 16, [0, 0, 255]))
        })
        .unwrap();
        assert_eq!(seen, [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]);
        assert_eq!((films.files.len(), films.samples.len()), (1, 2));
        assert_eq!(films.samples[1][..3], [0.0, 0.0, 1.0]);
        assert_eq!(films.feature()["shape"], json!([16, 32, 3]));
    }
}
