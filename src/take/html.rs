//! A page that plays a take in any browser: the viser client with the recording inside.

use super::document::Take;
use super::error::Error;
use robert_base::units::{Unit, significant};

/// The style of the box with title and caption.
const CAPTION_STYLE: &str = "position:fixed;left:12px;top:12px;z-index:9;padding:6px 10px;\
    border-radius:6px;background:#fffc;color:#18202a;font:13px/1.4 sans-serif;pointer-events:none";

/// The client, if script/bootstrap has fetched it.
#[derive(rust_embed::Embed)]
#[folder = "vendor/viser"]
#[allow_missing = true]
struct Client;

/// The client that was built into this program.
///
/// # Errors
/// [`Error::NoClient`].
pub fn client() -> Result<Vec<u8>, Error> {
    Ok(Client::get("index.html").ok_or(Error::NoClient)?.data.into_owned())
}

/// `client` (the page of the viser client) with a recording that plays as soon as the page opens,
/// and with `title` and `caption` at its upper left edge: the player is below.
///
/// # Errors
/// [`Error::Encode`] when the page has no head to put it in.
pub fn page(client: &[u8], title: &str, caption: &str, recording: &[u8]) -> Result<Vec<u8>, Error> {
    const HEAD: &[u8] = b"</head>";
    let at = client.windows(HEAD.len()).position(|w| w == HEAD).ok_or_else(|| Error::Encode {
        what: "the page",
        problem: "the viser client has no </head>".to_owned(),
    })?;
    let (before, after) = client.split_at(at);
    let mut out = Vec::with_capacity(client.len() + recording.len() * 4 / 3 + 512);
    out.extend_from_slice(before);
    out.extend_from_slice(b"<script>window.__VISER_EMBED_DATA__=\"");
    base64(recording, &mut out);
    out.extend_from_slice(b"\";window.__VISER_EMBED_CONFIG__={darkMode:false};");
    // The client sets the page's title when it starts, so ours is set later.
    let text = |s: &str| serde_json::Value::from(s).to_string().replace('<', "\\u003c");
    let (title, caption) = (text(title), text(caption));
    out.extend_from_slice(
        format!(
            "addEventListener(\"load\",()=>{{document.title={title};\
             const box=document.createElement(\"div\"),name=document.createElement(\"b\"),\
             said=document.createElement(\"div\");\
             name.textContent={title};said.textContent={caption};box.append(name,said);\
             box.style.cssText=\"{CAPTION_STYLE}\";document.body.append(box)}});</script>"
        )
        .as_bytes(),
    );
    out.extend_from_slice(after);
    Ok(out)
}

/// The text below a page's title: the performer, the error, and the content of the picture.
pub fn caption(take: &Take) -> String {
    let figure = match (take.precision().precision, take.robot.units.first()) {
        (Some(error), Some(Unit::M)) => format!("mean error {} mm, ", significant(1e3 * error)),
        (Some(error), _) => format!("mean error {}\u{b0}, ", significant(error.to_degrees())),
        (None, _) => String::new(),
    };
    format!("{}; {figure}solid: reached, translucent: commanded", take.provenance.policy)
}

/// Standard alphabet, padded.
fn base64(bytes: &[u8], out: &mut Vec<u8>) {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for chunk in bytes.chunks(3) {
        let at = |i: usize| u32::from(chunk.get(i).copied().unwrap_or(0));
        let word = at(0) << 16 | at(1) << 8 | at(2);
        for i in 0..4 {
            let digit = (word >> (18 - 6 * i)) as usize & 63;
            let known = i <= chunk.len();
            out.push(if known { ALPHABET[digit] } else { b'=' });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_the_standard_one() {
        for (plain, want) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            let mut out = Vec::new();
            base64(plain.as_bytes(), &mut out);
            assert_eq!(String::from_utf8(out).unwrap(), want);
        }
        let mut out = Vec::new();
        base64(&[0xfb, 0xef, 0xff], &mut out);
        assert_eq!(out, b"++//");
    }

    #[test]
    fn the_recording_stands_in_the_head_and_cannot_leave_it() {
        let page =
            page(b"<html><head></head><body></body></html>", "</script>", "0.04\u{b0}", b"foo")
                .unwrap();
        let text = String::from_utf8(page).unwrap();
        assert!(text.contains("__VISER_EMBED_DATA__=\"Zm9v\""));
        assert_eq!(text.matches("</script>").count(), 1);
        assert!(text.contains("0.04\u{b0}"), "the caption is in it");
        assert!(matches!(super::page(b"no head", "", "", b""), Err(Error::Encode { .. })));
    }
}
