//! Rule: points reach their end-effector goals.

use crate::lint::finder::Finder;
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{KeysFrames, KeysSet, Op};
use crate::reach::Reached;

impl Finder<'_> {
    pub(in crate::lint) fn reach(&mut self) {
        let command = self.command;
        for missed in command.reached().iter().filter(|r| !r.reached) {
            if self.full(Rule::Unreachable) {
                continue;
            }
            let Some(key) = self.clip.keys.get(missed.key) else { continue };
            let on_the_way = missed.frame != key.frame;
            let place = if on_the_way {
                format!("on the way from the key at frame {}, at frame {}", key.frame, missed.frame)
            } else {
                format!("key at frame {}", key.frame)
            };
            let goal = key.reach.get(missed.goal).filter(|_| !on_the_way);
            let units = goal.map_or("", |goal| units(goal.pos, missed));
            let point = missed.instead.point.name();
            let message = format!("{place}: {point} {}{units}", how_far(missed));
            let mut fixes = Vec::new();
            if !on_the_way {
                let mut reach = key.reach.clone();
                if let Some(slot) = reach.get_mut(missed.goal) {
                    slot.clone_from(&missed.instead);
                }
                let set = KeysSet { frame: key.frame, reach: Some(reach), ..KeysSet::default() };
                fixes.push(Fix {
                    title: "Store the place that is reached".to_owned(),
                    op: Op::KeysSet(set),
                });
                let frames = vec![key.frame];
                fixes.push(Fix {
                    title: "Turn the goal into joint values".to_owned(),
                    op: Op::KeysBake(KeysFrames { frames }),
                });
            }
            self.push(Lint {
                level: Level::Warning,
                rule: Rule::Unreachable,
                message,
                frames: Some([missed.frame, missed.frame + 1]),
                joints: missed.joints.clone(),
                pointer: format!("/keys/{}/reach/{}", missed.key, missed.goal),
                fixes,
                settled: None,
                unlisted: 0,
            });
        }
    }
}

/// A goal at which nothing but its unit can be wrong: a thousandth of it is where the robot is.
fn units(goal: [f64; 3], missed: &Reached) -> &'static str {
    let away = |scale: f64| {
        let off = goal.iter().zip(missed.instead.pos).map(|(g, at)| (g * scale - at).powi(2));
        off.sum::<f64>().sqrt()
    };
    let in_millimetres = missed.distance_m > 20.0 && away(1e-3) < 0.05 * away(1.0);
    if in_millimetres { "; positions are in m: divide millimetres by 1000" } else { "" }
}

/// "stays 12.3 mm and 4.5 degrees from its goal", with the parts that miss.
fn how_far(missed: &Reached) -> String {
    let distance = format!("{:.1} mm", missed.distance_m * 1e3);
    let angle = format!("{:.3} rad", missed.angle_rad);
    let words = match (missed.distance_m > 5e-5, missed.angle_rad > 5e-4) {
        (true, true) => format!("{distance} and {angle}"),
        (_, false) => distance,
        (false, true) => angle,
    };
    format!("stays {words} from its goal")
}
