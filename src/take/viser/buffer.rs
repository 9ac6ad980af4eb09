//! Arrays that are sent beside the msgpack.

use std::cell::RefCell;
use std::sync::Arc;

use serde::{Serialize, Serializer, ser::SerializeMap};

use super::super::error::Error;

thread_local! {
    /// Buffers of the document that is being encoded on this thread. With serde a value has no
    /// other way to add data beside its document.
    static BESIDE: RefCell<Option<Vec<Arc<[u8]>>>> = const { RefCell::new(None) };
}

/// An array that is sent beside the msgpack, which contains only its index and type.
/// Clones share the bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Buffer {
    dtype: &'static str,
    bytes: Arc<[u8]>,
}

impl Buffer {
    /// Single-precision numbers.
    pub fn f32(values: &[f32]) -> Buffer {
        Buffer { dtype: "<f4", bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect() }
    }

    /// Indices.
    pub fn u32(values: &[u32]) -> Buffer {
        Buffer { dtype: "<u4", bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect() }
    }

    /// Short indices.
    pub fn u16(values: &[u16]) -> Buffer {
        Buffer { dtype: "<u2", bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect() }
    }

    /// Bytes, for colours.
    pub fn u8(values: &[u8]) -> Buffer {
        Buffer { dtype: "|u1", bytes: values.into() }
    }

    /// Length in bytes.
    pub fn len_bytes(&self) -> usize {
        self.bytes.len()
    }
}

impl Serialize for Buffer {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let index = BESIDE.with_borrow_mut(|beside| {
            let list = beside.as_mut()?;
            // One array in many messages (a mesh and its ghost) is sent once.
            let known = list.iter().position(|b| Arc::ptr_eq(b, &self.bytes));
            Some(known.unwrap_or_else(|| {
                list.push(Arc::clone(&self.bytes));
                list.len() - 1
            }))
        });
        let index =
            index.ok_or_else(|| serde::ser::Error::custom("a buffer outside of a frame"))?;
        let mut map = serializer.serialize_map(Some(2))?;
        map.serialize_entry("__binary_index", &index)?;
        map.serialize_entry("dtype", self.dtype)?;
        map.end()
    }
}

/// Msgpack and the buffers beside it.
pub(super) type Packed = (Vec<u8>, Vec<Arc<[u8]>>);

/// The msgpack of `head`, and the buffers that it refers to.
pub(super) fn pack<H: Serialize>(head: &H) -> Result<Packed, Error> {
    BESIDE.set(Some(Vec::new()));
    let packed = rmp_serde::to_vec_named(head);
    let beside = BESIDE.take().unwrap_or_default();
    Ok((packed.map_err(failed)?, beside))
}

pub(super) fn failed(e: impl std::fmt::Display) -> Error {
    Error::Encode { what: "viser messages", problem: e.to_string() }
}
