//! Helpers between the C side and the rest of this module.

use std::ffi::{CStr, c_char};

use super::bindings as mj;
use super::error::Error;

/// Runs one guarded entry point and turns its code and message into a result.
///
/// `call` gets the message buffer. The text is returned on success too, because a successful load
/// may leave a warning there.
pub(super) fn call(
    doing: &'static str,
    call: impl FnOnce(*mut c_char) -> i32,
) -> Result<String, Error> {
    let mut buf = [0_u8; mj::RB_MESSAGE as usize];
    let code = call(buf.as_mut_ptr().cast::<c_char>());
    let text = CStr::from_bytes_until_nul(&buf)
        .map(|c| c.to_string_lossy().into_owned())
        .unwrap_or_default();
    match code as mj::RbCode {
        mj::RB_OK => Ok(text),
        mj::RB_ENGINE => Err(Error::Engine { message: text }),
        mj::RB_MEMORY => Err(Error::Memory { doing }),
        mj::RB_REFUSED => Err(super::error::refusal(&text)),
        mj::RB_ARGUMENT => Err(Error::Invalid { message: text, path: None }),
        _ => Err(Error::Cxx { message: text }),
    }
}

/// A slice over `len` values at `ptr`; empty for a null pointer.
///
/// # Safety
/// `ptr` must be null or point to `len` initialised values that live for `'a`.
pub(super) unsafe fn slice<'a, T>(ptr: *const T, len: usize) -> &'a [T] {
    if ptr.is_null() || len == 0 {
        return &[];
    }
    // SAFETY: non-null, and the caller vouches for length and lifetime.
    unsafe { std::slice::from_raw_parts(ptr, len) }
}

/// The mutable twin of [`slice`].
///
/// # Safety
/// As [`slice`], and nobody else may hold a reference to these values during `'a`.
pub(super) unsafe fn slice_mut<'a, T>(ptr: *mut T, len: usize) -> &'a mut [T] {
    if ptr.is_null() || len == 0 {
        return &mut [];
    }
    // SAFETY: non-null, and the caller vouches for length, lifetime and exclusivity.
    unsafe { std::slice::from_raw_parts_mut(ptr, len) }
}

/// A model size: never negative in a compiled model.
pub(super) fn size(n: i32) -> usize {
    usize::try_from(n).unwrap_or(0)
}

/// Receives every engine warning (called from `shim.cc`).
#[unsafe(no_mangle)]
extern "C" fn rb_on_warning(text: *const c_char) {
    if text.is_null() {
        return;
    }
    // SAFETY: the engine hands a NUL-terminated string that lives during this call.
    let text = unsafe { CStr::from_ptr(text) };
    tracing::debug!(target: "robert::mujoco", "{}", text.to_string_lossy().trim());
}
