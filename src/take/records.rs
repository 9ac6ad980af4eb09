//! Reads MCAP records in memory with bounds: framing, chunks, the needed fields.
//!
//! No length is trusted: every slice is checked, every chunk is unpacked into a buffer of at most
//! its declared size, and all chunks together stay below
//! [`limits::TAKE_UNPACKED_BYTES`].

use std::borrow::Cow;

use super::error::Damage;
use robert_base::limits;

/// First and last bytes of every MCAP file.
pub(super) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

pub(super) mod op {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const ATTACHMENT: u8 = 0x09;
    pub(crate) const DATA_END: u8 = 0x0F;
}

/// One record.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record<'a> {
    pub op: u8,
    pub body: &'a [u8],
    /// Byte of the buffer at which the record begins.
    pub offset: usize,
}

/// Records one after the other.
#[derive(Debug)]
pub(super) struct Records<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Records<'a> {
    /// Records from this byte on.
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Records<'a> {
        Records { bytes, at }
    }

    /// The next record; `None` at the end of the buffer.
    pub(super) fn next(&mut self) -> Option<Result<Record<'a>, Damage>> {
        let offset = self.at;
        let rest = self.bytes.get(offset..).unwrap_or_default();
        if rest.is_empty() {
            return None;
        }
        let mut fields = Fields::new(rest);
        let (Some(op), Some(len)) = (fields.u8(), fields.u64()) else {
            return Some(Err(Damage::at(offset, "the file ends inside a record")));
        };
        let body = usize::try_from(len).ok().and_then(|n| fields.bytes(n));
        let Some(body) = body else {
            let left = rest.len() - 9;
            let problem = format!("a record of {len} bytes, but only {left} are left in the file");
            return Some(Err(Damage::at(offset, problem)));
        };
        self.at += 9 + body.len();
        Some(Ok(Record { op, body, offset }))
    }

    /// Byte after the last record.
    pub(super) fn at(&self) -> usize {
        self.at
    }
}

/// Fields of a record, one after the other; `None` if the bytes are too short.
#[derive(Clone, Debug)]
pub(super) struct Fields<'a> {
    rest: &'a [u8],
}

impl<'a> Fields<'a> {
    pub(super) fn new(rest: &'a [u8]) -> Fields<'a> {
        Fields { rest }
    }

    pub(super) fn bytes(&mut self, n: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(n)?;
        self.rest = rest;
        Some(taken)
    }

    fn u8(&mut self) -> Option<u8> {
        self.bytes(1)?.first().copied()
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.bytes(2)?.try_into().ok()?))
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.bytes(4)?.try_into().ok()?))
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.bytes(8)?.try_into().ok()?))
    }

    pub(super) fn text(&mut self) -> Option<&'a str> {
        let n = self.u32()? as usize;
        std::str::from_utf8(self.bytes(n)?).ok()
    }

    pub(super) fn rest(self) -> &'a [u8] {
        self.rest
    }
}

/// A topic.
#[derive(Clone, Debug)]
pub(super) struct Channel<'a> {
    pub id: u16,
    pub topic: &'a str,
    pub encoding: &'a str,
}

impl<'a> Channel<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Option<Channel<'a>> {
        let mut f = Fields::new(body);
        let id = f.u16()?;
        f.u16()?;
        Some(Channel { id, topic: f.text()?, encoding: f.text()? })
    }
}

/// A message.
#[derive(Clone, Copy, Debug)]
pub(super) struct Message<'a> {
    pub channel: u16,
    pub log_time: u64,
    pub data: &'a [u8],
}

impl<'a> Message<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Option<Message<'a>> {
        let mut f = Fields::new(body);
        let channel = f.u16()?;
        f.u32()?;
        let log_time = f.u64()?;
        f.u64()?;
        Some(Message { channel, log_time, data: f.rest() })
    }
}

/// A file inside the file, with a verified checksum.
pub(super) fn attachment(record: Record<'_>) -> Result<(&str, &[u8]), Damage> {
    let fail = |problem: &str| Damage::at(record.offset, problem);
    let parse = || {
        let mut f = Fields::new(record.body);
        f.u64()?;
        f.u64()?;
        let name = f.text()?;
        f.text()?;
        let n = usize::try_from(f.u64()?).ok()?;
        let data = f.bytes(n)?;
        Some((name, data, f.u32()?, f.rest().is_empty()))
    };
    let Some((name, data, crc, true)) = parse() else {
        return Err(fail("an attachment whose lengths disagree"));
    };
    let hashed = record.body.get(..record.body.len().saturating_sub(4)).unwrap_or_default();
    if crc != 0 && crc32fast::hash(hashed) != crc {
        return Err(fail("an attachment whose checksum is wrong"));
    }
    Ok((name, data))
}

/// The records of a chunk, unpacked and checked. `budget` is the remaining size for all chunks.
pub(super) fn unpack<'a>(record: Record<'a>, budget: &mut u64) -> Result<Cow<'a, [u8]>, Damage> {
    let fail = |problem: String| Damage::at(record.offset, problem);
    let parse = || {
        let mut f = Fields::new(record.body);
        f.u64()?;
        f.u64()?;
        let size = f.u64()?;
        let crc = f.u32()?;
        let compression = f.text()?;
        let n = usize::try_from(f.u64()?).ok()?;
        Some((size, crc, compression, f.bytes(n)?))
    };
    let Some((size, crc, compression, packed)) = parse() else {
        return Err(fail("a chunk whose lengths disagree".to_owned()));
    };
    let cap = limits::MCAP_RECORD_BYTES as u64;
    if size > cap || size > *budget {
        let cap = cap.min(*budget);
        return Err(fail(format!("a chunk of {size} bytes unpacked, more than the {cap} allowed")));
    }
    *budget -= size;
    let size = size as usize;
    let records: Cow<'a, [u8]> = match compression {
        "" => packed.into(),
        "zstd" => zstd::bulk::decompress(packed, size)
            .map_err(|e| fail(format!("a chunk that does not unpack: {e}")))?
            .into(),
        other => {
            let name: String = other.chars().take(16).collect();
            return Err(fail(format!("a chunk packed with {name:?}; only zstd is read")));
        }
    };
    if records.len() != size {
        return Err(fail(format!("a chunk of {} bytes that should be {size}", records.len())));
    }
    if crc != 0 && crc32fast::hash(&records) != crc {
        return Err(fail("a chunk whose checksum is wrong".to_owned()));
    }
    Ok(records)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(declared: u64, compression: &str, packed: &[u8]) -> Vec<u8> {
        let mut body = vec![0; 16];
        body.extend(declared.to_le_bytes());
        body.extend([0; 4]);
        body.extend((compression.len() as u32).to_le_bytes());
        body.extend(compression.as_bytes());
        body.extend((packed.len() as u64).to_le_bytes());
        body.extend(packed);
        body
    }

    fn problem(body: &[u8], budget: u64) -> String {
        let record = Record { op: op::CHUNK, body, offset: 40 };
        unpack(record, &mut { budget }).map_or_else(|d| d.to_string(), |_| "fine".to_owned())
    }

    /// A chunk may claim the largest size, and is refused when it is unpacked; with one byte more
    /// it is refused before. The same applies to the total of all chunks.
    #[test]
    fn chunk_sizes_are_capped() {
        let cap = limits::MCAP_RECORD_BYTES as u64;
        let small = zstd::bulk::compress(b"hello", 1).unwrap();
        let far = limits::TAKE_UNPACKED_BYTES;
        assert!(problem(&chunk(cap, "zstd", &small), far).contains("should be"));
        assert!(problem(&chunk(cap + 1, "zstd", &small), far).contains("allowed"));
        assert_eq!(problem(&chunk(5, "zstd", &small), 5), "fine");
        assert!(problem(&chunk(5, "zstd", &small), 4).contains("allowed"));
        // A bomb: it contains more than it claims.
        let bomb = zstd::bulk::compress(&vec![0; 1 << 20], 1).unwrap();
        assert!(problem(&chunk(1000, "zstd", &bomb), far).contains("does not unpack"));
        assert_eq!(problem(&chunk(5, "", b"hello"), far), "fine");
        assert!(problem(&chunk(5, "", b"hell"), far).contains("should be"));
        assert!(problem(&chunk(5, "lz4", b"hello"), far).contains("lz4"));
        assert!(problem(&chunk(5, "zstd", b"hello"), far).starts_with("byte 40: "));
    }

    #[test]
    fn lengths_beyond_the_file_are_refused() {
        let mut bytes = vec![op::MESSAGE];
        bytes.extend(u64::MAX.to_le_bytes());
        assert!(Records::new(&bytes, 0).next().unwrap().is_err());
        assert!(Records::new(&bytes[..4], 0).next().unwrap().is_err());
        assert!(Records::new(&[], 0).next().is_none());
        let short = Record { op: op::ATTACHMENT, body: &[0; 5], offset: 0 };
        assert!(attachment(short).is_err());
    }
}
