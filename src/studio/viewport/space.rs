//! Geometry for the viewport; quaternions are w x y z.

/// A vector.
pub(super) type V3 = [f64; 3];
/// A unit quaternion.
pub(super) type Q = [f64; 4];

/// A transform in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// Position, m.
    pub(super) pos: V3,
    /// Orientation.
    pub(super) quat: Q,
}

impl Place {
    /// Body `i` of a row of transforms (nbody, 7).
    pub(super) fn of(bodies: &[f32], i: usize) -> Option<Place> {
        let v = bodies.get(7 * i..7 * i + 7)?;
        let at = |k: usize| f64::from(v[k]);
        Some(Place { pos: [at(0), at(1), at(2)], quat: unit([at(3), at(4), at(5), at(6)]) })
    }

    /// Position and orientation in a row.
    pub(super) fn row(&self) -> [f64; 7] {
        let ([x, y, z], [qw, qx, qy, qz]) = (self.pos, self.quat);
        [x, y, z, qw, qx, qy, qz]
    }

    /// A point of this frame in the world.
    pub(super) fn point(&self, p: V3) -> V3 {
        add(self.pos, rotate(self.quat, p))
    }

    /// Between two, at share `s`.
    pub(super) fn between(a: Place, b: Place, s: f64) -> Place {
        // The shorter way round; for frames a twentieth of a second apart the normalised
        // straight line is the arc.
        let sign = if dot4(a.quat, b.quat) < 0.0 { -1.0 } else { 1.0 };
        let quat = [0, 1, 2, 3].map(|k| {
            let (x, y) = (a.quat[k], b.quat[k]);
            x + s * (sign * y - x)
        });
        let pos = [0, 1, 2].map(|k| a.pos[k] + s * (b.pos[k] - a.pos[k]));
        Place { pos, quat: unit(quat) }
    }
}

fn dot4(a: Q, b: Q) -> f64 {
    a.iter().zip(&b).map(|(x, y)| x * y).sum()
}

/// Sum.
pub(super) fn add(a: V3, b: V3) -> V3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Difference.
pub(super) fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Multiple.
pub(super) fn scale(a: V3, s: f64) -> V3 {
    a.map(|v| v * s)
}

/// Dot product.
pub(super) fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
pub(super) fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Length.
pub(super) fn norm(a: V3) -> f64 {
    dot(a, a).sqrt()
}

/// Direction; x for no vector at all.
pub(super) fn direction(a: V3) -> V3 {
    let n = norm(a);
    if n > 1e-12 { scale(a, 1.0 / n) } else { [1.0, 0.0, 0.0] }
}

/// Length 1; the identity for no rotation at all.
pub(super) fn unit(q: Q) -> Q {
    let n = dot4(q, q).sqrt();
    if n > 1e-9 && n.is_finite() { q.map(|v| v / n) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// First `b`, then `a`.
pub(super) fn mul(a: Q, b: Q) -> Q {
    let [aw, ax, ay, az] = a;
    let [bw, bx, by, bz] = b;
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

/// The other way round.
pub(super) fn conjugate(q: Q) -> Q {
    [q[0], -q[1], -q[2], -q[3]]
}

/// A turned vector.
pub(super) fn rotate(q: Q, v: V3) -> V3 {
    let u = [q[1], q[2], q[3]];
    let t = scale(cross(u, v), 2.0);
    add(v, add(scale(t, q[0]), cross(u, t)))
}

/// The rotation that takes z to a direction.
pub(super) fn from_z(to: V3) -> Q {
    let to = direction(to);
    let w = 1.0 + to[2];
    if w < 1e-9 {
        return [0.0, 1.0, 0.0, 0.0];
    }
    // cross(z, to) = (-y, x, 0)
    unit([w, -to[1], to[0], 0.0])
}

/// Angle of a rotation about an axis, rad, in -pi..pi: its twist part.
pub(super) fn twist(q: Q, axis: V3) -> f64 {
    let along = dot([q[1], q[2], q[3]], direction(axis));
    let angle = 2.0 * along.atan2(q[0]);
    wrap(angle)
}

/// The same angle in -pi..pi.
pub(super) fn wrap(angle: f64) -> f64 {
    angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twist_undoes_what_turns() {
        let axis = direction([0.3, -0.4, 0.8]);
        let about = |a: f64| {
            let s = (a / 2.0).sin();
            [(a / 2.0).cos(), axis[0] * s, axis[1] * s, axis[2] * s]
        };
        for a in [-3.0, -1.2, 0.0, 0.4, 2.9] {
            assert!((twist(about(a), axis) - a).abs() < 1e-12);
            let start = from_z(axis);
            let moved = mul(about(a), start);
            assert!((twist(mul(moved, conjugate(start)), axis) - a).abs() < 1e-12);
        }
        for to in [axis, [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]] {
            let z = rotate(from_z(to), [0.0, 0.0, 1.0]);
            assert!(norm(sub(z, to)) < 1e-9, "{z:?}");
        }
    }

    #[test]
    fn the_shorter_way_is_taken() {
        let a = Place { pos: [0.0; 3], quat: [1.0, 0.0, 0.0, 0.0] };
        let b = Place { pos: [2.0, 0.0, 0.0], quat: [-0.999, 0.0, 0.0, -0.0447] };
        let m = Place::between(a, b, 0.5);
        assert_eq!(m.pos, [1.0, 0.0, 0.0]);
        assert!(m.quat[0].abs() > 0.999);
    }
}
