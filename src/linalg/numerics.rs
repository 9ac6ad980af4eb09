//! The kind of arithmetic of this process: which vector registers and tiles its products use.
//!
//! Results have equal bits only between processes of one kind, because wider registers add in
//! another order. Before bits are compared between machines, their kinds must be compared.

use std::sync::OnceLock;

use pulp::Arch;

/// Environment variable that limits the registers: `avx2`.
const LIMIT: &str = "ROBERT_SIMD";

/// The registers that [`arch`] uses; chosen once.
static CHOSEN: OnceLock<Arch> = OnceLock::new();

/// The vector registers of this process: the widest of the processor, unless `ROBERT_SIMD=avx2` or
/// [`limit_to_avx2`] limits them.
pub fn arch() -> Arch {
    *CHOSEN.get_or_init(|| {
        let limited = std::env::var(LIMIT).is_ok_and(|v| v.eq_ignore_ascii_case("avx2"));
        if limited { avx2().unwrap_or_default() } else { Arch::new() }
    })
}

/// From now on this process computes like a processor that has AVX2 and no more. False if the
/// processor lacks AVX2, or if wider registers were used already.
pub fn limit_to_avx2() -> bool {
    let Some(narrow) = avx2() else { return false };
    CHOSEN.set(narrow).is_ok() || numerics() == "avx2"
}

/// Whether the widest registers of the processor may be used.
pub(super) fn unlimited() -> bool {
    let wide = Arch::new();
    std::mem::discriminant(&arch()) == std::mem::discriminant(&wide)
}

/// The kind: `avx512+amx`, `avx512`, `avx2`, or the name of the architecture.
pub fn numerics() -> &'static str {
    if super::tiled() { "avx512+amx" } else { vectors() }
}

#[cfg(target_arch = "x86_64")]
fn avx2() -> Option<Arch> {
    pulp::x86::V3::try_new().map(Arch::V3)
}

#[cfg(target_arch = "x86_64")]
fn vectors() -> &'static str {
    match arch() {
        Arch::V4(_) => "avx512",
        Arch::V3(_) => "avx2",
        _ => "x86_64",
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn avx2() -> Option<Arch> {
    None
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> &'static str {
    std::env::consts::ARCH
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kind_names_what_is_used() {
        let known = ["avx512+amx", "avx512", "avx2", std::env::consts::ARCH];
        assert!(known.contains(&numerics()), "{}", numerics());
        // Wider registers cannot be given up after they were used.
        assert_eq!(limit_to_avx2(), numerics() == "avx2");
    }
}
