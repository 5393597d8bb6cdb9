//! What is done to every request and every answer.

use super::problem::Problem;
use axum::Json;
use axum::extract::Request;
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, Ipv6Addr};

/// Refuses names that only look like this machine: a web page whose domain was rebound to 127.0.0.1 must not move the arm.
pub(super) async fn loopback_host(request: Request, next: Next) -> Response {
    let headers = request.headers().get_all(header::HOST).iter().map(|h| h.to_str().unwrap_or_default());
    // Every name counts, because which of two is meant is anybody's guess.
    let mut names = headers.chain(request.uri().authority().map(|a| a.as_str()));
    if names.any(|name| !is_loopback(name)) {
        return Problem::misdirected().into_response();
    }
    next.run(request).await
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
    use super::is_loopback;

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
}
