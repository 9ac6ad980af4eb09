//! Frames on the socket between parent and child: `u32` length (little endian), `MessagePack`.

use std::io::{self, Read, Write};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::limits;

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
    use super::super::{Answer, Report};
    use super::*;

    #[test]
    fn messages_survive_and_cut_ones_end_the_stream() {
        let answer = Answer { id: 7, report: Report::Bodies(vec![vec![1.0, f32::MIN]]) };
        let mut bytes = Vec::new();
        write(&mut bytes, &answer).unwrap();
        let back: Answer = read(&mut bytes.as_slice()).unwrap().unwrap();
        assert_eq!(format!("{back:?}"), format!("{answer:?}"));
        for end in 0..bytes.len() {
            assert!(read::<Answer>(&mut &bytes[..end]).unwrap().is_none());
        }
        assert!(read::<Answer>(&mut &[0xff_u8; 8][..]).is_err());
    }
}
