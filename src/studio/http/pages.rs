//! The files for the browser: our page, and the viser client.
//!
//! Both are built or fetched by `script/bootstrap` and embedded; neither is in the repository. If
//! the page is missing, a plain page says so. If the client is missing, the viewport shows stills.

use axum::http::{StatusCode, Uri, header};
use axum::response::{Html, IntoResponse, Response};
use rust_embed::RustEmbed;

#[derive(RustEmbed)]
#[folder = "page"]
#[allow_missing = true]
struct Bundle;

#[derive(RustEmbed)]
#[folder = "vendor/viser"]
#[allow_missing = true]
struct Viser;

/// The start page if the bundle is missing. No script: there is nothing to run.
const BARE: &str = r#"<!doctype html>
<html lang="en"><meta charset="utf-8"><title>RoBERT Studio</title>
<body><h1>RoBERT Studio</h1>
<p>The server runs, but this build has no user interface in it.</p>
<p>Run <code>script/bootstrap</code> in the source folder (it needs Node and npm), then
<code>cargo build --release</code>, and start <code>robert studio</code> again.</p>
<p>Scripts can use the interface under <code>/api/</code> right now.</p></body></html>
"#;

/// `/`.
pub(crate) async fn index() -> Response {
    match Bundle::get("index.html") {
        Some(file) => Html(file.data.into_owned()).into_response(),
        None => Html(BARE).into_response(),
    }
}

/// `/ui/...`: files of the bundle.
pub(crate) async fn bundle(uri: Uri) -> Response {
    let name = uri.path().trim_start_matches("/ui/");
    let Some(file) = Bundle::get(name) else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let headers = [(header::CONTENT_TYPE, media_type(name)), (header::CACHE_CONTROL, "no-cache")];
    (headers, file.data.into_owned()).into_response()
}

/// `/viser/`: the client's one page.
pub(crate) fn viser() -> Response {
    match Viser::get("index.html") {
        Some(file) => Html(file.data.into_owned()).into_response(),
        None => (
            StatusCode::NOT_FOUND,
            "the 3D client is not in this build; run script/bootstrap and build again\n",
        )
            .into_response(),
    }
}

/// Whether the user interface is in this build.
pub fn has_page() -> bool {
    Bundle::get("index.html").is_some()
}

/// Whether the viser client is in this build.
pub fn has_viser() -> bool {
    Viser::get("index.html").is_some()
}

fn media_type(name: &str) -> &'static str {
    match name.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" | "map" | "webmanifest" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "ico" => "image/x-icon",
        "woff2" => "font/woff2",
        "txt" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}
