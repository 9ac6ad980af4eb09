//! The effect of a joint-space torque in one frame, without bias forces.
//!
//! The torque is held for n substeps of semi-implicit Euler with implicit damping, as `MuJoCo`
//! integrates: v+ = (M + h D)^-1 (M v + h u), q+ = q + h v+. A frame of T = n h is then
//!
//! ```text
//! q(T) = q + G v + H u,    v(T) = P v + S u
//! ```
//!
//! with matrices that are valid while the pose, and so the inertia, is about the same.

use nalgebra::{DMatrix, DVector};

/// The four matrices of a frame; each (nv, nv).
#[derive(Clone, Debug)]
pub struct Response {
    /// G: displacement per speed.
    pub coast: DMatrix<f64>,
    /// H: displacement per torque.
    pub way: DMatrix<f64>,
    /// P: remaining speed per speed.
    pub keep: DMatrix<f64>,
    /// S: speed per torque.
    pub speed: DMatrix<f64>,
}

impl Response {
    /// From the inertia (nv, nv) and the damping of the joints; `None` if it is singular.
    pub fn new(mass: &DMatrix<f64>, damping: &[f64], h: f64, n: usize) -> Option<Response> {
        let nv = damping.len();
        let none = DMatrix::zeros(nv, nv);
        Response::of_servos(mass, damping, [&none, &none], h, n)
    }

    /// The same with servos, whose force falls by these (stiffness, damping), (nv, nv) each, as the joints
    /// move away from where they were at the beginning of the frame, and as their speed changes: u is the
    /// torque at the beginning.
    pub fn of_servos(
        mass: &DMatrix<f64>,
        damping: &[f64],
        [stiffness, drag]: [&DMatrix<f64>; 2],
        h: f64,
        n: usize,
    ) -> Option<Response> {
        let nv = damping.len();
        let damping = DMatrix::from_diagonal(&DVector::from_row_slice(damping));
        let implicit = (mass + damping * h).try_inverse()?;
        let s_one = implicit * h;
        let p = &s_one * (mass / h - drag);
        let (mut speed, mut keep) = (DMatrix::zeros(nv, nv), DMatrix::identity(nv, nv));
        let (mut coast, mut way) = (DMatrix::zeros(nv, nv), DMatrix::zeros(nv, nv));
        for _ in 0..n {
            speed = &p * speed + &s_one - &s_one * (stiffness * &way);
            keep = &p * keep + &s_one * (drag - stiffness * &coast);
            coast += &keep * h;
            way += &speed * h;
        }
        Some(Response { coast, way, keep, speed })
    }

    /// The factor by which the slowest disturbance decays per frame under the torque u = way (r - q) +
    /// speed v, (nv, nv) each. Infinite if it grows without bound.
    pub fn under(&self, way: &DMatrix<f64>, speed: &DMatrix<f64>) -> f64 {
        let nv = way.nrows();
        let mut frame = DMatrix::zeros(2 * nv, 2 * nv);
        let mut put = |row: usize, column: usize, block: DMatrix<f64>| {
            frame.view_mut((row, column), (nv, nv)).copy_from(&block);
        };
        put(0, 0, DMatrix::identity(nv, nv) - &self.way * way);
        put(0, nv, &self.coast + &self.way * speed);
        put(nv, 0, -(&self.speed * way));
        put(nv, nv, &self.keep + &self.speed * speed);
        lasting(frame)
    }

    /// The factor by which the slowest disturbance decays per frame when each joint is driven by u
    /// = -kp q - kd v. Infinite if it grows without bound.
    pub fn lasting(&self, kp: &[f64], kd: &[f64]) -> f64 {
        let (kp, kd) = (DVector::from_row_slice(kp), DVector::from_row_slice(kd));
        self.under(&DMatrix::from_diagonal(&kp), &-DMatrix::from_diagonal(&kd))
    }
}

/// The magnitude of the largest eigenvalue of a frame: the factor by which the slowest disturbance
/// decays. Infinite if it grows without bound.
pub(super) fn lasting(mut frame: DMatrix<f64>) -> f64 {
    // Powers 256 and 512 by squaring: between them only the slowest or fastest-growing mode still
    // changes. Sizes are kept as logarithms.
    let (mut before, mut log) = (0.0, 0.0);
    for _ in 0..9 {
        frame = &frame * &frame;
        let norm = frame.norm();
        if norm == 0.0 {
            return 0.0;
        }
        frame /= norm;
        (before, log) = (log, 2.0 * log + norm.ln());
    }
    let factor = f64::exp((log - before) / 256.0);
    if factor.is_finite() { factor } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_its_substeps() {
        let mass = DMatrix::from_row_slice(2, 2, &[1.0, 0.4, 0.4, 0.3]);
        let damping = [2.0, 0.5];
        let (h, n) = (0.005, 10);
        let r = Response::new(&mass, &damping, h, n).unwrap();
        let (mut q, mut v) =
            (DVector::from_vec(vec![0.1, -0.2]), DVector::from_vec(vec![0.5, 1.0]));
        let u = DVector::from_vec(vec![3.0, -1.0]);
        let want = (&q + &r.coast * &v + &r.way * &u, &r.keep * &v + &r.speed * &u);
        let d = DMatrix::from_diagonal(&DVector::from_row_slice(&damping));
        for _ in 0..n {
            let implicit = (&mass + &d * h).try_inverse().unwrap();
            v = implicit * (&mass * &v + &u * h);
            q += &v * h;
        }
        assert!((q - want.0).norm() < 1e-12 && (v - want.1).norm() < 1e-12);
    }

    #[test]
    fn a_servo_gives_way() {
        let mass = DMatrix::from_row_slice(2, 2, &[1.0, 0.4, 0.4, 0.3]);
        let damping = [2.0, 0.5];
        let (h, n) = (0.005, 10);
        let k = DMatrix::from_row_slice(2, 2, &[120.0, 0.0, 0.0, 40.0]);
        let d = DMatrix::from_row_slice(2, 2, &[3.0, 0.0, 0.0, 0.0]);
        let r = Response::of_servos(&mass, &damping, [&k, &d], h, n).unwrap();
        let (q0, v0) = (DVector::from_vec(vec![0.1, -0.2]), DVector::from_vec(vec![0.5, 1.0]));
        let u = DVector::from_vec(vec![3.0, -1.0]);
        let want = (&q0 + &r.coast * &v0 + &r.way * &u, &r.keep * &v0 + &r.speed * &u);
        let joint = DMatrix::from_diagonal(&DVector::from_row_slice(&damping));
        let (mut q, mut v) = (q0.clone(), v0.clone());
        for _ in 0..n {
            let force = &u - &k * (&q - &q0) - &d * (&v - &v0);
            v = (&mass + &joint * h).try_inverse().unwrap() * (&mass * &v + force * h);
            q += &v * h;
        }
        assert!((q - want.0).norm() < 1e-12 && (v - want.1).norm() < 1e-12);
    }

    #[test]
    fn what_lasts_is_the_largest_eigenvalue() {
        // One undamped joint driven at share s: the frame's determinant is 1 - s, its modes
        // are a complex pair.
        let one = DMatrix::from_row_slice(1, 1, &[2.0]);
        let r = Response::new(&one, &[0.0], 0.005, 10).unwrap();
        let b = r.way[(0, 0)];
        assert!((r.lasting(&[0.0], &[0.0]) - 1.0).abs() < 0.05, "nothing is lost");
        let deadbeat = r.lasting(&[0.9 / b], &[0.9 * r.coast[(0, 0)] / b]);
        assert!((deadbeat / 0.1_f64.sqrt() - 1.0).abs() < 0.05, "{deadbeat}");
        assert!(r.lasting(&[4.0 / b], &[4.0 * r.coast[(0, 0)] / b]) > 2.0);
    }
}
