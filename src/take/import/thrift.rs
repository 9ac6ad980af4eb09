//! Thrift's compact protocol, in which Parquet writes its footer and the headers of its pages.
//!
//! Only as far as to know what a file claims before a library reserves memory for it: sizes,
//! counts, lengths of lists. Source: the specification of the compact protocol, Apache Thrift.

use std::io::{Read, copy, sink};

use super::super::error::Error;
use super::samples::foreign;

/// Types of fields.
const STOP: u8 = 0;
pub(super) const TRUE: u8 = 1;
pub(super) const FALSE: u8 = 2;
const BYTE: u8 = 3;
const I16: u8 = 4;
pub(super) const I32: u8 = 5;
pub(super) const I64: u8 = 6;
const DOUBLE: u8 = 7;
pub(super) const BINARY: u8 = 8;
const LIST: u8 = 9;
const SET: u8 = 10;
pub(super) const STRUCT: u8 = 12;

/// Nesting of structs and lists. Parquet's own stay below ten.
const DEPTH: usize = 16;

/// What reads one struct, and how much it has read.
pub(super) struct Walk<R> {
    from: R,
    /// Bytes read.
    pub(super) bytes: u64,
    /// Elements of all lists.
    pub(super) elements: u64,
    /// Those of them that are structs.
    pub(super) structs: u64,
    /// The most elements, and the most of them that are structs.
    caps: (u64, u64),
}

/// Hears of every field outside of lists: the ids that lead to it, its type, and the value of a
/// whole number (0 of others). It may refuse it.
pub(super) type Heard<'a> = dyn FnMut(&[i16], u8, i64) -> Result<(), Error> + 'a;

impl<R: Read> Walk<R> {
    pub(super) fn new(from: R, elements: u64, structs: u64) -> Walk<R> {
        Walk { from, bytes: 0, elements: 0, structs: 0, caps: (elements, structs) }
    }

    /// Reads one struct to its end.
    ///
    /// # Errors
    /// [`Error::Foreign`] for what is no struct, too deep or has too many elements, and what
    /// `heard` refused.
    pub(super) fn read(&mut self, heard: &mut Heard<'_>) -> Result<(), Error> {
        self.fields(&mut Vec::new(), 0, heard)
    }

    fn fields(
        &mut self,
        path: &mut Vec<i16>,
        depth: usize,
        heard: &mut Heard<'_>,
    ) -> Result<(), Error> {
        if depth >= DEPTH {
            return Err(foreign("its headers are nested too deeply"));
        }
        let mut id = 0_i16;
        loop {
            let head = self.byte()?;
            let (step, kind) = (head >> 4, head & 15);
            if kind == STOP {
                return Ok(());
            }
            let next = match step {
                0 => i16::try_from(self.number()?).ok(),
                step => id.checked_add(i16::from(step)),
            };
            id = next.ok_or_else(broken)?;
            path.push(id);
            self.value(kind, path, depth, heard)?;
            path.pop();
        }
    }

    fn value(
        &mut self,
        kind: u8,
        path: &mut Vec<i16>,
        depth: usize,
        heard: &mut Heard<'_>,
    ) -> Result<(), Error> {
        let number = if matches!(kind, I16 | I32 | I64) { self.number()? } else { 0 };
        heard(path, kind, number)?;
        match kind {
            TRUE | FALSE | I16 | I32 | I64 => Ok(()),
            BYTE => self.skip(1),
            DOUBLE => self.skip(8),
            BINARY => {
                let length = self.varint()?;
                self.skip(length)
            }
            LIST | SET => self.list(depth + 1),
            STRUCT => self.fields(path, depth + 1, heard),
            _ => Err(broken()),
        }
    }

    fn list(&mut self, depth: usize) -> Result<(), Error> {
        if depth >= DEPTH {
            return Err(foreign("its headers are nested too deeply"));
        }
        let head = self.byte()?;
        let kind = head & 15;
        let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
        self.elements = self.elements.saturating_add(count);
        if kind == STRUCT {
            self.structs = self.structs.saturating_add(count);
        }
        if self.elements > self.caps.0 || self.structs > self.caps.1 {
            return Err(foreign("its footer lists more than is read"));
        }
        for _ in 0..count {
            match kind {
                TRUE | FALSE => self.skip(1)?,
                _ => self.value(kind, &mut Vec::new(), depth, &mut |_, _, _| Ok(()))?,
            }
        }
        Ok(())
    }

    fn byte(&mut self) -> Result<u8, Error> {
        let mut byte = [0];
        self.from.read_exact(&mut byte).map_err(|e| foreign(format!("a header is cut: {e}")))?;
        self.bytes += 1;
        Ok(byte[0])
    }

    fn skip(&mut self, bytes: u64) -> Result<(), Error> {
        let read = copy(&mut self.from.by_ref().take(bytes), &mut sink());
        if read.map_err(|e| foreign(format!("a header is cut: {e}")))? != bytes {
            return Err(foreign("a header is cut"));
        }
        self.bytes += bytes;
        Ok(())
    }

    fn varint(&mut self) -> Result<u64, Error> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(broken())
    }

    /// A whole number: its sign is its lowest bit.
    fn number(&mut self) -> Result<i64, Error> {
        let bits = self.varint()?;
        Ok((bits >> 1) as i64 ^ -((bits & 1) as i64))
    }
}

fn broken() -> Error {
    foreign("a header of the file is damaged")
}
