//! The guard admits requests only from the person who started the studio.
//!
//! A loopback address alone is not safe. Any page in the same browser can send requests to it
//! (simple POSTs and sockets need no permission), a DNS name can be rebound to 127.0.0.1, and other
//! users of the machine reach the port as well. Hence there are three checks on every request, in
//! this order:
//!
//! 1. `Host` is exactly one of `127.0.0.1`, `localhost`, `[::1]` with our port, once (403);
//! 2. `Origin`, where a browser sends one, is `http://` plus that very Host; a request that
//!    the browser calls cross-site is refused unless it opens the start page (403);
//! 3. the token of this run: `Authorization: Bearer`, the cookie that `POST /api/session`
//!    gives for it, or `?token=` on a socket (401). Only the start page and its bundle
//!    are open, as the browser has no token yet; they hold no secret.
//!
//! The started browser gets a one-time code instead of the token, since everybody on the machine
//! can read the arguments of a program.
//!
//! Rejected: treating a request without Origin as safe because no browser sent it (a former hole in
//! Jupyter), and CORS lists (they protect reading, not writing). There is no
//! `Access-Control-Allow-Origin` at all.

use std::io::Read;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use axum::extract::{Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::protocol::{Code, ErrorBody};

/// 256 random bits as 64 hex digits. Never printed by `Debug`.
#[derive(Clone)]
pub(crate) struct Secret(String);

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Secret(..)")
    }
}

impl Secret {
    /// A new secret from the system's generator.
    ///
    /// # Errors
    /// When the system has none.
    pub(crate) fn draw() -> std::io::Result<Secret> {
        let mut bytes = [0_u8; 32];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        Ok(Secret(robert_base::fsio::sha256_hex(&bytes)))
    }

    /// The digits, for the one line that shows them to the user.
    pub(crate) fn reveal(&self) -> &str {
        &self.0
    }

    /// Compares in a time that does not reveal how many digits are right.
    pub(crate) fn matches(&self, other: &str) -> bool {
        let (a, b) = (self.0.as_bytes(), other.as_bytes());
        let mut difference = u8::from(a.len() != b.len());
        for (i, x) in a.iter().enumerate() {
            difference |= x ^ b.get(i).copied().unwrap_or(0);
        }
        std::hint::black_box(difference) == 0
    }
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The Host is not ours.
    Host,
    /// Another page sent it.
    Origin,
    /// No token, or not this run's.
    Token,
}

/// The checks of one run.
#[derive(Debug)]
pub(crate) struct Guard {
    hosts: [String; 3],
    token: Secret,
    /// A code that is accepted once in place of the token; see [`Guard::spend_code`].
    code: Secret,
    code_uses: AtomicU32,
    session: Mutex<Secret>,
    cookie: String,
}

const OWN_CSP: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' data: blob:; media-src 'self' blob:; font-src 'self'; connect-src 'self'; \
    frame-src 'self'; worker-src 'self'; manifest-src 'self'; base-uri 'none'; \
    form-action 'none'; frame-ancestors 'none'";

/// The viser client is one file with inline script, an inline worker and inline wasm.
const VISER_CSP: &str = "default-src 'none'; \
    script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; \
    style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; \
    connect-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'";

impl Guard {
    /// The checks for a server on this port.
    ///
    /// # Errors
    /// If the operating system has no random numbers.
    pub(crate) fn new(port: u16) -> std::io::Result<Guard> {
        Ok(Guard {
            hosts: ["127.0.0.1", "localhost", "[::1]"].map(|h| format!("{h}:{port}")),
            token: Secret::draw()?,
            code: Secret::draw()?,
            code_uses: AtomicU32::new(0),
            session: Mutex::new(Secret::draw()?),
            // Cookies do not depend on ports: two studios at once must not overwrite each other's.
            cookie: format!("robert_{port}"),
        })
    }

    /// The token of this run.
    pub(crate) fn token(&self) -> &Secret {
        &self.token
    }

    /// The code that the started browser gets instead of the token, since everybody on the machine
    /// can read the arguments of a program. It opens `POST /api/session` once.
    pub(crate) fn code(&self) -> &Secret {
        &self.code
    }

    /// Takes the one-time code. If it is used a second time, somebody has read it from the
    /// browser's arguments, either before the browser used it or after. So a second use is refused,
    /// and the sessions that cookies have opened are ended. The token stays valid.
    fn spend_code(&self) -> bool {
        if self.code_uses.fetch_add(1, Ordering::SeqCst) == 0 {
            return true;
        }
        tracing::error!(
            "the browser's one-time code was used twice; its page has lost its access. \
             Open the address that `robert studio` printed"
        );
        if let Ok(fresh) = Secret::draw() {
            *self.session.lock().unwrap_or_else(PoisonError::into_inner) = fresh;
        }
        false
    }

    /// The cookie that represents the token in a browser.
    pub(crate) fn set_cookie(&self) -> String {
        let session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        format!("{}={}; HttpOnly; SameSite=Strict; Path=/", self.cookie, session.reveal())
    }

    /// Makes all three checks.
    ///
    /// # Errors
    /// The first that fails.
    pub(crate) fn check(&self, head: &Parts) -> Result<(), Refusal> {
        let host = self.host(head).ok_or(Refusal::Host)?;
        let upgrade = head.headers.contains_key(header::UPGRADE);
        let path = head.uri.path();
        let open = matches!(head.method, Method::GET | Method::HEAD)
            && !upgrade
            && (path == "/" || path == "/favicon.ico" || path.starts_with("/ui/"));
        let mut origins = head.headers.get_all(header::ORIGIN).iter();
        let origin = origins.next();
        let own =
            origin.is_some_and(|o| o.as_bytes().strip_prefix(b"http://") == Some(host.as_bytes()));
        if origins.next().is_some() || (origin.is_some() && !own) {
            return Err(Refusal::Origin);
        }
        fetch_site(head, open)?;
        if open {
            return Ok(());
        }
        match self.credential(head, upgrade) {
            Credential::Token => Ok(()),
            // A browser sends the origin with every socket and every change; a cookie without an
            // origin is not from our page.
            Credential::Cookie if own || (head.method.is_safe() && !upgrade) => Ok(()),
            Credential::Cookie => Err(Refusal::Origin),
            Credential::None => Err(Refusal::Token),
        }
    }

    fn host<'a>(&'a self, head: &Parts) -> Option<&'a str> {
        let mut hosts = head.headers.get_all(header::HOST).iter();
        let host = hosts.next()?.to_str().ok()?.to_ascii_lowercase();
        if hosts.next().is_some() {
            return None;
        }
        let known = self.hosts.iter().find(|h| **h == host)?;
        // `GET http://evil/ HTTP/1.1`: the target has precedence over Host, so both must agree.
        match head.uri.authority() {
            Some(a) if !a.as_str().eq_ignore_ascii_case(known) => None,
            _ => Some(known),
        }
    }

    fn credential(&self, head: &Parts, upgrade: bool) -> Credential {
        if let Some(value) = head.headers.get(header::AUTHORIZATION) {
            let bearer = value.to_str().ok().and_then(|v| v.strip_prefix("Bearer "));
            let exchange = head.method == Method::POST && head.uri.path() == "/api/session";
            let right = bearer.is_some_and(|t| {
                self.token.matches(t.trim())
                    || (exchange && self.code.matches(t.trim()) && self.spend_code())
            });
            return if right { Credential::Token } else { Credential::None };
        }
        if upgrade && let Some(token) = query_token(head.uri.query().unwrap_or_default()) {
            let right = self.token.matches(token);
            return if right { Credential::Token } else { Credential::None };
        }
        if self.has_cookie(&head.headers) { Credential::Cookie } else { Credential::None }
    }

    fn has_cookie(&self, headers: &HeaderMap) -> bool {
        headers
            .get_all(header::COOKIE)
            .iter()
            .filter_map(|v| v.to_str().ok())
            .flat_map(|v| v.split(';'))
            .filter_map(|pair| pair.trim().split_once('='))
            .any(|(name, value)| name == self.cookie && self.is_session(value))
    }
}

impl Guard {
    fn is_session(&self, value: &str) -> bool {
        self.session.lock().unwrap_or_else(PoisonError::into_inner).matches(value)
    }
}

/// Checks what the browser itself states about the sender. Old browsers and scripts say nothing.
fn fetch_site(head: &Parts, open: bool) -> Result<(), Refusal> {
    let value = |name: &str| head.headers.get(name).map(HeaderValue::as_bytes);
    match value("sec-fetch-site") {
        None | Some(b"same-origin" | b"none") => Ok(()),
        // A link in a mail or a web terminal may open the start page, as a page.
        Some(_)
            if open
                && value("sec-fetch-mode") == Some(b"navigate")
                && value("sec-fetch-dest") == Some(b"document") =>
        {
            Ok(())
        }
        Some(_) => Err(Refusal::Origin),
    }
}

enum Credential {
    Token,
    Cookie,
    None,
}

fn query_token(query: &str) -> Option<&str> {
    query.split('&').find_map(|pair| pair.strip_prefix("token="))
}

/// The middleware: refuses a request, or passes it on and adds the security headers to the
/// response.
pub(crate) async fn layer(
    State(guard): State<Arc<Guard>>,
    request: Request,
    next: Next,
) -> Response {
    let (head, body) = request.into_parts();
    let viser = head.uri.path().starts_with("/viser");
    let cacheable = head.uri.path().starts_with("/ui/");
    let mut response = match guard.check(&head) {
        Ok(()) => next.run(Request::from_parts(head, body)).await,
        Err(refusal) => refuse(refusal),
    };
    let headers = response.headers_mut();
    let mut set = |name: HeaderName, value: &'static str| {
        headers.insert(name, HeaderValue::from_static(value));
    };
    set(header::X_CONTENT_TYPE_OPTIONS, "nosniff");
    set(header::REFERRER_POLICY, "no-referrer");
    set(HeaderName::from_static("cross-origin-resource-policy"), "same-origin");
    set(HeaderName::from_static("cross-origin-opener-policy"), "same-origin");
    set(header::CONTENT_SECURITY_POLICY, if viser { VISER_CSP } else { OWN_CSP });
    set(header::X_FRAME_OPTIONS, if viser { "SAMEORIGIN" } else { "DENY" });
    if !cacheable {
        set(header::CACHE_CONTROL, "no-store");
    }
    response
}

fn refuse(refusal: Refusal) -> Response {
    let (status, code, message) = match refusal {
        Refusal::Host => (
            StatusCode::FORBIDDEN,
            Code::Forbidden,
            "this Host is not the studio's; open the address that `robert studio` printed",
        ),
        Refusal::Origin => (
            StatusCode::FORBIDDEN,
            Code::Forbidden,
            "another page sent this request; only the studio's own page may",
        ),
        Refusal::Token => (
            StatusCode::UNAUTHORIZED,
            Code::Unauthorized,
            "this request has no valid token; open the address that `robert studio` printed",
        ),
    };
    let body = ErrorBody::new(code, message);
    (status, axum::Json(body)).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(lines: &[(&str, &str)]) -> Parts {
        let mut request = axum::http::Request::builder().uri("/api/clip");
        for (name, value) in lines {
            request = request.header(*name, *value);
        }
        request.body(()).unwrap().into_parts().0
    }

    #[test]
    fn secrets_are_fresh_and_silent() {
        let (a, b) = (Secret::draw().unwrap(), Secret::draw().unwrap());
        assert_eq!(a.reveal().len(), 64);
        assert_ne!(a.reveal(), b.reveal());
        assert!(a.matches(a.reveal()) && !a.matches(b.reveal()));
        assert!(!a.matches("") && !a.matches(&a.reveal()[..63]));
        assert!(!a.matches(&format!("{}0", a.reveal())));
        assert!(!format!("{a:?}").contains(&a.reveal()[..8]));
    }

    #[test]
    fn the_code_opens_one_session_and_a_second_use_ends_it() {
        let guard = Guard::new(4000).unwrap();
        let exchange = |path: &str, secret: &Secret| {
            let bearer = format!("Bearer {}", secret.reveal());
            let mut parts = head(&[("host", "127.0.0.1:4000"), ("authorization", &bearer)]);
            (parts.method, parts.uri) = (Method::POST, path.parse().unwrap());
            guard.check(&parts)
        };
        let (code, token) = (guard.code().clone(), guard.token().clone());
        assert!(!token.matches(code.reveal()));
        assert_eq!(exchange("/api/save", &code), Err(Refusal::Token), "good for a session only");
        assert_eq!(exchange("/api/session", &code), Ok(()));
        let cookie = guard.set_cookie();
        let cookie = cookie.split(';').next().unwrap();
        let look = || guard.check(&head(&[("host", "127.0.0.1:4000"), ("cookie", cookie)]));
        assert_eq!(look(), Ok(()));
        assert_eq!(exchange("/api/session", &code), Err(Refusal::Token));
        assert_eq!(look(), Err(Refusal::Token), "whoever it was has no access any more");
        assert_eq!(exchange("/api/session", &token), Ok(()));
    }

    #[test]
    fn a_page_of_another_local_port_may_not_use_the_cookie() {
        let guard = Guard::new(4000).unwrap();
        let cookie = guard.set_cookie();
        let cookie = cookie.split(';').next().unwrap();
        let host = ("host", "127.0.0.1:4000");
        let check = |extra: &[(&str, &str)]| {
            let mut all = vec![host, ("cookie", cookie)];
            all.extend_from_slice(extra);
            guard.check(&head(&all))
        };
        assert_eq!(check(&[]), Ok(()));
        assert_eq!(check(&[("origin", "http://127.0.0.1:4000")]), Ok(()));
        assert_eq!(check(&[("origin", "http://localhost:4000")]), Err(Refusal::Origin));
        assert_eq!(check(&[("origin", "http://127.0.0.1:4001")]), Err(Refusal::Origin));
        assert_eq!(check(&[("sec-fetch-site", "same-site")]), Err(Refusal::Origin));
        assert_eq!(check(&[("upgrade", "websocket")]), Err(Refusal::Origin));
    }
}
