//! What a terminal would act on, made visible.
//!
//! Names of joints, clips, robots and files come from foreign files. One of them could clear the
//! screen, or show a line in another order than it has.

/// A text for people, with those characters as `\u{202e}`.
pub(super) fn plain(text: &str) -> String {
    escaped(text, |c| c.escape_unicode().to_string())
}

/// A JSON document, with those characters as `\u202e`: JSON has them in strings only, where that
/// means the same.
pub(super) fn json(text: &str) -> String {
    escaped(text, |c| format!("\\u{:04x}", u32::from(c)))
}

/// Escapes control characters, and those that change the direction of writing.
fn escaped(text: &str, escape: impl Fn(char) -> String) -> String {
    let acts = |c: char| {
        (c.is_control() && c != '\n' && c != '\t')
            || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}')
            || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    text.chars().fold(String::with_capacity(text.len()), |mut out, c| {
        if acts(c) {
            out.push_str(&escape(c));
        } else {
            out.push(c);
        }
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_message_acts_on_the_terminal() {
        let said = "joint \"a\u{202e}b\u{1b}[2Jc\u{9b}\" é 日本\n";
        assert_eq!(plain(said), "joint \"a\\u{202e}b\\u{1b}[2Jc\\u{9b}\" é 日本\n");
        let value = serde_json::json!({"a\u{9b}": ["\u{202e}b\u{1b}[2J", "é"]});
        let text = json(&serde_json::to_string_pretty(&value).unwrap());
        assert!(text.chars().all(|c| c == '\n' || c == 'é' || c.is_ascii_graphic() || c == ' '));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
    }
}
