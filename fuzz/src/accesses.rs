//! The check of whom a request means and which page sends it: what passes names nobody else, as
//! another parser of the same texts sees them.

#[path = "../../src/net/access.rs"]
mod access;

use access::Access;
use http::Uri;
use http::uri::Authority;

/// First line: what a request says it means. The second, where there is one: the page.
pub fn check(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let mut lines = text.lines();
    let (host, origin) = (lines.next().unwrap_or_default(), lines.next());
    let access = Access {
        names: vec!["lab.example".to_owned()],
        origins: vec!["https://page.example".to_owned()],
    };
    if let Err(refusal) = access.check(host, origin) {
        assert!(refusal.to_string().len() < 2_000, "a refusal repeats little");
        return;
    }
    let Ok(meant) = host.parse::<Authority>() else { return };
    assert!(is_allowed(meant.host()), "{host}");
    let page = origin.and_then(|origin| origin.parse::<Uri>().ok());
    if let Some(page) = page.as_ref().and_then(Uri::host) {
        let own = page.eq_ignore_ascii_case(meant.host());
        let loopback = address(page).is_some_and(|ip| ip.is_loopback());
        let listed = page.eq_ignore_ascii_case("page.example");
        assert!(own || loopback || is_localhost(page) || listed, "{host} from {origin:?}");
    }
}

fn address(name: &str) -> Option<std::net::IpAddr> {
    name.trim_start_matches('[').trim_end_matches(']').parse().ok()
}

fn is_localhost(name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    lower == "localhost" || lower.ends_with(".localhost")
}

fn is_allowed(name: &str) -> bool {
    address(name).is_some() || is_localhost(name) || name.eq_ignore_ascii_case("lab.example")
}
