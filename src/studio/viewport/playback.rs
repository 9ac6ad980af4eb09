//! Playing in the viewport: the frame that is shown.

use tokio::time::Instant;

use robert_base::units::FPS;

/// The frame that is shown, and its change over time.
#[derive(Debug, Default)]
pub(super) struct Playback {
    /// The frame; fractions lie between two.
    pub(super) frame: f64,
    /// The motion of the playhead; `None` while it stands.
    pub(super) play: Option<Play>,
}

/// Frames that go by.
#[derive(Debug)]
pub(super) struct Play {
    from: f64,
    since: Instant,
    speed: f64,
    range: Option<[u32; 2]>,
}

impl Playback {
    /// Stands at a frame.
    pub(super) fn stand(&mut self, frame: f64) {
        self.play = None;
        self.frame = if frame.is_finite() { frame.max(0.0) } else { 0.0 };
    }

    /// Plays from a frame on; at speed 0 the playhead stays there.
    pub(super) fn start(&mut self, frame: f64, range: Option<[u32; 2]>, speed: f64) {
        self.stand(frame);
        self.play = (speed > 0.0 && speed.is_finite()).then(|| Play {
            from: self.frame,
            since: Instant::now(),
            speed: speed.min(16.0),
            range: range.filter(|r| r[0] < r[1]),
        });
    }

    /// Moves the playhead to the frame of this moment; without a range it stops at the last frame.
    pub(super) fn advance(&mut self, now: Instant, last: f64) {
        let Some(play) = &self.play else { return };
        let run = now.duration_since(play.since).as_secs_f64() * play.speed * f64::from(FPS);
        let at = play.from + run;
        self.frame = match play.range {
            Some([from, to]) => {
                let (from, span) = (f64::from(from), f64::from(to - from));
                if at < from { at } else { from + (at - from).rem_euclid(span) }
            }
            None if at >= last => {
                self.play = None;
                last
            }
            None => at,
        };
    }
}
