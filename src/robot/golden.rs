//! Poses that cover the ranges evenly: multiples of the golden ratio modulo 1, with another factor
//! for each joint.

/// Value of joint `joint` in pose `k`, within `[lo, hi]`.
pub(super) fn spread(joint: usize, k: usize, [lo, hi]: [f64; 2]) -> f64 {
    let golden = 0.618_033_988_749_895;
    let multiple = (golden * (joint + 1) as f64).fract();
    lo + (hi - lo) * (multiple * (k + 1) as f64).fract()
}
