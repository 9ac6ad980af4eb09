//! Hand gestures. Every pose is settled in simulation first, and the reached pose is commanded.
//! Fingers touch the palm before they reach the drawn angle, and the error of a policy should not
//! be the error of the drawing.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use robert::clip::{Clip, Fill, Key};
use robert::robot::{Error, Robot};
use robert::rollout::tasks::author::{Authored, blank, dense, middles, sequence};

/// Spread, knuckle, middle and outer joint of a finger. One tendon bends the last two, so
/// they are drawn equal.
type Finger = [f64; 4];

/// J5..J1 of the thumb.
type Thumb = [f64; 5];

const STRAIGHT: Finger = [0.0; 4];
const CURLED: Finger = [0.0, 1.4, 1.5, 1.5];
/// Ring and little finger touch the palm a little earlier.
const RING_CURLED: Finger = [0.0, 1.38, 1.5, 1.5];
const LITTLE_CURLED: Finger = [0.0, 1.34, 1.5, 1.5];
const HALF: Finger = [0.0, 0.7, 0.8, 0.8];

const THUMB_OUT: Thumb = [-0.6, 0.0, 0.0, -0.5, -0.2];
/// Across the palm, under curled fingers.
const THUMB_OVER: Thumb = [0.6, 1.1, 0.0, 0.5, 0.9];
/// Beside the curled index finger.
const THUMB_BESIDE: Thumb = [0.2, 0.3, 0.0, 0.5, 0.8];

fn pose(ff: Finger, mf: Finger, rf: Finger, lf: Finger, thumb: Thumb) -> Vec<f64> {
    // The little finger has one more joint, J5, in the palm.
    [&ff[..], &mf, &rf, &[0.0], &lf, &thumb].concat()
}

fn spread(finger: Finger, angle: f64) -> Finger {
    [angle, finger[1], finger[2], finger[3]]
}

/// Poses beyond those of the robot's profile, as drawn.
fn drawn(name: &str) -> Option<Vec<f64>> {
    let s = STRAIGHT;
    Some(match name {
        "fist" => pose(CURLED, CURLED, RING_CURLED, LITTLE_CURLED, THUMB_BESIDE),
        "ok" => pose(
            [0.0, 0.9, 0.65, 0.65],
            spread(s, 0.05),
            spread(s, -0.1),
            spread(s, -0.25),
            [0.55, 1.0, 0.0, 0.35, 0.35],
        ),
        "point_left" => pose(spread(s, -0.3), CURLED, RING_CURLED, LITTLE_CURLED, THUMB_BESIDE),
        "point" => pose(s, CURLED, RING_CURLED, LITTLE_CURLED, THUMB_BESIDE),
        "point_right" => pose(spread(s, 0.3), CURLED, RING_CURLED, LITTLE_CURLED, THUMB_BESIDE),
        "spread" => pose(
            spread(s, -0.32),
            spread(s, -0.1),
            spread(s, -0.15),
            spread(s, -0.32),
            [-0.6, 0.2, 0.0, -0.4, 0.0],
        ),
        "keys_up" => pose(
            [0.0, 0.35, 0.3, 0.3],
            [0.0, 0.35, 0.3, 0.3],
            [0.0, 0.35, 0.3, 0.3],
            [0.0, 0.35, 0.3, 0.3],
            [-0.2, 0.4, 0.0, 0.0, 0.1],
        ),
        "call_me" => pose(CURLED, CURLED, RING_CURLED, spread(s, -0.25), THUMB_OUT),
        "rock_on" => pose(spread(s, -0.1), CURLED, RING_CURLED, spread(s, -0.2), THUMB_BESIDE),
        "pinch_middle" => pose(
            spread(s, -0.1),
            [0.0, 0.95, 0.7, 0.7],
            spread(s, -0.1),
            spread(s, -0.25),
            [0.7, 1.1, 0.0, 0.35, 0.35],
        ),
        "vulcan" => pose(
            spread(s, 0.0),
            spread(s, -0.2),
            spread(s, -0.25),
            spread(s, -0.02),
            [-0.6, 0.2, 0.0, -0.4, 0.0],
        ),
        "half_fist" => pose(HALF, HALF, HALF, HALF, [0.0, 0.6, 0.0, 0.2, 0.4]),
        "claw" => pose(
            [-0.2, 0.1, 0.9, 0.9],
            [0.0, 0.1, 0.9, 0.9],
            [-0.1, 0.1, 0.9, 0.9],
            [-0.2, 0.1, 0.9, 0.9],
            [0.0, 0.7, 0.0, -0.1, 0.6],
        ),
        "snip_open" => {
            pose(spread(s, -0.3), spread(s, 0.25), RING_CURLED, LITTLE_CURLED, THUMB_OVER)
        }
        "snip_shut" => {
            pose(spread(s, -0.02), spread(s, -0.02), RING_CURLED, LITTLE_CURLED, THUMB_OVER)
        }
        _ => return None,
    })
}

/// Poses by name, as settled.
struct Poses<'a> {
    robot: &'a Robot,
    settled: BTreeMap<String, Vec<f64>>,
}

impl Poses<'_> {
    /// A pose of this file or of the robot's profile, settled from the open hand.
    fn get(&mut self, name: &str) -> Result<Vec<f64>, Error> {
        if let Some(q) = self.settled.get(name) {
            return Ok(q.clone());
        }
        let target = match drawn(name) {
            Some(q) => q,
            None => self.robot.pose(name)?,
        };
        let q = self.settle(&target)?;
        self.settled.insert(name.to_owned(), q.clone());
        Ok(q)
    }

    /// The pose in which the hand comes to rest, rounded to a tenth of a milliradian and clamped to
    /// the limits (the simulator's stops are soft).
    fn settle(&self, target: &[f64]) -> Result<Vec<f64>, Error> {
        let settled = self.robot.settle(target)?;
        Ok(self
            .robot
            .joints()
            .iter()
            .zip(settled.reached)
            .map(|(j, v)| ((v * 1e4).round() / 1e4).clamp(j.range[0], j.range[1]))
            .collect())
    }

    /// Poses held one after another with open frames between: (pose, open, held).
    fn keyed(
        &mut self,
        title: &str,
        notes: &str,
        start: &str,
        steps: &[(&str, u32, u32)],
    ) -> Result<Clip, Error> {
        let mut clip = blank(self.robot, title, notes, 1);
        for name in std::iter::once(start).chain(steps.iter().map(|s| s.0)) {
            let q = self.get(name)?.into_iter().map(Some).collect();
            clip.poses.insert(name.to_owned(), q);
        }
        sequence(&mut clip, start, steps);
        Ok(clip)
    }

    /// A pose and another in turn for 10 s, 20 open and 30 held frames each.
    fn turns(&mut self, title: &str, notes: &str, a: &str, b: &str) -> Result<Clip, Error> {
        self.keyed(title, notes, b, &[(a, 20, 30), (b, 20, 30)].repeat(2))
    }

    /// A smooth curve through poses, `step` frames apart, everything visible.
    fn smooth(
        &mut self,
        title: &str,
        notes: &str,
        step: u32,
        poses: &[&str],
    ) -> Result<Clip, Error> {
        let frames = step * (poses.len() as u32 - 1);
        let mut clip = blank(self.robot, title, notes, frames);
        clip.fill = Fill::Cubic;
        for (i, name) in (0..).zip(poses) {
            let q = self.get(name)?.into_iter().map(Some).collect();
            clip.poses.insert((*name).to_owned(), q);
            clip.keys.push(Key::posed(i * step, name));
        }
        Ok(clip)
    }

    /// A pose derived from `base` by replacing one finger.
    fn variant(&mut self, name: &str, base: &str, at: usize, finger: Finger) -> Result<(), Error> {
        let mut target = self.get(base)?;
        target[at..at + 4].copy_from_slice(&finger);
        let q = self.settle(&target)?;
        self.settled.insert(name.to_owned(), q);
        Ok(())
    }
}

/// Index of each finger's J4 in the state; the little finger's J5 is skipped.
const FINGERS: [(&str, usize); 4] = [("index", 0), ("middle", 4), ("ring", 8), ("little", 13)];

pub(super) fn tasks(robot: &Robot) -> Result<Vec<Authored>, Error> {
    let mut poses = Poses { robot, settled: BTreeMap::new() };
    let mut tasks: Vec<Authored> = Vec::new();
    let mut add = |suite, name, clip| tasks.push(Authored { name, suite, clip });
    let p = &mut poses;

    let six =
        p.turns("six", "Thumb and little finger out, in turn with the open hand.", "six", "open")?;
    let thumb = p.turns("thumb", "Thumb up, in turn with the open hand.", "thumb", "open")?;
    let mut shots = vec![("gun", 10, 12)];
    shots.extend([("gun_fire", 10, 12), ("gun", 10, 12)].repeat(4));
    if let Some(last) = shots.last_mut() {
        last.2 = 14;
    }
    let fire = p.keyed("fire a handgun", "Aims, then fires four times.", "open", &shots)?;
    let rounds = [("rock", 15, 20), ("scissor", 15, 20), ("paper", 15, 20)].repeat(2);
    let rsp = p.keyed("rock, scissor, paper", "Two rounds.", "open", &rounds)?;
    add("manual", "six", six.clone());
    add("manual", "thumb", thumb.clone());
    add("manual", "fire", fire.clone());
    add("manual", "rsp", rsp.clone());

    let mut rest = p.keyed("open hand", "The open hand holds still.", "open", &[])?;
    rest.length = 201;
    rest.keys = vec![Key::posed(0, "open").held(201)];
    add("manual", "open_hold", rest);
    add("manual", "fist", p.turns("fist", "A fist, in turn with the open hand.", "fist", "open")?);
    add("manual", "one", p.turns("one", "Index finger up.", "one", "open")?);
    add("manual", "two", p.turns("two", "Index and middle finger up.", "two", "open")?);
    add("manual", "three", p.turns("three", "Three fingers up.", "three", "open")?);
    add("manual", "four", p.turns("four", "Four fingers up, thumb across.", "four", "open")?);
    add(
        "manual",
        "five",
        p.turns("five", "The spread hand, in turn with a fist.", "five", "fist")?,
    );
    add(
        "manual",
        "ok",
        p.turns("ok", "Thumb and index finger make a ring (nearly).", "ok", "open")?,
    );
    let left = [("point_left", 12, 22), ("point", 12, 22)].repeat(3);
    add(
        "manual",
        "point_left",
        p.keyed("point left", "Index finger to the thumb's side.", "point", &left)?,
    );
    let right = [("point_right", 12, 22), ("point", 12, 22)].repeat(3);
    add(
        "manual",
        "point_right",
        p.keyed("point right", "Index finger to the little finger's side.", "point", &right)?,
    );

    for (name, at) in FINGERS {
        p.variant(&format!("{name}_curled"), "open", at, [0.0, 1.1, 1.0, 1.0])?;
        p.variant(&format!("{name}_down"), "keys_up", at, [0.0, 0.85, 0.4, 0.4])?;
    }
    let order = [
        "open",
        "index_curled",
        "middle_curled",
        "ring_curled",
        "little_curled",
        "ring_curled",
        "middle_curled",
        "index_curled",
        "open",
        "index_curled",
        "middle_curled",
        "ring_curled",
        "little_curled",
    ];
    add(
        "manual",
        "wave",
        p.smooth("wave", "The fingers bend one after another, smoothly.", 17, &order)?,
    );
    let breath = ["open", "spread", "open", "spread", "open", "spread", "open", "spread", "open"];
    add(
        "manual",
        "spread_close",
        p.smooth("spread and close", "The fingers spread and close, smoothly.", 25, &breath)?,
    );
    add(
        "manual",
        "thumb_circle",
        dense(
            robot,
            "thumb circle",
            "The thumb goes round, 4 s a turn; the fingers stay straight.",
            200,
            |t| {
                let (sin, cos) = (TAU * t / 4.0).sin_cos();
                let thumb =
                    [-0.2 + 0.35 * sin, 0.4 - 0.3 * cos, 0.0, -0.1 + 0.2 * cos, 0.1 + 0.15 * sin];
                pose(STRAIGHT, STRAIGHT, STRAIGHT, STRAIGHT, thumb)
            },
        ),
    );
    let tune: Vec<(&str, u32, u32)> = [
        "index_down",
        "keys_up",
        "middle_down",
        "keys_up",
        "ring_down",
        "keys_up",
        "little_down",
        "keys_up",
        "ring_down",
        "keys_up",
        "index_down",
        "keys_up",
        "middle_down",
        "keys_up",
        "index_down",
        "keys_up",
        "little_down",
        "keys_up",
        "middle_down",
        "keys_up",
    ]
    .iter()
    .map(|n| (*n, 5, 5))
    .collect();
    add(
        "manual",
        "piano",
        p.keyed("piano", "The fingers strike keys in turn, twice a second.", "keys_up", &tune)?,
    );

    let only = "with only the middle frame of each hold visible.";
    add("extra", "six_high_mask", middles(&six, "six, high mask", &format!("As six, {only}")));
    add(
        "extra",
        "thumb_high_mask",
        middles(&thumb, "thumb, high mask", &format!("As thumb, {only}")),
    );
    add("extra", "fire_high_mask", middles(&fire, "fire, high mask", &format!("As fire, {only}")));
    add("extra", "rsp_high_mask", middles(&rsp, "rsp, high mask", &format!("As rsp, {only}")));
    let count = ["one", "two", "three", "four", "five", "fist"].map(|n| (n, 15, 20));
    add("extra", "count_up", p.keyed("count up", "One to five and a fist.", "fist", &count)?);

    validation(p, &mut add)?;
    Ok(tasks)
}

/// Other motions: the suite that compares models.
fn validation(
    p: &mut Poses<'_>,
    add: &mut impl FnMut(&'static str, &'static str, Clip),
) -> Result<(), Error> {
    let steps = [("call_me", 14, 26), ("fist", 14, 26)].repeat(2);
    add(
        "validation",
        "call_me",
        p.keyed("call me", "Thumb and little finger out, in turn with a fist.", "fist", &steps)?,
    );
    let steps = [("rock_on", 18, 22), ("open", 18, 22)].repeat(2);
    add(
        "validation",
        "rock_on",
        p.keyed("rock on", "Index and little finger up.", "open", &steps)?,
    );
    let steps = [("pinch_middle", 16, 18), ("open", 16, 18)].repeat(2);
    add(
        "validation",
        "pinch_middle",
        p.keyed(
            "pinch, middle finger",
            "Thumb toward the middle finger (nearly touching).",
            "open",
            &steps,
        )?,
    );
    let steps = [("vulcan", 10, 20), ("open", 10, 20)].repeat(3);
    add(
        "validation",
        "vulcan",
        p.keyed("two and two", "The fingers part in the middle.", "open", &steps)?,
    );
    let steps = [("half_fist", 12, 16), ("claw", 12, 16), ("open", 12, 16)].repeat(2);
    add(
        "validation",
        "half_fist",
        p.keyed("half fist and claw", "Two half-closed hands.", "open", &steps)?,
    );
    let steps = [("snip_open", 6, 6), ("snip_shut", 6, 6)].repeat(7);
    add(
        "validation",
        "snip",
        p.keyed("snip", "Index and middle finger cut, fast.", "snip_shut", &steps)?,
    );
    for (name, at) in FINGERS {
        p.variant(&format!("{name}_half"), "open", at, HALF)?;
    }
    let order = [
        "open",
        "little_half",
        "ring_half",
        "middle_half",
        "index_half",
        "open",
        "index_half",
        "middle_half",
        "ring_half",
        "little_half",
        "open",
    ];
    add(
        "validation",
        "ripple",
        p.smooth("ripple", "A bend runs through the fingers and back.", 14, &order)?,
    );
    let steps = [
        ("three", 13, 11),
        ("call_me", 17, 9),
        ("ok", 15, 13),
        ("fist", 19, 8),
        ("spread", 12, 15),
        ("gun", 16, 10),
    ];
    add(
        "validation",
        "medley",
        p.keyed("medley", "Six gestures at uneven times.", "open", &steps)?,
    );
    Ok(())
}
