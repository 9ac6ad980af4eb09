//! The smooth curve between two goals of a joint: a cubic that arrives with the speed of the motion
//! that follows.
//!
//! The speed is zero before a hold, and not zero if the goals continue in the same direction
//! (weights of Fritsch and Butland 1984, so that no goal is overshot).

/// A cubic overshoots if its speed at an end exceeds the mean speed of the piece by this factor.
const STEEPEST: f64 = 3.0;

/// One goal of a joint: frame, value.
pub(super) type Knot = (usize, f64);

/// The motion through the gaps between the goals of one joint, on the same curves, planned from goal
/// to goal without looking at the robot: (frame, value) of every frame between two goals.
pub(super) fn between(knots: &[Knot]) -> Vec<Knot> {
    let speed = |k: usize| match (k.checked_sub(1), knots.get(k + 1)) {
        (Some(before), Some(&after)) => passing_speed(knots[before], knots[k], after),
        // The joint rests at the start and after its last goal.
        _ => 0.0,
    };
    let mut filled = Vec::new();
    for k in 1..knots.len() {
        let (from, to) = (knots[k - 1], knots[k]);
        let mean = mean_speed(from, to);
        // A plan has no motion to turn around: it leaves in the direction of its goal.
        let along = |v: f64| if v * mean > 0.0 { v } else { 0.0 };
        let piece = Piece::new(from, to, along(speed(k - 1)), speed(k), f64::INFINITY);
        filled.extend((from.0 + 1..to.0).map(|f| (f, piece.at(f))));
    }
    filled
}

pub(super) fn mean_speed(from: Knot, to: Knot) -> f64 {
    (to.1 - from.1) / (to.0 - from.0) as f64
}

/// Speed at the middle one of three goals.
pub(super) fn passing_speed(before: Knot, at: Knot, after: Knot) -> f64 {
    let (a, b) = (mean_speed(before, at), mean_speed(at, after));
    let (wide_a, wide_b) = ((at.0 - before.0) as f64, (after.0 - at.0) as f64);
    if after.0 - at.0 == 1 {
        return b;
    }
    if at.0 - before.0 == 1 {
        return a;
    }
    if a * b <= 0.0 {
        return 0.0;
    }
    let (w1, w2) = (2.0 * wide_b + wide_a, wide_b + 2.0 * wide_a);
    (w1 + w2) / (w1 / a + w2 / b)
}

/// A cubic between two goals.
pub(super) struct Piece {
    from: Knot,
    to: Knot,
    departure: f64,
    arrival: f64,
}

impl Piece {
    /// `limit` is the speed that the curve should stay below, if the distance allows it.
    pub(super) fn new(from: Knot, to: Knot, departure: f64, arrival: f64, limit: f64) -> Piece {
        let mean = mean_speed(from, to);
        // A cubic between two speeds v is at 1.5 mean - .5 v in its middle.
        let least = (3.0 * mean.abs() - 2.0 * limit).clamp(0.0, mean.abs());
        let keep = |v: f64| v.signum() * v.abs().clamp(0.0, STEEPEST * mean.abs());
        let faster = |v: f64| if v * mean.signum() < least { least * mean.signum() } else { v };
        // A joint that moves in the opposite direction needs time to turn, and ending against the
        // direction of motion would overshoot.
        let departure = if departure * mean > 0.0 { keep(departure) } else { departure };
        let arrival = if arrival * mean > 0.0 { keep(arrival) } else { 0.0 };
        Piece { from, to, departure: faster(departure), arrival: faster(arrival) }
    }

    pub(super) fn at(&self, frame: usize) -> f64 {
        let h = (self.to.0 - self.from.0) as f64;
        let u = (frame - self.from.0) as f64 / h;
        let (u2, u3) = (u * u, u * u * u);
        (2.0 * u3 - 3.0 * u2 + 1.0) * self.from.1
            + (u3 - 2.0 * u2 + u) * h * self.departure
            + (3.0 * u2 - 2.0 * u3) * self.to.1
            + (u3 - u2) * h * self.arrival
    }
}
