//! What is done to every request and every answer.

use super::HttpState;
use super::problem::Problem;
use axum::Json;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, Uri, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, Ipv6Addr};

/// Refuses what a web page of somebody else's may have made a browser send: a name that only looks like this machine (its domain was
/// rebound to 127.0.0.1), and anything but looking from another origin. Where tokens are needed any name will do: a browser
/// has none for a foreign page to use.
pub(super) async fn own_name(State(state): State<HttpState>, request: Request, next: Next) -> Response {
    match refusal(&request, state.tokens.is_empty()) {
        Some(problem) => problem.into_response(),
        None => next.run(request).await,
    }
}

fn refusal(request: &Request, only_loopback: bool) -> Option<Problem> {
    let names = match names(request.headers(), request.uri(), request.version()) {
        Ok(names) => names,
        Err(detail) => return Some(Problem::bad_request(detail)),
    };
    if only_loopback && names.iter().any(|name| !is_loopback(name)) {
        return Some(Problem::misdirected());
    }
    let looking = matches!(*request.method(), Method::GET | Method::HEAD);
    let origins = request.headers().get_all(header::ORIGIN);
    let own = |origin: &str| origin.split_once("://").is_some_and(|(_, name)| names.contains(&name));
    let foreign = origins.iter().any(|origin| !origin.to_str().is_ok_and(own));
    (foreign && !looking).then(|| {
        let detail = "the Origin header names another site: only this daemon's own page may ask this from a browser";
        Problem::forbidden(detail)
    })
}

/// The names the request was sent to: the Host header, of which HTTP/1.1 wants exactly one, and that of an absolute target.
fn names<'a>(headers: &'a HeaderMap, uri: &'a Uri, version: Version) -> Result<Vec<&'a str>, &'static str> {
    let hosts: Vec<_> = headers.get_all(header::HOST).iter().map(|h| h.to_str().unwrap_or_default()).collect();
    if hosts.len() > 1 || hosts.is_empty() && version == Version::HTTP_11 {
        return Err("send the Host header once");
    }
    // Both count, because which of two is meant is anybody's guess.
    Ok(hosts.into_iter().chain(uri.authority().map(|a| a.as_str())).collect())
}

fn is_loopback(authority: &str) -> bool {
    let without_port = |s: &str| s.rsplit_once(':').map_or(s.to_owned(), |(name, _)| name.to_owned());
    if let Some(v6) = authority.strip_prefix('[').and_then(|rest| rest.split(']').next()) {
        return v6.parse::<Ipv6Addr>().is_ok_and(|ip| ip.is_loopback());
    }
    let name = without_port(authority);
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// Writes the request's path into a problem as its `instance`.
pub(super) async fn instance(request: Request, next: Next) -> Response {
    let path = request.uri().path().to_owned();
    let mut response = next.run(request).await;
    if let Some(problem) = response.extensions_mut().remove::<Problem>() {
        *response.body_mut() = Json(Problem { instance: Some(path), ..problem }).into_response().into_body();
        response.headers_mut().remove(header::CONTENT_LENGTH);
    }
    response
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use axum::body::Body;

    #[test]
    fn only_loopback_names_pass() {
        for good in ["localhost", "LOCALHOST:80", "127.0.0.1", "127.0.0.1:7040", "127.9.9.9:1", "[::1]:7040", "[::1]"] {
            assert!(is_loopback(good), "{good}");
        }
        for bad in
            ["", "evil.example", "localhost.evil.example:80", "127.0.0.1.evil.example", "192.168.0.1:7040", "[::2]:1"]
        {
            assert!(!is_loopback(bad), "{bad}");
        }
    }

    #[test]
    fn names_and_origins_are_held_against_each_other() {
        let status = |method: &str, headers: &[(&str, &str)], only_loopback| {
            let builder = Request::builder().method(method).uri("/v1/sessions");
            let builder = headers.iter().fold(builder, |builder, (name, value)| builder.header(*name, *value));
            refusal(&builder.body(Body::empty()).unwrap(), only_loopback).map(|problem| problem.status)
        };
        let host = ("host", "127.0.0.1:7040");
        type Case<'a> = (&'a str, &'a [(&'a str, &'a str)], Option<u16>);
        let cases: &[Case] = &[
            ("GET", &[host], None),
            ("GET", &[], Some(400)),
            ("GET", &[host, host], Some(400)),
            ("GET", &[("host", "evil.example")], Some(421)),
            ("GET", &[host, ("origin", "http://evil.example")], None),
            ("POST", &[host, ("origin", "http://127.0.0.1:7040")], None),
            ("POST", &[host, ("origin", "http://evil.example")], Some(403)),
            ("POST", &[host, ("origin", "http://127.0.0.1:7041")], Some(403)),
            ("POST", &[host, ("origin", "null")], Some(403)),
            ("DELETE", &[host, ("origin", "http://127.0.0.1:7040"), ("origin", "null")], Some(403)),
        ];
        for (method, headers, expected) in cases {
            assert_eq!(status(method, headers, true), *expected, "{method} {headers:?}");
        }
        let proxied = [("host", "rig.example"), ("origin", "https://rig.example")];
        assert_eq!(status("POST", &proxied, false), None);
        assert_eq!(status("POST", &[proxied[0], ("origin", "https://evil.example")], false), Some(403));
    }
}
