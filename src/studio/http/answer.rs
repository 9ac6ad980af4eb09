//! Answers of handlers: JSON with refusals, whole bodies, downloads.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::protocol::{Code, Error, ErrorBody};
use crate::state::App;

/// A refusal as a response.
#[derive(Debug)]
pub(crate) struct Refused(ErrorBody);

impl From<Error> for Refused {
    fn from(e: Error) -> Refused {
        Refused(ErrorBody::from(&e))
    }
}

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.0.status());
        (status.unwrap_or(StatusCode::INTERNAL_SERVER_ERROR), axum::Json(self.0)).into_response()
    }
}

/// JSON bodies and answers; a body that cannot be read is refused in the form of [`ErrorBody`].
#[derive(Debug)]
pub(crate) struct Json<T>(pub T);

impl<T: Serialize> IntoResponse for Json<T> {
    fn into_response(self) -> Response {
        axum::Json(self.0).into_response()
    }
}

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Response;

    async fn from_request(request: axum::extract::Request, state: &S) -> Result<Self, Response> {
        match axum::Json::<T>::from_request(request, state).await {
            Ok(axum::Json(body)) => Ok(Json(body)),
            Err(e) => {
                let large = e.status() == StatusCode::PAYLOAD_TOO_LARGE;
                let code = if large { Code::TooLarge } else { Code::Request };
                let body = ErrorBody::new(code, e.body_text());
                Err((e.status(), axum::Json(body)).into_response())
            }
        }
    }
}

/// Queries, with our refusals.
#[derive(Debug)]
pub(crate) struct Query<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Refused;

    async fn from_request_parts(head: &mut Parts, state: &S) -> Result<Self, Refused> {
        match axum::extract::Query::<T>::from_request_parts(head, state).await {
            Ok(axum::extract::Query(query)) => Ok(Query(query)),
            Err(e) => Err(Refused(ErrorBody::new(Code::Request, e.body_text()))),
        }
    }
}

pub(crate) type Answer<T> = Result<Json<T>, Refused>;

pub(crate) type Shared = State<Arc<App>>;

pub(crate) async fn whole_body(
    request: axum::extract::Request,
    cap: usize,
) -> Result<Bytes, Refused> {
    let body = axum::body::to_bytes(request.into_body(), cap).await;
    body.map_err(|_too_large| Refused::from(Error::TooLarge { cap }))
}

pub(crate) fn text_of(bytes: &[u8]) -> Result<String, Refused> {
    // The reader of files says where bytes stop being text; here the text is enough.
    String::from_utf8(bytes.to_vec()).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        Refused(ErrorBody::new(Code::Invalid, format!("byte {at} is not UTF-8 text")))
    })
}

/// A byte of a file's name as RFC 8187 writes it.
fn percent(byte: u8) -> String {
    if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
        char::from(byte).to_string()
    } else {
        format!("%{byte:02X}")
    }
}

pub(crate) fn download(name: &str, media_type: &'static str, bytes: Vec<u8>) -> Response {
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
    let plain: String = name.chars().filter(|c| !matches!(c, '"' | '\\') && c.is_ascii()).collect();
    let whole: String = name.bytes().map(percent).collect();
    let value = format!("attachment; filename=\"{plain}\"; filename*=UTF-8''{whole}");
    if let Ok(value) = value.parse() {
        headers.insert(header::CONTENT_DISPOSITION, value);
    }
    (headers, bytes).into_response()
}

/// Does work that waits for the disk on a thread where it delays nothing else. `what` names the
/// work if it panics.
pub(crate) async fn apart<T: Send + 'static>(
    what: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Error> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|panicked| Error::Server(std::io::Error::other(format!("{what}: {panicked}"))))
}
