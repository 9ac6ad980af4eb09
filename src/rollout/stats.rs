//! Means with confidence intervals.

use serde::{Deserialize, Serialize};

/// A mean and the half width of its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Sample mean.
    pub mean: f64,
    /// Half width; `None` for fewer than two samples.
    pub ci95: Option<f64>,
    /// Samples.
    pub n: usize,
}

/// Two-sided 97.5 % quantiles of Student's t for 1..=30 degrees of freedom.
const T975: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160,
    2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056,
    2.052, 2.048, 2.045, 2.042,
];

/// Mean and t(n-1) s/sqrt(n), as in the paper (three seeds: 4.303 s/sqrt(3)). `None` for no
/// samples.
pub fn mean_ci95(samples: &[f64]) -> Option<Interval> {
    let n = samples.len();
    // Relative to the first sample, so that equal samples have a spread of exactly zero.
    let first = *samples.first()?;
    let mean = first + samples.iter().map(|s| s - first).sum::<f64>() / n as f64;
    let ci95 = (n > 1).then(|| {
        let var = samples.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / (n - 1) as f64;
        let t = T975.get(n - 2).copied().unwrap_or(1.96);
        t * (var / n as f64).sqrt()
    });
    Some(Interval { mean, ci95, n })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_seeds_use_the_papers_factor() {
        let i = mean_ci95(&[1.0, 2.0, 3.0]).unwrap();
        assert_eq!(i.mean, 2.0);
        assert!((i.ci95.unwrap() - 4.303 / 3.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(mean_ci95(&[5.0]).unwrap().ci95, None);
        assert_eq!(mean_ci95(&[]), None);
    }
}
