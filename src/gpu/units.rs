//! Matrix units of a card, and how products use them.

use super::Error;
use super::adapter::Card;

/// Matrix units: square matrices of 16-bit factors with 32-bit sums, multiplied by a subgroup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Units {
    /// Rows and columns of a matrix.
    pub(crate) side: usize,
    /// Threads of a subgroup.
    pub(crate) lanes: usize,
}

/// Matrices of a subgroup down and across.
pub(crate) const OF_SUBGROUP: [usize; 2] = [2, 4];
/// Subgroups of a workgroup down and across.
pub(crate) const SUBGROUPS: [usize; 2] = [4, 2];
/// Matrices along the terms of a sum that are in workgroup memory at once.
pub(crate) const DEPTH: usize = 4;

/// Rows and columns of the result that a workgroup computes on matrix units.
pub(crate) fn tile(units: Units) -> [usize; 2] {
    [0, 1].map(|i| OF_SUBGROUP[i] * SUBGROUPS[i] * units.side)
}

/// Whether such units, on a card of these limits, can be used.
fn fits(units: Units, limits: &wgpu::Limits) -> bool {
    let Units { side, lanes } = units;
    let threads = SUBGROUPS[0] * SUBGROUPS[1] * lanes;
    let terms = DEPTH * side;
    // As the kernel's arrays, in bytes.
    let factors = tile(units).map(|n| 16 * (n * (terms / 8 + 1)).max(terms * (n / 8 + 1)));
    let memory = factors[0] + factors[1] + threads / lanes * 4 * side * side;
    let whole = tile(units).iter().all(|n| (n * terms / 4).is_multiple_of(threads));
    whole
        && memory <= limits.max_compute_workgroup_storage_size as usize
        && threads <= limits.max_compute_invocations_per_workgroup as usize
}

/// What products of 16-bit matrices need.
pub(crate) const MATRICES: wgpu::Features = wgpu::Features::SHADER_F16
    .union(wgpu::Features::SUBGROUP)
    .union(wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX);

/// The card's units that the kernels can use.
pub(crate) fn units(card: &Card) -> Result<Units, Error> {
    use wgpu::CooperativeScalarType::{F16, F32};
    let unfit = |why: String| Error::Half { device: card.name.clone(), why };
    if !card.adapter.features().contains(MATRICES) {
        return Err(unfit("its driver offers no matrices of 16-bit numbers".to_owned()));
    }
    let info = card.adapter.get_info();
    let lanes = info.subgroup_min_size as usize;
    let offered = card.adapter.cooperative_matrix_properties();
    let one_size = info.subgroup_max_size as usize == lanes;
    let fitting = offered.iter().find_map(|p| {
        let square = p.m_size == p.n_size && p.m_size == p.k_size;
        let units = Units { side: p.m_size as usize, lanes };
        let kind = (p.ab_type, p.cr_type) == (F16, F32);
        (square && one_size && kind && fits(units, &card.adapter.limits())).then_some(units)
    });
    fitting.ok_or_else(|| {
        let kib = card.adapter.limits().max_compute_workgroup_storage_size >> 10;
        let most = info.subgroup_max_size;
        unfit(format!(
            "no kernel fits its matrices, subgroups of {lanes} to {most} threads, and {kib} KiB of workgroup memory"
        ))
    })
}

impl Card {
    /// Whether it multiplies matrices of 16-bit factors.
    pub fn half(&self) -> bool {
        units(self).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_fit_if_workgroup_memory_and_threads_suffice() {
        let of = |memory: u32, threads: u32| wgpu::Limits {
            max_compute_workgroup_storage_size: memory,
            max_compute_invocations_per_workgroup: threads,
            ..wgpu::Limits::default()
        };
        let large = Units { side: 16, lanes: 32 };
        assert!(fits(large, &of(49_152, 1024)));
        assert!(!fits(large, &of(32_768, 1024)) && !fits(large, &of(49_152, 128)));
        assert!(fits(Units { side: 8, lanes: 8 }, &of(32_768, 1024)));
        // A thread would have less than a quad to read.
        assert!(!fits(Units { side: 8, lanes: 128 }, &of(49_152, 1024)));
    }
}
