//! The tile unit of server processors from Sapphire Rapids on (Intel AMX, Intel 64 and IA-32
//! Architectures Software Developer's Manual, volume 1, chapter 18).
//!
//! It has eight registers of sixteen rows of 64 bytes. One instruction multiplies two of them as
//! matrices of bfloat16 and adds the product to a third in single precision, at sixteen times the
//! rate of vector instructions of single precision. Rust has no safe access to it, so this
//! file has `unsafe`, as only `src/mujoco` and `src/gpu/trusted.rs` have besides; it contains four
//! blocks of instructions. [`super::bf16x3`] uses them.

#![allow(unsafe_code)]

use std::arch::asm;
use std::cell::Cell;
use std::marker::PhantomData;
use std::sync::OnceLock;

/// Rows, columns and inner steps of a block of [`Tiles::multiply`].
pub(super) const SIDE: usize = 32;
/// Terms that each number of a factor is split into.
pub(super) const TERMS: usize = 3;
/// Words of four bytes in a tile.
pub(super) const TILE: usize = 256;
/// Words in a block of 32 rows or columns and 32 inner steps: for each term two tiles.
pub(super) const BLOCK: usize = TERMS * 2 * TILE;

thread_local! {
    /// Whether this thread has its registers set up.
    static LIVE: Cell<bool> = const { Cell::new(false) };
}

/// The configured tile registers of this thread, released on drop. There is at most one value per
/// thread.
#[derive(Debug)]
pub(super) struct Tiles {
    /// Registers belong to a thread.
    stay: PhantomData<*const ()>,
}

/// Shape of the eight registers, as the processor reads it.
#[repr(C, align(64))]
struct Shape([u8; 64]);

impl Tiles {
    /// Whether this machine has the unit and lets the process use it. `ROBERT_AMX=off` disables it.
    ///
    /// Linux also refuses while a thread's signal stack is too small for tiles. The result of the
    /// first call is kept.
    pub(super) fn usable() -> bool {
        static USABLE: OnceLock<bool> = OnceLock::new();
        *USABLE.get_or_init(|| {
            let off = std::env::var("ROBERT_AMX")
                .is_ok_and(|v| ["off", "0", "no", "false"].contains(&v.to_lowercase().as_str()));
            !off && present() && permitted()
        })
    }

    /// Configures the registers of this thread; `None` if they cannot be used.
    ///
    /// # Panics
    /// When this thread has configured them already.
    pub(super) fn start() -> Option<Self> {
        if !Self::usable() {
            return None;
        }
        assert!(!LIVE.replace(true), "the tiles of this thread are in use");
        let mut shape = Shape([0; 64]);
        let (palette, rest) = shape.0.split_at_mut(16);
        let (widths, heights) = rest.split_at_mut(32);
        palette[0] = 1;
        widths[..16].as_chunks_mut::<2>().0.fill(64_u16.to_le_bytes());
        heights[..8].fill(16);
        // SAFETY: the unit is present and permitted (`usable`); the instruction reads the 64
        // bytes of `shape` and sets tile registers, which the compiler never uses.
        unsafe {
            asm!(
                "ldtilecfg [{}]",
                in(reg) &raw const shape,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack),
            );
        }
        Some(Tiles { stay: PhantomData })
    }

    /// `out` (32 × 32 row-major) = or += a b, the inner dimension being 32 for each block of
    /// `a` and `b`.
    ///
    /// Of the nine products of three terms the six largest are computed. The rest is below 2⁻²⁴ of
    /// the product of two numbers, half a unit in the last place of single precision, and usually
    /// far below.
    ///
    /// # Panics
    /// When the factors are not the same number of whole blocks.
    #[allow(clippy::unused_self)] // whoever has one has set the registers up
    pub(super) fn multiply(&self, a: &[f32], b: &[f32], out: &mut [f32; SIDE * SIDE], add: bool) {
        assert!(a.len() == b.len() && a.len().is_multiple_of(BLOCK), "factors differ in length");
        let blocks = a.len() / BLOCK;
        if blocks == 0 {
            if !add {
                out.fill(0.0);
            }
            return;
        }
        // SAFETY: the registers are set up for as long as `self` lives: there is one such value
        // to a thread, and nothing that is called in between uses tiles (the calling convention
        // leaves them to whoever set them up, and no library here has them). Loads stay within the
        // `blocks` blocks of `a` and `b` (per block six tiles of 1024 bytes each, stride 64),
        // loads and stores of sums within the 4096 bytes of `out` (rows of 128 bytes).
        unsafe {
            asm!(
                "test {add:e}, {add:e}",
                "jz 3f",
                "tileloadd tmm0, [{c} + {wide}]",
                "tileloadd tmm1, [{c} + {wide} + 64]",
                "tileloadd tmm2, [{c} + {wide} + 2048]",
                "tileloadd tmm3, [{c} + {wide} + 2112]",
                "jmp 2f",
                "3:",
                "tilezero tmm0",
                "tilezero tmm1",
                "tilezero tmm2",
                "tilezero tmm3",
                "2:",
                // First terms of both.
                "tileloadd tmm4, [{a} + {line}]",
                "tileloadd tmm6, [{b} + {line}]",
                "tileloadd tmm5, [{a} + {line} + 1024]",
                "tileloadd tmm7, [{b} + {line} + 1024]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                // First of a, second of b.
                "tileloadd tmm6, [{b} + {line} + 2048]",
                "tileloadd tmm7, [{b} + {line} + 3072]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tdpbf16ps tmm3, tmm5, tmm7",
                // First of a, third of b.
                "tileloadd tmm6, [{b} + {line} + 4096]",
                "tileloadd tmm7, [{b} + {line} + 5120]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tdpbf16ps tmm3, tmm5, tmm7",
                // Second of a, first of b.
                "tileloadd tmm4, [{a} + {line} + 2048]",
                "tileloadd tmm6, [{b} + {line}]",
                "tileloadd tmm5, [{a} + {line} + 3072]",
                "tileloadd tmm7, [{b} + {line} + 1024]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                // Third of a, first of b.
                "tileloadd tmm4, [{a} + {line} + 4096]",
                "tileloadd tmm5, [{a} + {line} + 5120]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                // Second of both.
                "tileloadd tmm4, [{a} + {line} + 2048]",
                "tileloadd tmm6, [{b} + {line} + 2048]",
                "tileloadd tmm5, [{a} + {line} + 3072]",
                "tileloadd tmm7, [{b} + {line} + 3072]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                "add {a}, 6144",
                "add {b}, 6144",
                "dec {blocks}",
                "jnz 2b",
                "tilestored [{c} + {wide}], tmm0",
                "tilestored [{c} + {wide} + 64], tmm1",
                "tilestored [{c} + {wide} + 2048], tmm2",
                "tilestored [{c} + {wide} + 2112], tmm3",
                add = in(reg) u32::from(add),
                a = inout(reg) a.as_ptr() => _,
                b = inout(reg) b.as_ptr() => _,
                c = in(reg) out.as_mut_ptr(),
                blocks = inout(reg) blocks => _,
                line = in(reg) 64_usize,
                wide = in(reg) 128_usize,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack),
            );
        }
    }
}

impl Drop for Tiles {
    /// Released registers need not be saved at a context switch.
    fn drop(&mut self) {
        // SAFETY: the unit is present and permitted, or there would be no value to drop.
        unsafe {
            asm!(
                "tilerelease",
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack),
            );
        }
        LIVE.set(false);
    }
}

/// Whether the processor has tiles of bfloat16 (CPUID leaf 7: AMX-BF16 and AMX-TILE).
fn present() -> bool {
    let most = std::arch::x86_64::__cpuid(0).eax;
    most >= 7 && std::arch::x86_64::__cpuid_count(7, 0).edx >> 22 & 0b101 == 0b101
}

/// Asks Linux for the registers; it saves them only for processes that asked (5.16 and later).
fn permitted() -> bool {
    const ARCH_PRCTL: isize = 158;
    const ARCH_REQ_XCOMP_PERM: usize = 0x1023;
    const XTILEDATA: usize = 18;
    if !cfg!(target_os = "linux") {
        return false;
    }
    let refused: isize;
    // SAFETY: this call changes what this process may use and touches no memory; the kernel
    // clobbers rcx and r11.
    unsafe {
        asm!(
            "syscall",
            inlateout("rax") ARCH_PRCTL => refused,
            in("rdi") ARCH_REQ_XCOMP_PERM,
            in("rsi") XTILEDATA,
            out("rcx") _,
            out("r11") _,
            options(nostack, nomem),
        );
    }
    refused == 0
}
