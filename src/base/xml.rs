//! Reads foreign XML: it is counted before any parser sees it, and then read by `roxmltree`.
//!
//! Parsers recurse on nested elements, compare each attribute of an element with all others, and
//! look every name up in all namespaces in scope, so a hostile file can make them slow. One pass
//! over the tags counts all three and needs no memory. Only a text within the limits is parsed.

use roxmltree::{Document, ParsingOptions};

use crate::limits;

/// Why a text was refused. Line and column count from 1.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{line}:{column}: {message}")]
pub struct Error {
    /// The problem, in words.
    pub message: String,
    /// The line.
    pub line: u32,
    /// The column, in characters.
    pub column: u32,
}

impl Error {
    fn at(text: &str, at: usize, message: impl Into<String>) -> Error {
        let before = text.get(..at.min(text.len())).unwrap_or(text);
        let line = before.bytes().filter(|b| *b == b'\n').count() + 1;
        let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
        Error { message: message.into(), line: line as u32, column: column as u32 }
    }
}

/// The numbers in the text of an attribute or element; `None` if a word is not one.
pub fn numbers<T: std::str::FromStr>(text: &str) -> Option<Vec<T>> {
    text.split_whitespace().map(|word| word.parse().ok()).collect()
}

/// The text as it may stand in a comment, where no dash may follow another one.
#[must_use]
pub fn in_comment(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    for c in text.chars() {
        if c == '-' && plain.ends_with('-') {
            plain.push(' ');
        }
        plain.push(c);
    }
    plain
}

/// Parses a document of at most `elements` elements, within the caps on nesting, attributes
/// and namespaces.
///
/// # Errors
/// [`Error`] with the place of the mistake.
pub fn parse(text: &str, elements: usize) -> Result<Document<'_>, Error> {
    count(text)?;
    Document::parse_with_options(text, options(elements)).map_err(|e| {
        let message = match &e {
            roxmltree::Error::DtdDetected => "a DOCTYPE is not supported; remove it".to_owned(),
            roxmltree::Error::NodesLimitReached => format!("more than {elements} elements"),
            roxmltree::Error::UnknownNamespace(ns, _) if ns == "xacro" => XACRO.to_owned(),
            // Our place repeats the parser's own.
            other => other.to_string().replace(&format!(" at {}", other.pos()), ""),
        };
        Error { message, line: e.pos().row.max(1), column: e.pos().col.max(1) }
    })
}

/// The first prefix of a name that the text does not declare, if that is what keeps it from being parsed.
#[must_use]
pub fn undeclared(text: &str, elements: usize) -> Option<String> {
    count(text).ok()?;
    match Document::parse_with_options(text, options(elements)) {
        Err(roxmltree::Error::UnknownNamespace(prefix, _)) => Some(prefix),
        _ => None,
    }
}

/// Elements, texts and comments are all nodes; four per element is generous.
fn options<'a>(elements: usize) -> ParsingOptions<'a> {
    let nodes_limit = u32::try_from(elements.saturating_mul(4)).unwrap_or(u32::MAX);
    ParsingOptions { nodes_limit, ..ParsingOptions::default() }
}

/// The message for a xacro template.
pub const XACRO: &str =
    "this is a xacro template, not a URDF; expand it first: xacro robot.urdf.xacro > robot.urdf";

/// Counts nesting, attributes and namespaces by a scan of the tags.
fn count(text: &str) -> Result<(), Error> {
    let too_many = |at: usize, what: &str, cap: usize| {
        Err(Error::at(text, at, format!("{what}; at most {cap} are read")))
    };
    let (mut at, mut deep, mut namespaces) = (0, 0_usize, 0_usize);
    while let Some(next) = text.get(at..).and_then(|r| r.find('<')) {
        let start = at + next;
        let rest = text.get(start..).unwrap_or_default();
        let skip = |open: &str, close: &str| {
            rest.starts_with(open).then(|| rest.find(close).map_or(rest.len(), |n| n + close.len()))
        };
        if let Some(n) =
            skip("<!--", "-->").or_else(|| skip("<![CDATA[", "]]>")).or_else(|| skip("<?", "?>"))
        {
            at = start + n;
            continue;
        }
        let tag = Tag::scan(rest);
        namespaces += tag.namespaces;
        if tag.attributes > limits::XML_ATTRIBUTES {
            let what = format!("the element has {} attributes", tag.attributes);
            return too_many(start, &what, limits::XML_ATTRIBUTES);
        }
        if namespaces > limits::XML_NAMESPACES {
            let what = format!("the file declares {namespaces} namespaces");
            return too_many(start, &what, limits::XML_NAMESPACES);
        }
        match rest.as_bytes().get(1) {
            Some(b'/') => deep = deep.saturating_sub(1),
            Some(b'!') => {}
            _ if tag.empty => {}
            _ => deep += 1,
        }
        if deep > limits::XML_DEPTH {
            let message = format!("elements are nested more than {} deep", limits::XML_DEPTH);
            return Err(Error::at(text, start, message));
        }
        at = start + tag.bytes;
    }
    Ok(())
}

/// One tag, as far as needed for counting.
struct Tag {
    bytes: usize,
    attributes: usize,
    namespaces: usize,
    /// It ends in `/>`.
    empty: bool,
}

impl Tag {
    /// The tag at the beginning of `text`. An unclosed tag takes the whole text.
    fn scan(text: &str) -> Tag {
        let bytes = text.as_bytes();
        let mut tag = Tag { bytes: 0, attributes: 0, namespaces: 0, empty: false };
        // A '>' inside quotes does not end the tag.
        let mut quote = None;
        let mut word = 1;
        for (at, &b) in bytes.iter().enumerate() {
            tag.bytes = at + 1;
            match (quote, b) {
                (None, b'>') => {
                    tag.empty = at > 0 && bytes.get(at - 1) == Some(&b'/');
                    break;
                }
                (None, b'"' | b'\'') => quote = Some(b),
                (None, b'=') => {
                    tag.attributes += 1;
                    let name = bytes.get(word..at).unwrap_or_default().trim_ascii_start();
                    tag.namespaces += usize::from(name.starts_with(b"xmlns"));
                    word = at + 1;
                }
                (None, b) if b.is_ascii_whitespace() => {
                    // There may be spaces between a name and its '='.
                    if bytes.get(at + 1).is_some_and(|n| !n.is_ascii_whitespace() && *n != b'=') {
                        word = at + 1;
                    }
                }
                (Some(q), _) if q == b => {
                    quote = None;
                    // The next attribute may follow without a space; the parser reports that.
                    word = at + 1;
                }
                _ => {}
            }
        }
        tag
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_dash_follows_another_in_a_comment() {
        assert_eq!(in_comment("a-b --- c"), "a-b - - - c");
        parse(&format!("<a><!-- {} --></a>", in_comment("--->--")), 9).unwrap();
    }

    fn says(text: &str) -> String {
        parse(text, 100).map_or_else(|e| e.to_string(), |_| "ok".to_owned())
    }

    #[test]
    fn each_cap_holds_at_its_figure_and_refuses_one_more() {
        let nested = |n: usize| format!("{}{}", "<a>".repeat(n), "</a>".repeat(n));
        let wide = |n: usize| {
            let all: Vec<String> = (0..n).map(|i| format!("a{i} = '>='")).collect();
            format!("<a\n{}/>", all.join(" "))
        };
        let spaces = |n: usize| {
            let all: Vec<String> = (0..n).map(|i| format!("<b xmlns:a{i}=\"u\"/>")).collect();
            format!("<a>{}</a>", all.concat())
        };
        let many = |n: usize| format!("<a>{}</a>", "<b/>".repeat(n));
        assert_eq!(says(&nested(limits::XML_DEPTH)), "ok");
        assert_eq!(
            says(&nested(limits::XML_DEPTH + 1)),
            "1:193: elements are nested more than 64 deep"
        );
        assert_eq!(says(&wide(limits::XML_ATTRIBUTES)), "ok");
        assert_eq!(
            says(&wide(limits::XML_ATTRIBUTES + 1)),
            "1:1: the element has 257 attributes; at most 256 are read"
        );
        assert_eq!(says(&spaces(limits::XML_NAMESPACES)), "ok");
        assert_eq!(
            says(&spaces(limits::XML_NAMESPACES + 1)).split_once(": ").unwrap().1,
            "the file declares 65 namespaces; at most 64 are read"
        );
        assert_eq!(says(&many(99)), "ok");
        assert!(says(&many(400)).ends_with("more than 100 elements"));
    }

    #[test]
    fn what_is_no_tag_is_not_counted() {
        let deep = "<a>".repeat(100);
        for text in [
            format!("<a><!-- {deep} --></a>"),
            format!("<a><![CDATA[{deep}]]></a>"),
            format!("<a b=\"{}\"/>", "= ".repeat(1000)),
            format!("<a>{}</a>", "c = d ".repeat(1000)),
        ] {
            assert_eq!(says(&text), "ok", "{text}");
        }
        for text in ["<a", "<a b='", "<!-- ", "<", ""] {
            assert_ne!(says(text), "ok", "{text}");
        }
    }
}
