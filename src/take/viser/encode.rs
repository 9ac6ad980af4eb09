//! Encodes frames and files: msgpack with arrays beside it.

use std::sync::Arc;

use serde::Serialize;

use super::super::error::Error;
use super::buffer::{Packed, failed, pack};
use super::messages::Message;

/// The client's version; it is compared on connecting.
pub const VERSION: &str = "1.1.1";
/// The websocket subprotocol that must be echoed.
pub const SUBPROTOCOL: &str = "viser-v1.1.1";

/// `messages`, encoded one after the other so that the lengths can be in the same map.
fn document<M: Serialize>(messages: &[M], fields: &[(&str, Field<'_>)]) -> Result<Packed, Error> {
    let (list, beside) = pack(&messages)?;
    let lengths: Vec<usize> = beside.iter().map(|b| b.len()).collect();
    // A msgpack map is its size and then keys and values in turn.
    let mut out = vec![0x80 | (fields.len() as u8 + 2)];
    let mut put = |key: &str, value: Vec<u8>| -> Result<(), Error> {
        out.extend(rmp_serde::to_vec(key).map_err(failed)?);
        out.extend(value);
        Ok(())
    };
    for (key, field) in fields {
        let value = match field {
            Field::Number(v) => rmp_serde::to_vec(v),
            Field::Text(v) => rmp_serde::to_vec(v),
        };
        put(key, value.map_err(failed)?)?;
    }
    put("messages", list)?;
    put("binaryBufferLengths", rmp_serde::to_vec(&lengths).map_err(failed)?)?;
    Ok((out, beside))
}

enum Field<'a> {
    Number(f64),
    Text(&'a str),
}

/// A frame of the live connection: both lengths, packed msgpack, then the buffers, each at a
/// multiple of 8 from the start of the frame. The client paces messages by `timestamp_secs`:
/// one clock per connection that never goes back.
///
/// # Errors
/// [`Error::Encode`].
pub fn frame(messages: &[Message], timestamp_secs: f64) -> Result<Vec<u8>, Error> {
    let (inner, beside) = document(messages, &[("timestampSec", Field::Number(timestamp_secs))])?;
    let packed = zstd::bulk::compress(&inner, 1).map_err(failed)?;
    let mut out = Vec::with_capacity(16 + packed.len());
    out.extend((inner.len() as u64).to_le_bytes());
    out.extend((packed.len() as u64).to_le_bytes());
    out.extend(packed);
    append(&mut out, &beside);
    Ok(out)
}

/// A `.viser` file: messages with their times, ascending, in seconds.
///
/// # Errors
/// [`Error::Encode`].
pub(super) fn file(messages: &[(f64, Message)], duration_secs: f64) -> Result<Vec<u8>, Error> {
    let fields =
        [("durationSeconds", Field::Number(duration_secs)), ("viserVersion", Field::Text(VERSION))];
    let (packed, beside) = document(messages, &fields)?;
    let mut inner = Vec::with_capacity(8 + packed.len());
    inner.extend((packed.len() as u64).to_le_bytes());
    inner.extend(packed);
    append(&mut inner, &beside);
    let mut out = (inner.len() as u64).to_le_bytes().to_vec();
    out.extend(zstd::bulk::compress(&inner, 12).map_err(failed)?);
    Ok(out)
}

fn append(out: &mut Vec<u8>, beside: &[Arc<[u8]>]) {
    for buffer in beside {
        out.resize(out.len().next_multiple_of(8), 0);
        out.extend_from_slice(buffer);
    }
}

#[cfg(test)]
mod tests {
    use super::super::buffer::Buffer;
    use super::super::messages::*;
    use super::*;

    #[derive(serde::Deserialize, Debug)]
    #[serde(rename_all = "camelCase")]
    struct Live {
        timestamp_sec: f64,
        messages: Vec<serde_json::Value>,
        binary_buffer_lengths: Vec<usize>,
    }

    fn u64_at(bytes: &[u8], at: usize) -> usize {
        u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize
    }

    #[test]
    fn a_frame_decodes_as_the_client_does() {
        let vertices = Buffer::f32(&[1.0, 2.0, 3.0]);
        let mesh = MeshProps {
            vertices: vertices.clone(),
            faces: Buffer::u32(&[0, 0, 0]),
            ..MeshProps::default()
        };
        let messages = [
            Message::create("/a", mesh.clone()),
            Message::create("/b", mesh),
            Message::position("/a", [1.0, 2.0, 3.0]),
        ];
        let bytes = frame(&messages, 2.5).unwrap();
        let (inner, packed) = (u64_at(&bytes, 0), u64_at(&bytes, 8));
        let raw = zstd::bulk::decompress(&bytes[16..16 + packed], inner).unwrap();
        assert_eq!(raw.len(), inner);
        let live: Live = rmp_serde::from_slice(&raw).unwrap();
        assert_eq!(live.timestamp_sec, 2.5);
        // Both meshes share their arrays.
        assert_eq!(live.binary_buffer_lengths, [12, 12]);
        let first = &live.messages[0];
        assert_eq!(first["type"], "MeshMessage");
        assert_eq!(first["name"], "/a");
        assert_eq!(first["owner"], "");
        assert_eq!(first["virtual"], false);
        assert_eq!(first["props"]["vertices"]["__binary_index"], 0);
        assert_eq!(first["props"]["vertices"]["dtype"], "<f4");
        assert_eq!(first["props"]["faces"]["__binary_index"], 1);
        assert_eq!(live.messages[1]["props"]["faces"]["__binary_index"], 1);
        assert_eq!(live.messages[2]["position"], serde_json::json!([1.0, 2.0, 3.0]));
        let first = (16 + packed).next_multiple_of(8);
        assert_eq!(&bytes[first..first + 4], &1.0_f32.to_le_bytes());
        let second = (first + 12).next_multiple_of(8);
        assert_eq!(bytes.len(), second + 12);
    }

    #[test]
    fn a_buffer_outside_of_a_frame_is_an_error() {
        assert!(rmp_serde::to_vec_named(&Buffer::u8(&[1])).is_err());
    }
}
