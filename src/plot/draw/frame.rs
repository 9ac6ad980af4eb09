//! Maps data to points on the paper: scales, and curves clipped to the frame.

use super::canvas::Rect;

/// Maps data to points on the paper.
pub(super) struct Frame {
    pub(super) rect: Rect,
    pub(super) x: (f64, f64),
    pub(super) y: (f64, f64),
    pub(super) log: (bool, bool),
}

/// Whether a value can be on an axis; differences of larger values are not finite.
pub(super) fn drawable(v: f64) -> bool {
    v.abs() <= 1e300
}

/// Both ends of a clipped segment, and whether the second was inside.
type Cut = ((f64, f64), (f64, f64), bool);

impl Frame {
    fn share(v: f64, ends: (f64, f64), log: bool) -> f64 {
        if !drawable(v) {
            f64::NAN
        } else if log {
            (v.max(1e-300).ln() - ends.0.ln()) / (ends.1.ln() - ends.0.ln())
        } else {
            (v - ends.0) / (ends.1 - ends.0)
        }
    }

    pub(super) fn x(&self, v: f64) -> f64 {
        self.rect.x + self.rect.w * Self::share(v, self.x, self.log.0)
    }

    pub(super) fn y(&self, v: f64) -> f64 {
        self.rect.y + self.rect.h * (1.0 - Self::share(v, self.y, self.log.1))
    }

    pub(super) fn clamp_y(&self, y: f64) -> f64 {
        y.clamp(self.rect.y, self.rect.y + self.rect.h)
    }

    pub(super) fn inside(&self, p: (f64, f64)) -> bool {
        let r = self.rect;
        let e = 0.5;
        p.0 >= r.x - e && p.0 <= r.x + r.w + e && p.1 >= r.y - e && p.1 <= r.y + r.h + e
    }

    /// Unbroken, clipped pieces of a curve.
    pub(super) fn pieces(&self, points: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
        let mut out: Vec<Vec<(f64, f64)>> = Vec::new();
        let mut joined = false;
        for w in points.windows(2) {
            let &[a, b] = w else { continue };
            let finite = [a.0, a.1, b.0, b.1].into_iter().all(drawable);
            let cut = finite
                .then(|| self.cut((self.x(a.0), self.y(a.1)), (self.x(b.0), self.y(b.1))))
                .flatten();
            let Some((p, q, whole)) = cut else {
                joined = false;
                continue;
            };
            match out.last_mut() {
                Some(last) if joined => last.push(q),
                _ => out.push(vec![p, q]),
            }
            joined = whole;
        }
        out
    }

    /// The part of a segment inside (Liang and Barsky), and whether its end was inside.
    fn cut(&self, a: (f64, f64), b: (f64, f64)) -> Option<Cut> {
        let r = self.rect;
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let (mut t0, mut t1) = (0.0_f64, 1.0_f64);
        for (p, q) in
            [(-dx, a.0 - r.x), (dx, r.x + r.w - a.0), (-dy, a.1 - r.y), (dy, r.y + r.h - a.1)]
        {
            if p.abs() < 1e-12 {
                if q < 0.0 {
                    return None;
                }
            } else if p < 0.0 {
                t0 = t0.max(q / p);
            } else {
                t1 = t1.min(q / p);
            }
        }
        let on = |t: f64| (a.0 + t * dx, a.1 + t * dy);
        (t0 <= t1).then(|| (on(t0), on(t1), t1 >= 1.0))
    }
}
