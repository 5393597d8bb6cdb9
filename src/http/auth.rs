//! Who may ask: bearer tokens (RFC 6750) that may read, or read and control. Without any token everyone on this machine may do both.

use super::HttpState;
use super::page;
use super::problem::Problem;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::fmt;

/// Fewest and most characters of a token: 32 of them, drawn at random, nobody guesses.
const LENGTH: std::ops::RangeInclusive<usize> = 32..=512;

/// What a token allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Scope {
    /// Looking.
    Read,
    /// Looking, and everything that changes something.
    Control,
}

impl Scope {
    /// As the file of tokens and OpenAPI spell it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Control => "control",
        }
    }
}

/// Why a line of a file of tokens is refused; never what it says.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {what}")]
pub struct TokenError {
    /// From 1.
    pub line: usize,
    /// What is wrong and what to do.
    pub what: &'static str,
}

#[derive(Clone)]
struct Token {
    line: usize,
    scope: Scope,
    hash: blake3::Hash,
}

/// The tokens that open the daemon, as hashes: the tokens themselves are kept nowhere.
#[derive(Clone, Default)]
pub struct Tokens(Vec<Token>);

impl fmt::Debug for Tokens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tokens({})", self.0.len())
    }
}

impl Tokens {
    /// Reads lines of `read TOKEN` or `control TOKEN`; blank ones and those that begin with # are skipped.
    ///
    /// # Errors
    /// The first line that is neither, holds a token that is too short or no bearer token, or one that was there before.
    pub fn parse(text: &str) -> Result<Self, TokenError> {
        let mut tokens: Vec<Token> = Vec::new();
        for (line, content) in (1..).zip(text.lines().map(str::trim)) {
            if content.is_empty() || content.starts_with('#') {
                continue;
            }
            let refuse = |what| TokenError { line, what };
            let mut words = content.split_whitespace();
            let (scope, token) = match (words.next(), words.next(), words.next()) {
                (Some("read"), Some(token), None) => (Scope::Read, token),
                (Some("control"), Some(token), None) => (Scope::Control, token),
                _ => return Err(refuse("write `read TOKEN` or `control TOKEN`")),
            };
            if !is_token(token) {
                return Err(refuse(
                    "the token must be 32 to 512 letters, digits or -._~+/=: `openssl rand -hex 32` makes one",
                ));
            }
            let hash = blake3::hash(token.as_bytes());
            if tokens.iter().any(|known| known.hash == hash) {
                return Err(refuse("the token is there twice: give each a line of its own"));
            }
            tokens.push(Token { line, scope, hash });
        }
        Ok(Self(tokens))
    }

    /// True when nobody needs a token.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Line in their file, from 1, and scope of every token.
    pub(super) fn entries(&self) -> impl Iterator<Item = (usize, Scope)> {
        self.0.iter().map(|token| (token.line, token.scope))
    }

    /// What a token allows. Hashes are compared, each in constant time (`blake3::Hash`'s equality), and all of them.
    fn scope(&self, token: &str) -> Option<Scope> {
        let hash = blake3::hash(token.as_bytes());
        self.0.iter().fold(None, |found, known| if known.hash == hash { Some(known.scope) } else { found })
    }
}

/// True for what can be a bearer token of ours.
pub fn is_token(text: &str) -> bool {
    LENGTH.contains(&text.len()) && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._~+/=".contains(&b))
}

/// The scope a request needs; none for what is open: whether the daemon lives, and the page that asks for a token. Whatever is not plainly looking is control.
pub(super) fn required(method: &Method, path: &str) -> Option<Scope> {
    match *method {
        Method::GET | Method::HEAD if path == "/livez" || page::has(path) => None,
        Method::GET | Method::HEAD => Some(Scope::Read),
        _ => Some(Scope::Control),
    }
}

/// Refuses requests without a token that allows them. It stands before the router, so that no route can be forgotten.
pub(super) async fn authorize(State(state): State<HttpState>, request: Request, next: Next) -> Response {
    match refusal(&state.tokens, request.method(), request.uri().path(), request.headers()) {
        Some((problem, challenge)) => {
            let mut response = problem.into_response();
            response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static(challenge));
            response
        }
        None => next.run(request).await,
    }
}

fn refusal(tokens: &Tokens, method: &Method, path: &str, headers: &HeaderMap) -> Option<(Problem, &'static str)> {
    let needed = required(method, path).filter(|_| !tokens.is_empty())?;
    let Some(token) = bearer(headers) else {
        let detail = "send `Authorization: Bearer TOKEN`, once, with a token of this daemon";
        return Some((Problem::unauthorized(detail), r#"Bearer realm="rigd""#));
    };
    match tokens.scope(token) {
        Some(scope) if scope >= needed => None,
        Some(_) => {
            let challenge = r#"Bearer realm="rigd", error="insufficient_scope", scope="control""#;
            Some((Problem::forbidden("this token may only read: use one with the scope control"), challenge))
        }
        None => {
            let detail = "the token is none of this daemon's: see the file of tokens it was started with";
            Some((Problem::unauthorized(detail), r#"Bearer realm="rigd", error="invalid_token""#))
        }
    }
}

/// The token of a request; none when there is not exactly one.
fn bearer(headers: &HeaderMap) -> Option<&str> {
    let mut values = headers.get_all(header::AUTHORIZATION).iter();
    let (scheme, token) = values.next()?.to_str().ok()?.split_once(' ')?;
    let only = values.next().is_none() && scheme.eq_ignore_ascii_case("bearer");
    Some(token.trim()).filter(|_| only)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const READ: &str = "0123456789abcdef0123456789abcdef";
    const CONTROL: &str = "fedcba9876543210fedcba9876543210";

    #[test]
    fn tokens_are_known_by_their_lines_and_shown_by_nobody() {
        let tokens = Tokens::parse(&format!("# of the lab\n\nread {READ}\n  control\t{CONTROL}  \n")).unwrap();
        assert_eq!((tokens.scope(READ), tokens.scope(CONTROL)), (Some(Scope::Read), Some(Scope::Control)));
        for wrong in ["", "read", &READ[1..], &READ.to_uppercase(), &format!("{READ} ")] {
            assert_eq!(tokens.scope(wrong), None, "{wrong}");
        }
        assert_eq!(format!("{tokens:?}"), "Tokens(2)");
        assert!(Tokens::parse("# none yet\n").unwrap().is_empty());
    }

    #[test]
    fn a_line_that_is_no_token_is_named_without_its_text() {
        let (short, odd) = ("tooshort", "0123456789abcdef0123456789abcd\u{e9}\u{e9}");
        for line in [
            format!("write {READ}"),
            READ.to_owned(),
            format!("read {short}"),
            format!("read {odd}"),
            format!("read {READ} {CONTROL}"),
            format!("read {CONTROL}"),
        ] {
            let error = Tokens::parse(&format!("control {CONTROL}\n{line}\n")).unwrap_err();
            assert_eq!(error.line, 2, "{line}");
            for secret in [READ, CONTROL, short, odd] {
                assert!(!error.to_string().contains(secret), "{error}");
            }
        }
    }

    #[test]
    fn only_looking_is_reading() {
        for method in [Method::POST, Method::PUT, Method::PATCH, Method::DELETE, Method::OPTIONS, Method::TRACE] {
            assert_eq!(required(&method, "/livez"), Some(Scope::Control), "{method}");
        }
        for path in ["/livez", "/", "/page.js"] {
            assert_eq!(required(&Method::GET, path), None, "{path}");
        }
        for path in ["/livez/", "//", "/metrics", "/readyz", "/openapi.json", "/v1/rig", "/nowhere"] {
            assert_eq!(required(&Method::GET, path), Some(Scope::Read), "{path}");
        }
    }
}
