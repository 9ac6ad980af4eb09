//! Frames on the socket between parent and child: `u32` length (little endian), `MessagePack`.

use std::io;
use std::io::{Read, Write};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_bytes::ByteBuf;

use robert_base::limits;

/// Writes one message.
pub(super) fn write(out: &mut impl Write, message: &impl Serialize) -> io::Result<()> {
    let mut bytes = vec![0; 4];
    rmp_serde::encode::write_named(&mut bytes, message).map_err(io::Error::other)?;
    let len = bytes.len() - 4;
    if len > limits::WORKER_MESSAGE_BYTES {
        return Err(io::Error::other("a message to the worker is too large"));
    }
    if let Some(head) = bytes.get_mut(..4) {
        head.copy_from_slice(&(len as u32).to_le_bytes());
    }
    out.write_all(&bytes)?;
    out.flush()
}

/// A value on its own, as part of a message.
pub(super) fn encode(value: &impl Serialize) -> io::Result<ByteBuf> {
    rmp_serde::to_vec_named(value).map(ByteBuf::from).map_err(io::Error::other)
}

/// Reads back the output of [`encode`].
pub(super) fn decode<T: DeserializeOwned>(bytes: &[u8]) -> io::Result<T> {
    rmp_serde::from_slice(bytes).map_err(io::Error::other)
}

/// Reads one message; `None` at the end of the stream.
pub(super) fn read<T: DeserializeOwned>(from: &mut impl Read) -> io::Result<Option<T>> {
    let mut head = [0; 4];
    match from.read_exact(&mut head) {
        Ok(()) => {}
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        Err(e) => return Err(e),
    }
    let len = u32::from_le_bytes(head) as usize;
    if len > limits::WORKER_MESSAGE_BYTES {
        return Err(io::Error::other("a message of the worker is too large"));
    }
    let mut bytes = Vec::new();
    from.take(len as u64).read_to_end(&mut bytes)?;
    if bytes.len() < len {
        return Ok(None);
    }
    rmp_serde::from_slice(&bytes).map(Some).map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::super::message::WorkerMessage;
    use super::*;

    #[test]
    fn messages_survive_and_cut_ones_end_the_stream() {
        let rows = vec![vec![1.0, f32::MIN]];
        let answer = WorkerMessage::Answer(7, encode(&rows).unwrap());
        let mut bytes = Vec::new();
        write(&mut bytes, &answer).unwrap();
        let back: WorkerMessage = read(&mut bytes.as_slice()).unwrap().unwrap();
        let WorkerMessage::Answer(7, body) = back else { panic!("{back:?}") };
        assert_eq!(decode::<Vec<Vec<f32>>>(&body).unwrap(), rows);
        for end in 0..bytes.len() {
            assert!(read::<WorkerMessage>(&mut &bytes[..end]).unwrap().is_none());
        }
        assert!(read::<WorkerMessage>(&mut &[0xff_u8; 8][..]).is_err());
    }

    #[test]
    fn a_message_that_is_too_large_is_refused_by_its_head() {
        let most = limits::WORKER_MESSAGE_BYTES as u32;
        let claimed = |n: u32| read::<WorkerMessage>(&mut &n.to_le_bytes()[..]);
        assert!(claimed(most).unwrap().is_none(), "it is awaited, and the stream ends");
        assert!(claimed(most + 1).unwrap_err().to_string().contains("too large"));
    }
}
