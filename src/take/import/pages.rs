//! What a Parquet file asks its reader to reserve: known and bounded before anything is decoded.
//!
//! The sizes in the headers of a file are what its writer says. A hundred bytes can claim two
//! thousand million values, or a page of 2 GB.

use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};

use super::super::error::Error;
use super::samples::foreign;
use super::thrift::{BINARY, FALSE, I32, I64, STRUCT, TRUE, Walk};
use robert_base::limits;

/// Refuses a footer that is larger, or lists more, than that of any dataset.
///
/// # Errors
/// [`Error::Foreign`].
pub(super) fn footer(file: &File) -> Result<(), Error> {
    let cut = |e: std::io::Error| foreign(format!("the file is cut: {e}"));
    let mut file = file;
    let mut tail = [0_u8; 8];
    let end = file.seek(SeekFrom::End(-8)).map_err(cut)?;
    file.read_exact(&mut tail).map_err(cut)?;
    let [a, b, c, d, ..] = tail;
    let bytes = u64::from(u32::from_le_bytes([a, b, c, d]));
    if bytes > limits::DATASET_FOOTER_BYTES.min(end) {
        return Err(foreign(format!("a footer of {bytes} bytes")));
    }
    file.seek(SeekFrom::Start(end - bytes)).map_err(cut)?;
    let from = BufReader::new(file.take(bytes));
    let caps = (limits::DATASET_FOOTER_ELEMENTS, limits::DATASET_FOOTER_ELEMENTS / 10);
    Walk::new(from, caps.0, caps.1).read(&mut |_, _, _| Ok(()))
}

/// The pages that are left to a file.
pub(super) struct Pages(usize);

impl Pages {
    pub(super) fn new() -> Pages {
        Pages(limits::DATASET_PAGES)
    }

    /// Refuses a column of one row group, at these bytes of the file, if its pages claim more than
    /// `values` values or more than [`limits::DATASET_PAGE_BYTES`] each.
    ///
    /// # Errors
    /// [`Error::Foreign`].
    pub(super) fn check(
        &mut self,
        file: &File,
        (mut at, mut left): (u64, u64),
        values: i64,
    ) -> Result<(), Error> {
        let mut claimed = 0_i64;
        while left > 0 {
            self.0 = self
                .0
                .checked_sub(1)
                .ok_or_else(|| foreign(format!("more than {} pages", limits::DATASET_PAGES)))?;
            let mut place = file;
            place.seek(SeekFrom::Start(at)).map_err(|e| foreign(e.to_string()))?;
            let (page, bytes) = header(BufReader::new(place).take(left))?;
            if page.uncompressed > limits::DATASET_PAGE_BYTES {
                return Err(foreign(format!(
                    "a page of {} bytes; at most {} are read",
                    page.uncompressed,
                    limits::DATASET_PAGE_BYTES
                )));
            }
            claimed = claimed.saturating_add(page.values);
            if claimed > values {
                return Err(foreign(format!(
                    "its pages claim {claimed} values where {values} belong"
                )));
            }
            let whole = bytes.checked_add(page.compressed).filter(|n| *n <= left);
            let whole = whole.ok_or_else(|| foreign("a page is longer than its column"))?;
            (at, left) = (at.saturating_add(whole), left - whole);
        }
        Ok(())
    }
}

/// What the header of a page says.
#[derive(Debug, Default, PartialEq)]
struct Page {
    /// Bytes, unpacked.
    uncompressed: u64,
    /// Bytes in the file.
    compressed: u64,
    /// Values in a page of data.
    values: i64,
}

/// The header of a page, and its length in bytes. Ids and types are those of `PageHeader` in the
/// Parquet format: another type at one of them would be read in another way by the library.
fn header(from: impl std::io::Read) -> Result<(Page, u64), Error> {
    let mut page = Page::default();
    let mut seen = Vec::new();
    let (mut entries, mut levels) = (0_i64, 0_i64);
    let mut walk = Walk::new(from, 0, 0);
    walk.read(&mut |path, kind, number| {
        let right = match path {
            [1..=4] | [5, 1..=4] | [7, 1..=2] | [8, 1..=6] => kind == I32,
            [5..=8] | [5, 5] | [8, 8] => kind == STRUCT,
            [7, 3] | [8, 7] | [5, 5, 7 | 8] | [8, 8, 7 | 8] => matches!(kind, TRUE | FALSE),
            [5, 5, 3 | 4] | [8, 8, 3 | 4] => kind == I64,
            [5, 5, 1 | 2 | 5 | 6] | [8, 8, 1 | 2 | 5 | 6] => kind == BINARY,
            _ => true,
        };
        // A checksum is any number; all others are sizes, counts and names of kinds.
        let whole = kind != I32 || path == [4] || i32::try_from(number).is_ok_and(|n| n >= 0);
        if !right || !whole || seen.iter().any(|p: &Vec<i16>| p == path) {
            return Err(foreign(format!("the header of a page is damaged: field {path:?}")));
        }
        seen.push(path.to_vec());
        match path {
            [2] => page.uncompressed = number as u64,
            [3] => page.compressed = number as u64,
            [5 | 8, 1] => page.values = page.values.max(number),
            [7, 1] => entries = number,
            [8, 5 | 6] => levels += number,
            _ => {}
        }
        Ok(())
    })?;
    if ![2, 3].iter().all(|id| seen.contains(&vec![*id])) {
        return Err(foreign("the header of a page says no size"));
    }
    // An entry of a dictionary of numbers takes four bytes at least.
    let room = i64::try_from(page.uncompressed).unwrap_or(i64::MAX);
    if entries > room / 4 || levels > room {
        return Err(foreign(format!(
            "the header of a page claims {} in {room} bytes",
            if levels > room { "levels" } else { "a dictionary" }
        )));
    }
    Ok((page, walk.bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    /// A whole number as the protocol writes it.
    fn number(value: i64) -> Vec<u8> {
        let mut bits = ((value << 1) ^ (value >> 63)) as u64;
        let mut bytes = Vec::new();
        while bits >= 0x80 {
            bytes.push(bits as u8 | 0x80);
            bits >>= 7;
        }
        bytes.push(bits as u8);
        bytes
    }

    /// Fields of 32 bits, each with the step from the id before.
    fn fields(list: &[(u8, i64)]) -> Vec<u8> {
        list.iter().flat_map(|(step, v)| [vec![step << 4 | I32], number(*v)].concat()).collect()
    }

    /// A page of data and its content.
    fn data(uncompressed: i64, compressed: i64, values: i64) -> Vec<u8> {
        let head = fields(&[(1, 0), (1, uncompressed), (1, compressed)]);
        let inner = fields(&[(1, values), (1, 0), (1, 3), (1, 3)]);
        [head, vec![0x2c], inner, vec![0, 0], vec![0; compressed.min(64) as usize]].concat()
    }

    /// A page with a dictionary.
    fn dictionary(uncompressed: i64, entries: i64) -> Vec<u8> {
        let head = fields(&[(1, 2), (1, uncompressed), (1, 0)]);
        [head, vec![0x4c], fields(&[(1, entries), (1, 0)]), vec![0, 0]].concat()
    }

    fn check(bytes: &[u8], pages: usize, values: i64) -> Result<(), String> {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        Pages(pages).check(&file, (0, bytes.len() as u64), values).map_err(|e| e.to_string())
    }

    #[test]
    fn pages_are_bounded_at_their_figures() {
        let most = limits::DATASET_PAGE_BYTES as i64;
        assert_eq!(check(&data(most, 9, 5), 1, 5), Ok(()));
        let two = [data(80, 7, 5), data(80, 0, 5)].concat();
        assert_eq!(check(&two, 2, 10), Ok(()));
        assert_eq!(check(&dictionary(400, 100), 1, 0), Ok(()));
        let one = data(0, 0, 0);
        let pages = |n: usize| check(&one.repeat(n), limits::DATASET_PAGES, 0);
        assert_eq!(pages(limits::DATASET_PAGES), Ok(()));
        assert!(pages(limits::DATASET_PAGES + 1).unwrap_err().contains("more than 100000 pages"));
        for (bytes, pages, values, says) in [
            (data(most + 1, 9, 5), 1, 5, "a page of 33554433 bytes; at most 33554432 are read"),
            (data(most, 9, 5), 1, 4, "claim 5 values where 4 belong"),
            (two.clone(), 2, 9, "claim 10 values where 9 belong"),
            (two.clone(), 1, 10, "pages"),
            (dictionary(400, 101), 1, 0, "a dictionary in 400 bytes"),
            (dictionary(400, i64::from(i32::MAX)), 1, 0, "a dictionary in 400 bytes"),
            (data(80, 65, 5), 1, 5, "longer than its column"),
            (data(-1, 9, 5), 1, 5, "field [2]"),
            (data(1 << 40, 9, 5), 1, 5, "field [2]"),
            (data(80, 9, -1), 1, 5, "field [5, 1]"),
            (vec![0], 1, 5, "says no size"),
            (two[..2].to_vec(), 1, 5, "cut"),
            (vec![0x1c; 40], 1, 5, "field [1]"),
            (vec![0xfc; 40], 1, 5, "nested"),
            // The same field twice: which of them a reader heeds is its own affair.
            (vec![0x25, 2, 0x15, 0, 0x05, 4, 2, 0], 1, 5, "field [2]"),
            // A number that is typed as a truth has no bytes for one reader and some for another.
            (vec![0x21, 0x15, 0, 0], 1, 5, "field [2]"),
        ] {
            let error = check(&bytes, pages, values).unwrap_err();
            assert!(error.contains(says), "{says}: {error}");
        }
    }

    #[test]
    fn a_footer_is_bounded_before_it_is_parsed() {
        let file = |content: &[u8], length: u32| {
            let mut file = tempfile::tempfile().unwrap();
            file.write_all(&[content, &length.to_le_bytes(), b"PAR1"].concat()).unwrap();
            footer(&file).map_err(|e| e.to_string())
        };
        // Field 2 is a list of this many structs that are empty.
        let listed = |count: u64| {
            let mut head = vec![0x29, 0xfc];
            let mut n = count;
            while n >= 0x80 {
                head.push(n as u8 | 0x80);
                n >>= 7;
            }
            head.push(n as u8);
            [head, vec![0; count as usize], vec![0]].concat()
        };
        let cap = limits::DATASET_FOOTER_ELEMENTS / 10;
        let (whole, more) = (listed(cap), listed(cap + 1));
        assert_eq!(file(&whole, whole.len() as u32), Ok(()));
        assert!(file(&more, more.len() as u32).unwrap_err().contains("lists more"));
        // Lists of one list each.
        let nested = vec![0x19; 100_000];
        assert!(file(&nested, nested.len() as u32).unwrap_err().contains("nested too deeply"));
        let most = limits::DATASET_FOOTER_BYTES as u32;
        let blank = vec![0; most as usize + 1];
        assert_eq!(file(&blank, most), Ok(()));
        assert!(file(&blank, most + 1).unwrap_err().contains("a footer of 16777217 bytes"));
        assert!(file(&[0; 16], 17).unwrap_err().contains("a footer of 17 bytes"));
        assert!(file(&[0; 16], u32::MAX).unwrap_err().contains("a footer of"));
        assert!(file(&[0x3b; 16], 16).is_err());
        assert!(footer(&tempfile::tempfile().unwrap()).unwrap_err().to_string().contains("cut"));
    }
}
