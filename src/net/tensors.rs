//! Writes safetensors: the same numbers give the same bytes.
//!
//! The library's writer takes its metadata from a `HashMap`, whose order changes from run
//! to run; the format is eight bytes, a JSON header and the numbers, so it is written here.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use robert_linalg::Real;

/// A tensor to write.
#[derive(Clone, Debug)]
pub struct Out<'a> {
    shape: Vec<usize>,
    kind: &'static str,
    bytes: &'a [u8],
}

impl<'a> Out<'a> {
    /// Numbers of this shape, row-major.
    pub fn new<T: Real>(shape: &[usize], data: &'a [T]) -> Self {
        let kind = if size_of::<T>() == 8 { "F64" } else { "F32" };
        // The format is little-endian, as are the processors that this runs on.
        Out { shape: shape.to_vec(), kind, bytes: bytemuck::cast_slice(data) }
    }

    /// A tensor in half precision.
    pub fn half(shape: &[usize], data: &'a [half::f16]) -> Self {
        Out { shape: shape.to_vec(), kind: "F16", bytes: bytemuck::cast_slice(data) }
    }
}

/// The file's bytes.
///
/// # Errors
/// When the header cannot be serialised, which does not happen.
pub fn serialise(
    tensors: &BTreeMap<String, Out<'_>>,
    metadata: &BTreeMap<String, String>,
) -> serde_json::Result<Vec<u8>> {
    let mut header: Map<String, Value> = Map::new();
    header.insert("__metadata__".into(), json!(metadata));
    let mut at = 0;
    for (name, t) in tensors {
        let end = at + t.bytes.len();
        let entry = json!({"dtype": t.kind, "shape": t.shape, "data_offsets": [at, end]});
        header.insert(name.clone(), entry);
        at = end;
    }
    let mut text = serde_json::to_vec(&header)?;
    text.resize(text.len().next_multiple_of(8), b' ');
    let mut bytes = Vec::with_capacity(8 + text.len() + at);
    bytes.extend((text.len() as u64).to_le_bytes());
    bytes.extend(text);
    for t in tensors.values() {
        bytes.extend_from_slice(t.bytes);
    }
    Ok(bytes)
}

/// The file with a changed header and the same numbers, for tests of damaged files here and in the
/// crates above. `bytes` must be a whole file.
#[doc(hidden)]
pub fn with_header(bytes: &[u8], change: impl FnOnce(&mut Value)) -> serde_json::Result<Vec<u8>> {
    let (size, rest) = bytes.split_at(8);
    let n = size.iter().rev().fold(0_usize, |n, &byte| n << 8 | usize::from(byte));
    let mut header: Value = serde_json::from_slice(&rest[..n])?;
    change(&mut header);
    let text = serde_json::to_vec(&header)?;
    let mut out = (text.len() as u64).to_le_bytes().to_vec();
    out.extend(text);
    out.extend(&rest[n..]);
    Ok(out)
}
