//! Rows with times, resampled at the frames of a clip.

use super::super::document::{Clip, Fill, RobotRef, Row};
use super::super::error::ClipError;
use super::{Track, frame_of};
use robert_base::limits;
use robert_base::units::FPS;

/// A time in seconds and the values at it; `None` where a joint has none.
pub type Sample = (f64, Row);

/// The clip of these samples, whose times must increase.
///
/// # Errors
/// [`ClipError::Syntax`] for no samples, for too many, and for values that are none.
pub fn from_samples(samples: &[Sample], robot: &RobotRef, fill: Fill) -> Result<Clip, ClipError> {
    let values = samples.iter().flat_map(|s| &s.1).flatten();
    if let Some(wrong) = values.into_iter().find(|v| v.is_nan() || v.abs() > limits::CLIP_VALUE_MAX)
    {
        return Err(ClipError::at(format!("{wrong} is no joint value"), 1, 1));
    }
    let mut track = Track::default();
    resample(samples, &mut track)?;
    if track.length == 0 {
        return Err(ClipError::at("no rows", 1, 1));
    }
    track.clip(robot.clone(), fill)
}

/// Rows at the frames of the clip, on straight lines between the samples around them.
pub(super) fn resample(samples: &[Sample], track: &mut Track) -> Result<(), ClipError> {
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Ok(()) };
    // A log rarely ends on a frame: the last sample within half a frame still counts.
    let Some(end) = frame_of(last.0 - first.0) else {
        let message = format!("more than {} frames", limits::CLIP_FRAMES);
        return Err(ClipError::at(message, 1, 1));
    };
    let mut after = 0;
    for frame in 0..=end {
        let secs = first.0 + f64::from(frame) / f64::from(FPS);
        while samples.get(after).is_some_and(|s| s.0 < secs - 1e-9) {
            after += 1;
        }
        let right = samples.get(after).unwrap_or(last);
        let left = after.checked_sub(1).and_then(|i| samples.get(i)).unwrap_or(right);
        // Within 1 ms a sample is the frame's own: times in files are rounded.
        let near = [right, left].into_iter().find(|s| (s.0 - secs).abs() <= 1e-3);
        let row = match near {
            Some(sample) => sample.1.clone(),
            // Past the last sample: stay there.
            None if after >= samples.len() => last.1.clone(),
            // A hole of more than a frame is not data: leave the frame open.
            None if right.0 - left.0 > 1.5 / f64::from(FPS) => continue,
            None => {
                let s = (secs - left.0) / (right.0 - left.0);
                let mix = |(a, b): (&Option<f64>, &Option<f64>)| Some((*a)? + s * ((*b)? - (*a)?));
                left.1.iter().zip(&right.1).map(mix).collect()
            }
        };
        track.rows.insert(frame, row);
    }
    track.length = end + 1;
    Ok(())
}
