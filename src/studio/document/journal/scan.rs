//! The bytes of a journal: how records are written, and what can be read of a damaged file.

use std::io;

use super::record::{Damage, Record};
use robert_base::limits;
use robert_clip::Delta;

/// First line of a journal.
pub(crate) const MAGIC: &[u8] = b"robert-journal/2\n";

/// Begins every record. Its first byte occurs in no UTF-8 text, so it is in no JSON.
pub(crate) const MARK: [u8; 4] = [0xf5, b'R', b'J', 0xfa];

/// Mark, length, checksum, number, steps done, kind of the record before.
const HEAD: usize = 4 + 4 + 4 + 4 + 4 + 1;

/// The offset at which the checksum ends; the bytes before it are not covered.
const COVERED: usize = 12;

/// The effect of a record on the history.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Kind {
    /// There is no record.
    #[default]
    None,
    Base,
    Edit,
    Undo,
    Redo,
    /// Neither the clip nor its history.
    Other,
}

impl Kind {
    fn of(record: &Record) -> Kind {
        match record {
            Record::Base { .. } => Kind::Base,
            Record::Edit { .. } => Kind::Edit,
            Record::Undo => Kind::Undo,
            Record::Redo => Kind::Redo,
            Record::Closed | Record::Opened => Kind::Other,
        }
    }

    fn from_byte(byte: u8) -> Option<Kind> {
        let all = [Kind::None, Kind::Base, Kind::Edit, Kind::Undo, Kind::Redo, Kind::Other];
        all.into_iter().find(|k| *k as u8 == byte)
    }
}

/// The position of a record, as its neighbours state it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Position {
    /// Records so far, the base counted once.
    number: u32,
    /// Steps of the history that are done.
    done: u32,
    /// The last record.
    last: Kind,
}

impl Position {
    fn after(self, kind: Kind) -> Position {
        let done = match kind {
            Kind::Edit | Kind::Redo => self.done + 1,
            Kind::Undo => self.done.saturating_sub(1),
            Kind::Base => 0,
            Kind::Other | Kind::None => self.done,
        };
        Position { number: self.number + 1, done, last: kind }
    }

    /// Writes a record that follows. A base is written twice: without it nothing could be
    /// read.
    pub(crate) fn encode(&mut self, record: &Record, out: &mut Vec<u8>) -> io::Result<()> {
        let json = serde_json::to_vec(record)?;
        if json.len() > limits::JOURNAL_RECORD_BYTES {
            return Err(io::Error::other("one edit is too large for the journal"));
        }
        let kind = Kind::of(record);
        let next = self.after(kind);
        for _ in 0..if kind == Kind::Base { 2 } else { 1 } {
            let mut covered = Vec::with_capacity(HEAD - COVERED + json.len());
            covered.extend_from_slice(&self.number.to_le_bytes());
            covered.extend_from_slice(&next.done.to_le_bytes());
            covered.push(self.last as u8);
            covered.extend_from_slice(&json);
            out.extend_from_slice(&MARK);
            out.extend_from_slice(&(json.len() as u32).to_le_bytes());
            out.extend_from_slice(&crc32fast::hash(&covered).to_le_bytes());
            out.extend_from_slice(&covered);
        }
        *self = next;
        Ok(())
    }
}

/// The content of a journal.
#[derive(Debug, PartialEq)]
pub(crate) struct Scan {
    pub(crate) records: Vec<Record>,
    pub(crate) damage: Damage,
    /// The position of the next record.
    pub(crate) position: Position,
}

/// Reads the bytes of a journal; `None` if they are not a journal.
///
/// One pass: no record reaches beyond the next mark, so each byte is looked at twice at most.
pub(crate) fn scan(bytes: &[u8]) -> Option<Scan> {
    let room = u32::try_from(bytes.len() / HEAD).unwrap_or(u32::MAX);
    let mut reading = Reading { room, ..Reading::default() };
    if bytes.len() < MAGIC.len() && MAGIC.starts_with(bytes) {
        // Just made, or killed while it was being made.
        reading.damage.torn_bytes = bytes.len() as u64;
        return Some(reading.finish());
    }
    let (head, body) = bytes.split_at_checked(MAGIC.len())?;
    let mut at = 0;
    while let Some(found) = body.get(at..).and_then(mark) {
        reading.skip(at, at + found);
        at += found;
        let end = body.get(at + HEAD..).and_then(mark).map_or(body.len(), |n| at + HEAD + n);
        let segment = body.get(at..end).unwrap_or_default();
        match Raw::read(segment) {
            Some(raw) => {
                let bytes = raw.bytes;
                reading.take(raw);
                at += bytes;
            }
            None if end == body.len() && Raw::is_torn(segment) => {
                reading.damage.torn_bytes = segment.len() as u64;
                at = end;
            }
            None => {
                // The rest of the segment may contain a mark that its header hides.
                let next = body.get(at + 1..end).and_then(mark).map_or(end, |n| at + 1 + n);
                reading.skip(at, next);
                at = next;
            }
        }
    }
    match body.get(at..) {
        // A write that ended within the mark.
        Some(tail) if !tail.is_empty() && MARK.starts_with(tail) => {
            reading.damage.torn_bytes = tail.len() as u64;
        }
        _ => reading.skip(at, body.len()),
    }
    if head != MAGIC {
        if reading.records.is_empty() {
            return None;
        }
        reading.damage.lost.insert(0, "the first line of the journal is damaged".into());
    }
    Some(reading.finish())
}

fn mark(bytes: &[u8]) -> Option<usize> {
    let mut from = 0;
    loop {
        let at = from + bytes.get(from..)?.iter().position(|b| *b == MARK[0])?;
        if bytes.get(at..)?.starts_with(&MARK) {
            return Some(at);
        }
        from = at + 1;
    }
}

/// One whole record.
struct Raw {
    number: u32,
    done: u32,
    before: Kind,
    record: Record,
    bytes: usize,
}

impl Raw {
    fn read(segment: &[u8]) -> Option<Raw> {
        let word = |at: usize| -> Option<u32> {
            Some(u32::from_le_bytes(segment.get(at..at + 4)?.try_into().ok()?))
        };
        let len = word(4)? as usize;
        if len > limits::JOURNAL_RECORD_BYTES {
            return None;
        }
        let covered = segment.get(COVERED..HEAD + len)?;
        if crc32fast::hash(covered) != word(8)? {
            return None;
        }
        let json = segment.get(HEAD..HEAD + len)?;
        Some(Raw {
            number: word(12)?,
            done: word(16)?,
            before: Kind::from_byte(*segment.get(20)?)?,
            record: serde_json::from_slice(json).ok()?,
            bytes: HEAD + len,
        })
    }

    /// Whether these last bytes of a file are shorter than their header says. That is an unfinished
    /// write rather than damage.
    fn is_torn(segment: &[u8]) -> bool {
        let len = segment.get(4..8).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
        len.is_none_or(|len| {
            len as usize <= limits::JOURNAL_RECORD_BYTES && segment.len() < HEAD + len as usize
        })
    }
}

const BASE: &str = "the saved text is damaged";

const COPY: &str = "one of the two copies of the saved text is damaged";

/// Records in the order of the file, and placeholders for missing ones.
#[derive(Default)]
struct Reading {
    records: Vec<Record>,
    position: Position,
    damage: Damage,
    /// Bytes before the next record that belong to no record.
    skipped: usize,
    /// The number of records that may still be missing: at most as many as the file has bytes for.
    /// Without this limit a forged number would ask for four thousand million placeholders.
    room: u32,
}

impl Reading {
    fn skip(&mut self, from: usize, to: usize) {
        self.skipped += to - from;
    }

    fn take(&mut self, raw: Raw) {
        let kind = Kind::of(&raw.record);
        let missing = raw.number.saturating_sub(self.position.number.max(1));
        let Some(room) = self.room.checked_sub(missing) else {
            self.skipped += raw.bytes;
            return;
        };
        self.room = room;
        let skipped = std::mem::take(&mut self.skipped);
        if skipped > 0 && missing == 0 {
            self.damage.lost.push(match self.position.number {
                0 | 1 if self.records.len() == 1 || kind == Kind::Base => COPY.to_owned(),
                0 => BASE.to_owned(),
                n => format!("{skipped} bytes after record {n} are damaged"),
            });
        }
        match kind {
            // The second copy of the base; one copy is enough.
            Kind::Base if self.position.number > 0 => return,
            Kind::Base => {}
            _ => self.fill(&raw, kind, missing),
        }
        self.position = self.position.after(kind);
        self.records.push(raw.record);
    }

    /// Adds placeholders for the records that are missing before this one, as far as their number
    /// is known.
    fn fill(&mut self, raw: &Raw, kind: Kind, missing: u32) {
        self.position.number = self.position.number.max(1);
        let before = match kind {
            Kind::Edit | Kind::Redo => raw.done.saturating_sub(1),
            Kind::Undo => raw.done.saturating_add(1),
            _ => raw.done,
        };
        let known = (missing == 1).then_some(raw.before);
        for _ in 0..missing {
            let number = self.position.number;
            let stand_in = match (known, before.cmp(&self.position.done)) {
                (Some(Kind::Undo), _) | (None, std::cmp::Ordering::Less) => Record::Undo,
                (Some(Kind::Redo), _) => Record::Redo,
                (Some(Kind::Edit), _) | (None, std::cmp::Ordering::Greater) => {
                    self.damage.lost.push(format!("edit {number} is damaged and lost"));
                    let label = "Lost: its record was damaged".to_owned();
                    Record::Edit { label, patch: Box::new(Delta::default()) }
                }
                (Some(_), _) | (None, std::cmp::Ordering::Equal) => Record::Opened,
            };
            if !matches!(stand_in, Record::Edit { .. }) {
                let what = "is damaged; what it did follows from its neighbours";
                self.damage.lost.push(format!("record {number} {what}"));
            }
            self.position = self.position.after(Kind::of(&stand_in));
            self.records.push(stand_in);
        }
    }

    fn finish(mut self) -> Scan {
        if self.skipped > 0 {
            let number = self.position.number;
            self.damage.lost.push(match number {
                0 => BASE.to_owned(),
                1 => format!("{COPY}, or the edit after it"),
                n => format!("edit {n}, the last one, is damaged and lost"),
            });
        }
        Scan { records: self.records, damage: self.damage, position: self.position }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fifty steps: edits, and every kind of step back and forth among them.
    fn fifty() -> Vec<Record> {
        let mut all = vec![Record::Base { text: "{\"a\": 1}".into(), path: None }];
        for n in 0..50_u32 {
            all.push(match n % 10 {
                4 | 5 => Record::Undo,
                6 => Record::Redo,
                9 => Record::Closed,
                _ => {
                    let patch = Delta { name: Some(format!("n{n}")), ..Delta::default() };
                    Record::Edit { label: "Rename".into(), patch: Box::new(patch) }
                }
            });
        }
        all
    }

    fn written(records: &[Record]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        let mut position = Position::default();
        for record in records {
            position.encode(record, &mut bytes).unwrap();
        }
        bytes
    }

    /// All records but this one, with one in its place that changes nothing.
    fn only_one_differs(found: &[Record], whole: &[Record]) -> bool {
        let differing: Vec<_> = found.iter().zip(whole).filter(|(a, b)| a != b).collect();
        match differing.as_slice() {
            [] => found.len() + 1 >= whole.len(),
            [(Record::Edit { patch, .. }, Record::Edit { .. })] => {
                patch.is_empty() && found.len() == whole.len()
            }
            [(Record::Opened, Record::Closed)] => found.len() == whole.len(),
            _ => false,
        }
    }

    #[test]
    fn every_flipped_bit_costs_one_record_and_is_told() {
        let records = fifty();
        let whole = written(&records);
        assert_eq!(scan(&whole).unwrap().records, records);
        for at in 0..whole.len() {
            for bit in 0..8 {
                let mut bad = whole.clone();
                bad[at] ^= 1 << bit;
                let found = scan(&bad).unwrap();
                assert!(only_one_differs(&found.records, &records), "bit {bit} of byte {at}");
                assert_ne!(found.damage, Damage::default(), "bit {bit} of byte {at} is not told");
            }
        }
    }

    #[test]
    fn every_cut_leaves_what_was_whole() {
        let records = fifty();
        let whole = written(&records);
        let mut longest = 0;
        for end in 0..whole.len() {
            let Scan { records: found, damage, .. } = scan(&whole[..end]).unwrap();
            assert!(records.starts_with(&found), "cut at {end}");
            assert!(found.len() >= longest, "cut at {end}");
            longest = found.len();
            assert!(damage.lost.is_empty(), "cut at {end}: {damage:?}");
            // What is whole and nothing more: the next record is appended there.
            let good = end - damage.torn_bytes as usize;
            assert!(end == 0 || good == 0 || scan(&whole[..good]).unwrap().damage.torn_bytes == 0);
        }
        assert_eq!(longest, records.len() - 1);
    }

    #[test]
    fn several_damaged_records_leave_the_history_in_step() {
        let records = fifty();
        let mut bytes = MAGIC.to_vec();
        let mut position = Position::default();
        for (n, record) in records.iter().enumerate() {
            let from = bytes.len();
            position.encode(record, &mut bytes).unwrap();
            if (11..=13).contains(&n) || n == 30 {
                bytes[from + HEAD + 2] ^= 1;
            }
        }
        let found = scan(&bytes).unwrap();
        assert_eq!(found.position, position);
        assert_eq!(found.damage.lost.len(), 4);
    }

    #[test]
    fn a_record_has_a_limit_of_bytes() {
        let base = |bytes: usize| Record::Base { text: "x".repeat(bytes), path: None };
        let around = serde_json::to_vec(&base(0)).unwrap().len();
        let most = limits::JOURNAL_RECORD_BYTES - around;
        let mut out = Vec::new();
        assert!(Position::default().encode(&base(most + 1), &mut out).is_err());
        assert!(out.is_empty(), "nothing of it is written");
        Position::default().encode(&base(most), &mut out).unwrap();
        let whole = [MAGIC, &out].concat();
        assert_eq!(scan(&whole).unwrap().records, [base(most)]);
    }

    #[test]
    fn a_forged_number_does_not_ask_for_thousands_of_millions_of_records() {
        let mut bytes = written(&fifty());
        let mut forged = Position { number: u32::MAX - 1, done: 3, last: Kind::Edit };
        forged.encode(&Record::Undo, &mut bytes).unwrap();
        let found = scan(&bytes).unwrap();
        assert_eq!(found.records, fifty());
        assert_ne!(found.damage, Damage::default());
    }

    #[test]
    fn other_files_are_none_of_ours_and_marks_alone_cost_no_time() {
        for text in ["precious, and longer than a line", "{\"format\": \"robert-clip/1\"}", "\0"] {
            assert_eq!(scan(text.as_bytes()), None);
        }
        // Every mark claims a record that reaches to the end.
        let claim = [&MARK[..], &(40_u32 << 20).to_le_bytes(), &[0; 13]].concat();
        let hostile = [MAGIC, &claim.repeat(1 << 20)].concat();
        assert!(scan(&hostile).unwrap().records.is_empty());
    }

    /// Fifty thousand damaged journals in a normal run, or as many as `ROBERT_FUZZ` says.
    #[test]
    fn any_bytes_are_read_or_refused() {
        use robert_base::rng::{Rng, Stream};
        let number = |name| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
        let asked = number("ROBERT_FUZZ");
        let (rounds, first) = (asked.unwrap_or(50_000), number("ROBERT_FUZZ_FROM").unwrap_or(0));
        let whole = written(&fifty()[..12]);
        let begin = std::time::Instant::now();
        let (mut read, mut records) = (0, 0);
        for round in first..first + rounds {
            let rng = &mut Rng::new(31, Stream::Test, round);
            let mut bytes = whole.clone();
            for _ in 0..=rng.below(5) {
                let at = rng.below(bytes.len() as u64 + 1) as usize;
                let end = (at + rng.below(40) as usize).min(bytes.len());
                match rng.below(6) {
                    0 if at < bytes.len() => bytes[at] ^= 1 << rng.below(8),
                    1 if at < bytes.len() => bytes[at] = rng.below(256) as u8,
                    2 => drop(bytes.drain(at..end)),
                    3 => drop(bytes.splice(at..at, MARK)),
                    4 => {
                        let piece = bytes[at..end].to_vec();
                        let to = rng.below(bytes.len() as u64 + 1) as usize;
                        bytes.splice(to..to, piece);
                    }
                    _ => bytes[at..end].fill(if rng.below(2) == 0 { 0 } else { 0xff }),
                }
            }
            if let Some(found) = scan(&bytes) {
                assert!(found.records.len() <= 4 * 12 + bytes.len() / HEAD, "round {round}");
                read += 1;
                records += found.records.len();
            }
        }
        assert!(read > rounds / 2 && records as u64 > read, "{read} read, {records} records");
        if asked.is_some() {
            println!(
                "journal: {rounds} inputs, {read} taken, {:.0} s",
                begin.elapsed().as_secs_f64()
            );
        }
    }
}
