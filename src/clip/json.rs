//! A JSON reader that knows the place of every value.
//!
//! `serde_json::Value` has no positions, `serde`'s line and column point at the end of the value,
//! and a check across fields ("this key is beyond `length`") has no position at all. So the clip is
//! read by pulling values from this cursor, each at a known byte, and later checks name a JSON
//! pointer that [`locate`](super::place::locate) finds again in the text. Reading builds no tree, so a 16 MiB file of
//! `[0,0,0…` needs only the memory of the clip.

use std::collections::BTreeSet;

use serde_json::{Map, Number, Value};

use robert_base::limits;

/// The problem, and its byte offset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) at: usize,
    pub(crate) message: String,
}

pub(crate) type Read<T> = Result<T, Fault>;

/// The kind of the value at the cursor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Object,
    Array,
    String,
    Number,
    Bool,
    Null,
    Other,
}

impl Kind {
    fn noun(self) -> &'static str {
        match self {
            Kind::Object => "an object",
            Kind::Array => "an array",
            Kind::String => "a string",
            Kind::Number => "a number",
            Kind::Bool => "true or false",
            Kind::Null => "null",
            Kind::Other => "something that is not JSON",
        }
    }
}

/// The cursor.
#[derive(Debug)]
pub(crate) struct Reader<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(text: &'a str) -> Self {
        Reader { text, at: 0, depth: 0 }
    }

    /// The byte at which the next value starts.
    pub(crate) fn here(&mut self) -> usize {
        self.space();
        self.at
    }

    #[allow(clippy::unused_self)] // reads as what it is: the reader faults here
    pub(crate) fn fault<T>(&self, at: usize, message: impl Into<String>) -> Read<T> {
        Err(Fault { at, message: message.into() })
    }

    fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    fn space(&mut self) {
        while matches!(self.peek(), Some(b' ' | b'\t' | b'\n' | b'\r')) {
            self.at += 1;
        }
    }

    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or_default()
    }

    /// Looks at the next value without taking it.
    pub(crate) fn kind(&mut self) -> Kind {
        self.space();
        match self.peek() {
            Some(b'{') => Kind::Object,
            Some(b'[') => Kind::Array,
            Some(b'"') => Kind::String,
            Some(b'-' | b'0'..=b'9') => Kind::Number,
            Some(b't' | b'f') => Kind::Bool,
            Some(b'n') => Kind::Null,
            _ => Kind::Other,
        }
    }

    fn expected<T>(&mut self, what: &str) -> Read<T> {
        let kind = self.kind();
        let at = self.at;
        if self.peek().is_none() {
            return self.fault(at, format!("expected {what}, but the file ends here"));
        }
        if kind != Kind::Other {
            return self.fault(at, format!("expected {what}, found {}", kind.noun()));
        }
        let rest = self.rest();
        for (token, hint) in [
            ("NaN", "NaN is not a value; write null for a joint without a goal"),
            ("Infinity", "infinity is not a value"),
            ("nan", "nan is not a value; write null for a joint without a goal"),
            ("inf", "infinity is not a value"),
            ("//", "JSON has no comments; use `notes` or `note`"),
            ("/*", "JSON has no comments; use `notes` or `note`"),
            ("'", "strings need double quotes"),
            ("+", "numbers have no plus sign"),
            (".", "a number needs a digit before the point"),
        ] {
            if rest.starts_with(token) {
                return self.fault(at, format!("expected {what}: {hint}"));
            }
        }
        let c = rest.chars().next().unwrap_or(' ');
        self.fault(at, format!("expected {what}, found {c:?}"))
    }

    fn enter(&mut self) -> Read<()> {
        self.depth += 1;
        if self.depth > limits::JSON_DEPTH {
            let at = self.at;
            return self.fault(at, format!("nested more than {} levels deep", limits::JSON_DEPTH));
        }
        self.at += 1;
        Ok(())
    }

    /// After an element: true for `,`, false for `close`.
    fn more(&mut self, close: u8) -> Read<bool> {
        self.space();
        match self.peek() {
            Some(b',') => {
                self.at += 1;
                self.space();
                if self.peek() == Some(close) {
                    return self.fault(self.at, "remove the comma before the end");
                }
                Ok(true)
            }
            Some(c) if c == close => Ok(false),
            Some(_) => {
                let c = self.rest().chars().next().unwrap_or(' ');
                self.fault(self.at, format!("expected ',' or '{}', found {c:?}", close as char))
            }
            None => self.fault(
                self.at,
                format!("expected ',' or '{}', but the file ends here", close as char),
            ),
        }
    }

    /// Reads an object; `each` gets every key with its byte and must take the value.
    /// A key that appears twice is an error.
    pub(crate) fn object(
        &mut self,
        what: &str,
        mut each: impl FnMut(&mut Self, String, usize) -> Read<()>,
    ) -> Read<()> {
        if self.kind() != Kind::Object {
            return self.expected(what);
        }
        self.enter()?;
        let mut seen = BTreeSet::new();
        self.space();
        if self.peek() != Some(b'}') {
            loop {
                self.space();
                let at = self.at;
                if self.peek() != Some(b'"') {
                    return self.expected("a key in double quotes");
                }
                let key = self.string("a key in double quotes")?;
                if seen.contains(&key) {
                    return self.fault(at, format!("`{}` appears twice", show(&key)));
                }
                seen.insert(key.clone());
                self.space();
                if self.peek() != Some(b':') {
                    return self.expected("':'");
                }
                self.at += 1;
                each(self, key, at)?;
                if !self.more(b'}')? {
                    break;
                }
            }
        }
        self.at += 1;
        self.depth -= 1;
        Ok(())
    }

    /// Reads an array; `each` gets every index and must take the value.
    pub(crate) fn array(
        &mut self,
        what: &str,
        mut each: impl FnMut(&mut Self, usize) -> Read<()>,
    ) -> Read<()> {
        if self.kind() != Kind::Array {
            return self.expected(what);
        }
        self.enter()?;
        self.space();
        if self.peek() != Some(b']') {
            let mut i = 0;
            loop {
                each(self, i)?;
                i += 1;
                if !self.more(b']')? {
                    break;
                }
            }
        }
        self.at += 1;
        self.depth -= 1;
        Ok(())
    }

    pub(crate) fn string(&mut self, what: &str) -> Read<String> {
        if self.kind() != Kind::String {
            return self.expected(what);
        }
        let open = self.at;
        self.at += 1;
        let mut out = String::new();
        loop {
            let rest = self.rest();
            let stop = rest.bytes().position(|b| b == b'"' || b == b'\\' || b < 0x20);
            let Some(stop) = stop else {
                return self.fault(open, "this string is never closed");
            };
            out.push_str(rest.get(..stop).unwrap_or_default());
            self.at += stop;
            match self.peek() {
                Some(b'"') => {
                    self.at += 1;
                    return Ok(out);
                }
                Some(b'\\') => out.push(self.escape()?),
                _ => {
                    return self.fault(
                        self.at,
                        "a control character (such as a line break) in a string; escape it",
                    );
                }
            }
        }
    }

    fn escape(&mut self) -> Read<char> {
        let at = self.at;
        let kind = self.text.as_bytes().get(at + 1).copied();
        self.at += 2;
        Ok(match kind {
            Some(b'"') => '"',
            Some(b'\\') => '\\',
            Some(b'/') => '/',
            Some(b'b') => '\u{8}',
            Some(b'f') => '\u{c}',
            Some(b'n') => '\n',
            Some(b'r') => '\r',
            Some(b't') => '\t',
            Some(b'u') => return self.unicode(at),
            _ => return self.fault(at, "unknown escape in a string"),
        })
    }

    fn unicode(&mut self, at: usize) -> Read<char> {
        let high = self.hex4(at)?;
        let code = if (0xD800..0xDC00).contains(&high) {
            if !self.rest().starts_with("\\u") {
                return self.fault(at, "this string contains half a surrogate pair");
            }
            self.at += 2;
            let low = self.hex4(at)?;
            if !(0xDC00..0xE000).contains(&low) {
                return self.fault(at, "this string contains half a surrogate pair");
            }
            0x1_0000 + ((high - 0xD800) << 10) + (low - 0xDC00)
        } else {
            high
        };
        match char::from_u32(code) {
            Some(c) => Ok(c),
            None => self.fault(at, "this string contains half a surrogate pair"),
        }
    }

    fn hex4(&mut self, at: usize) -> Read<u32> {
        let digits = self.text.get(self.at..self.at + 4).unwrap_or_default();
        let ok = digits.len() == 4 && digits.bytes().all(|b| b.is_ascii_hexdigit());
        match (ok, u32::from_str_radix(digits, 16)) {
            (true, Ok(code)) => {
                self.at += 4;
                Ok(code)
            }
            _ => self.fault(at, "\\u needs four hex digits"),
        }
    }

    /// The text of a number, grammar checked, and whether it is written as an integer.
    fn number_text(&mut self, what: &str) -> Read<(&'a str, bool)> {
        if self.kind() != Kind::Number {
            return self.expected(what);
        }
        let start = self.at;
        if self.peek() == Some(b'-') {
            self.at += 1;
        }
        let first = self.at;
        if self.digits() == 0 {
            if self.rest().starts_with("Inf") || self.rest().starts_with("inf") {
                return self.fault(start, "infinity is not a value");
            }
            return self.fault(start, "a number must follow the minus sign");
        }
        if self.at - first > 1 && self.text.as_bytes().get(first) == Some(&b'0') {
            return self.fault(start, "a number must not begin with a zero");
        }
        let mut whole = true;
        if self.peek() == Some(b'.') {
            whole = false;
            self.at += 1;
            if self.digits() == 0 {
                return self.fault(start, "a number needs a digit after the point");
            }
        }
        if matches!(self.peek(), Some(b'e' | b'E')) {
            whole = false;
            self.at += 1;
            if matches!(self.peek(), Some(b'+' | b'-')) {
                self.at += 1;
            }
            if self.digits() == 0 {
                return self.fault(start, "a number needs a digit after the exponent sign");
            }
        }
        Ok((self.text.get(start..self.at).unwrap_or_default(), whole))
    }

    fn digits(&mut self) -> usize {
        let from = self.at;
        while matches!(self.peek(), Some(b'0'..=b'9')) {
            self.at += 1;
        }
        self.at - from
    }

    /// A finite double.
    pub(crate) fn number(&mut self, what: &str) -> Read<f64> {
        let at = self.here();
        let (text, _) = self.number_text(what)?;
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => self.fault(at, format!("{} is too large for a number", show(text))),
        }
    }

    /// A whole number of `lo..=hi`.
    pub(crate) fn integer(&mut self, what: &str, lo: u32, hi: u32) -> Read<u32> {
        let at = self.here();
        let (text, whole) = self.number_text(what)?;
        if !whole {
            return self.fault(at, format!("{what} must be a whole number, not {}", show(text)));
        }
        match text.parse::<i64>() {
            Ok(v) if v >= i64::from(lo) && v <= i64::from(hi) => Ok(v as u32),
            _ if lo == hi => self.fault(at, format!("{what} must be {lo}, not {}", show(text))),
            _ => self.fault(at, format!("{what} must be {lo} to {hi}, not {}", show(text))),
        }
    }

    /// True, and taken, when the next value is `null`.
    pub(crate) fn null(&mut self) -> Read<bool> {
        if self.kind() != Kind::Null {
            return Ok(false);
        }
        self.word("null")?;
        Ok(true)
    }

    fn word(&mut self, word: &str) -> Read<()> {
        let tail = self.rest().strip_prefix(word);
        let ends = tail.is_some_and(|t| !t.starts_with(|c: char| c.is_alphanumeric() || c == '_'));
        if !ends {
            return self.fault(self.at, format!("expected {word}"));
        }
        self.at += word.len();
        Ok(())
    }

    /// Any value, at most `budget` of them counted through all levels.
    pub(crate) fn value(&mut self, budget: &mut usize) -> Read<Value> {
        let kind = self.kind();
        let at = self.at;
        let Some(left) = budget.checked_sub(1) else {
            let cap = limits::CLIP_EXTRA_VALUES;
            return self.fault(at, format!("more than {cap} values under `x`"));
        };
        *budget = left;
        Ok(match kind {
            Kind::Object => {
                let mut map = Map::new();
                self.object("an object", |r, key, _| {
                    map.insert(key, r.value(budget)?);
                    Ok(())
                })?;
                Value::Object(map)
            }
            Kind::Array => {
                let mut items = Vec::new();
                self.array("an array", |r, _| {
                    items.push(r.value(budget)?);
                    Ok(())
                })?;
                Value::Array(items)
            }
            Kind::String => Value::String(self.string("a string")?),
            Kind::Number => {
                let (text, whole) = self.number_text("a number")?;
                let int = whole
                    .then(|| {
                        let i = text.parse::<i64>().ok().filter(|_| text != "-0").map(Number::from);
                        i.or_else(|| text.parse::<u64>().ok().map(Number::from))
                    })
                    .flatten();
                let real = || text.parse::<f64>().ok().and_then(Number::from_f64);
                match int.or_else(real) {
                    Some(n) => Value::Number(n),
                    None => {
                        return self.fault(at, format!("{} is too large for a number", show(text)));
                    }
                }
            }
            Kind::Bool => {
                let yes = self.peek() == Some(b't');
                self.word(if yes { "true" } else { "false" })?;
                Value::Bool(yes)
            }
            Kind::Null => {
                self.word("null")?;
                Value::Null
            }
            Kind::Other => return self.expected("a value"),
        })
    }

    /// Steps over any value.
    pub(crate) fn skip(&mut self) -> Read<()> {
        match self.kind() {
            Kind::Object => self.object("an object", |r, _, _| r.skip()),
            Kind::Array => self.array("an array", |r, _| r.skip()),
            Kind::String => self.string("a string").map(drop),
            Kind::Number => self.number_text("a number").map(drop),
            _ => self.value(&mut 1).map(drop),
        }
    }

    /// Only white space may follow.
    pub(crate) fn end(&mut self) -> Read<()> {
        self.space();
        if self.peek().is_some() {
            return self.fault(self.at, "there is text after the end of the document");
        }
        Ok(())
    }
}

/// A foreign string made safe and short for a message.
pub(crate) fn show(text: &str) -> String {
    const QUOTED: usize = 48;
    let mut out: String = text.chars().take(QUOTED).flat_map(char::escape_debug).collect();
    if text.chars().nth(QUOTED).is_some() {
        out.push('…');
    }
    out
}

/// One step of a JSON pointer.
pub(crate) fn escape_step(step: &str) -> String {
    step.replace('~', "~0").replace('/', "~1")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Read<Value> {
        let mut r = Reader::new(text);
        let v = r.value(&mut 1000)?;
        r.end()?;
        Ok(v)
    }

    #[test]
    fn agrees_with_serde_json() {
        let cases = [
            "null",
            "true",
            "false",
            "0",
            "-0",
            "-0.5e-3",
            "1E+3",
            "18446744073709551615",
            "-9223372036854775808",
            "123456789012345678901234567890",
            "\"\"",
            "\"a\\u00e9\\n\"",
            "\"\\ud83d\\ude00\"",
            "[]",
            "[1,[2,{}]]",
            "{\"a\":{\"b\":[null]},\"c\":\"/\\/\"}",
            " [ 1 , 2 ] ",
            "01",
            "1.",
            ".5",
            "+1",
            "-",
            "1e",
            "[1,]",
            "[,1]",
            "{\"a\"}",
            "{,}",
            "tru",
            "truex",
            "nul",
            "\"",
            "\"\\x\"",
            "\"\\ud83d\"",
            "\"\\ud83dx\"",
            "\"\n\"",
            "[1 2]",
            "1e999",
            "NaN",
            "{\"a\":1}}",
            "",
            "// x",
        ];
        for case in cases {
            let theirs = serde_json::from_str::<Value>(case);
            let ours = value(case);
            assert_eq!(ours.is_ok(), theirs.is_ok(), "{case}: {ours:?} {theirs:?}");
            if let (Ok(a), Ok(b)) = (ours, theirs) {
                assert_eq!(a, b, "{case}");
            }
        }
    }

    #[test]
    fn depth_is_capped_exactly() {
        let nest = |n: usize| format!("{}{}", "[".repeat(n), "]".repeat(n));
        assert!(value(&nest(limits::JSON_DEPTH)).is_ok());
        let fault = value(&nest(limits::JSON_DEPTH + 1)).unwrap_err();
        assert_eq!(fault.at, limits::JSON_DEPTH);
        assert!(value(&"[".repeat(1_000_000)).is_err());
    }

    #[test]
    fn duplicates_are_refused() {
        assert_eq!(value("{\"a\":1,\"a\":2}").unwrap_err().at, 7);
    }
}
