//! Slips that other readers of model files let pass, and XML does not: `--` in a comment, and no space
//! between two attributes.

use std::borrow::Cow;

/// The text without these slips. Lines stay where they are.
pub(super) fn mended(text: &str) -> Cow<'_, str> {
    let mut out = String::new();
    let mut copied = 0;
    let mut at = 0;
    while let Some(open) = find(text, at, "<") {
        let rest = text.get(open..).unwrap_or_default();
        if rest.starts_with("<!--") {
            let Some(end) = find(text, open + 4, "-->") else { break };
            let inside = text.get(open + 4..end).unwrap_or_default();
            if inside.contains("--") || inside.ends_with('-') {
                out.push_str(text.get(copied..open + 4).unwrap_or_default());
                out.push_str(&inside.replace('-', "="));
                copied = end;
            }
            at = end + 3;
        } else if rest.starts_with("<?") || rest.starts_with("<!") {
            let close = match () {
                () if rest.starts_with("<?") => "?>",
                () if rest.starts_with("<![CDATA[") => "]]>",
                () => ">",
            };
            let Some(end) = find(text, open, close) else { break };
            at = end + close.len();
        } else {
            let mut quote = None;
            let mut last = ' ';
            at = text.len();
            for (i, c) in rest.char_indices() {
                match quote {
                    Some(q) if c == q => quote = None,
                    None if c == '"' || c == '\'' => quote = Some(c),
                    None if c == '>' => {
                        at = open + i + 1;
                        break;
                    }
                    None if matches!(last, '"' | '\'') && (c.is_alphabetic() || c == '_') => {
                        out.push_str(text.get(copied..open + i).unwrap_or_default());
                        out.push(' ');
                        copied = open + i;
                    }
                    _ => {}
                }
                last = c;
            }
        }
    }
    if copied == 0 {
        return Cow::Borrowed(text);
    }
    out.push_str(text.get(copied..).unwrap_or_default());
    Cow::Owned(out)
}

fn find(text: &str, from: usize, what: &str) -> Option<usize> {
    text.get(from..)?.find(what).map(|at| from + at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_that_other_readers_let_pass_are_mended() {
        let text = "<?xml version=\"1.0\"?>\n<a b=\"1\"c='-- \"x\"y'>\n<!-- one -- two --->\n<d e=\"f\"/></a>";
        assert_eq!(
            mended(text),
            "<?xml version=\"1.0\"?>\n<a b=\"1\" c='-- \"x\"y'>\n<!-- one == two =-->\n<d e=\"f\"/></a>"
        );
        let good =
            "<a b=\"1\" c=\"2\"><!-- well-known --><![CDATA[ > <!-- ]]><d e=\"-1\"/><!-- --></a>";
        assert!(matches!(mended(good), Cow::Borrowed(_)));
        assert_eq!(mended("<a b=\"1\"c='2"), "<a b=\"1\" c='2");
    }
}
