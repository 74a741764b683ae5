//! Whose pages may talk to the server: a check of names, on loopback too.
//!
//! A browser lets any page send requests anywhere, and a page can make its own name point to
//! this machine (DNS rebinding). So a request must name this server as it is really called (an
//! address, localhost, or a name from the configuration), and where it says which page sends it
//! (`Origin`), that page must be the server's own, one of this machine, or one that the
//! configuration lists. Programs that are no browsers name no page.

use std::net::{IpAddr, Ipv6Addr};

/// Names and pages that are allowed beside those that always are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Names by which the server is called.
    pub names: Vec<String>,
    /// Pages from elsewhere, `https://HOST[:PORT]` each.
    pub origins: Vec<String>,
}

/// Why a request is not answered.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AccessRefusal {
    /// The server is not called that.
    #[error("host = {0:?}: must be an address, localhost, or one of server.names")]
    Host(String),
    /// The page is a stranger's.
    #[error("origin = {0:?}: must be this server, this machine, or one of server.origins")]
    Origin(String),
}

impl Access {
    /// Judges a request by the host that it names, with or without a port, and the page that
    /// sends it.
    pub fn check(&self, host: &str, origin: Option<&str>) -> Result<(), AccessRefusal> {
        let shown = |text: &str| text.chars().take(200).collect();
        let host = without_port(host);
        let known = address(host).is_some() || is_localhost(host) || self.has_name(host);
        if !known {
            return Err(AccessRefusal::Host(shown(host)));
        }
        let Some(origin) = origin else { return Ok(()) };
        if self.origins.iter().any(|listed| listed.eq_ignore_ascii_case(origin)) {
            return Ok(());
        }
        let page = origin.split_once("://").map(|(_, authority)| without_port(authority));
        let own = page.is_some_and(|page| {
            let here = address(page).is_some_and(|ip| ip.is_loopback()) || is_localhost(page);
            here || page.eq_ignore_ascii_case(host)
        });
        if own { Ok(()) } else { Err(AccessRefusal::Origin(shown(origin))) }
    }

    fn has_name(&self, host: &str) -> bool {
        self.names.iter().any(|name| name.eq_ignore_ascii_case(host))
    }
}

/// The host of `HOST`, `HOST:PORT` or `[ADDRESS]:PORT`.
fn without_port(authority: &str) -> &str {
    let is_port = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if let Some((host, rest)) = authority.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        let whole = rest.is_empty() || rest.strip_prefix(':').is_some_and(is_port);
        let is_address = host.parse::<Ipv6Addr>().is_ok();
        return if whole && is_address { host } else { authority };
    }
    match authority.rsplit_once(':') {
        Some((host, port)) if !host.contains(':') && is_port(port) => host,
        _ => authority,
    }
}

fn address(host: &str) -> Option<IpAddr> {
    host.parse().ok()
}

/// `localhost` and what is below it never leave the machine (RFC 6761, section 6.3).
fn is_localhost(host: &str) -> bool {
    // What is no name to others ends otherwise for them: at a colon, an at sign, a slash.
    let is_name = host.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._".contains(&byte));
    let host = host.to_ascii_lowercase();
    is_name && (host == "localhost" || host.ends_with(".localhost"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_called_by_its_addresses_and_names_only() {
        let access = Access { names: vec!["lab.example".into()], ..Access::default() };
        for host in [
            "127.0.0.1",
            "127.0.0.1:7353",
            "[::1]:7353",
            "::1",
            "192.0.2.4:1",
            "localhost:7353",
            "LOCALHOST",
            "page.localhost",
            "lab.example:7354",
            "Lab.Example",
        ] {
            assert_eq!(access.check(host, None), Ok(()), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "evil.example:7353",
            "localhost.evil.example",
            "notlocalhost",
            "lab.example.evil",
            "127.0.0.1.evil.example:7353",
            "[evil]:1",
            "[::1]evil.example",
            "[.localhost]",
            "[127.0.0.1]",
            "evil.example:7353.localhost",
            "evil.example/.localhost",
            "evil.example@x.localhost",
            "[::1]:7353x",
            "lab.example:7354x",
        ] {
            let refused = access.check(host, None);
            assert!(matches!(refused, Err(AccessRefusal::Host(_))), "{host} {refused:?}");
        }
    }

    #[test]
    fn a_page_is_its_own_this_machines_or_listed() {
        let access = Access {
            names: vec!["lab.example".into()],
            origins: vec!["https://scenes.example".into()],
        };
        for (host, origin) in [
            ("127.0.0.1:7353", "http://127.0.0.1:7353"),
            ("127.0.0.1:7351", "http://localhost:5173"),
            ("192.0.2.4:7351", "https://192.0.2.4:7354"),
            ("lab.example:7351", "https://LAB.example:7354"),
            ("localhost", "https://scenes.example"),
            ("[::1]:7353", "http://[::1]:7353"),
        ] {
            assert_eq!(access.check(host, Some(origin)), Ok(()), "{host} {origin}");
        }
        for origin in [
            "https://evil.example",
            "http://lab.example.evil",
            "null",
            "",
            "https://",
            "https://scenes.example:444",
            "http://scenes.example",
            "https://192.0.2.5:7354",
            "https://localhost.evil.example",
            "http://evil.example:7353",
            "http://evil.example:1.localhost",
            "http://evil.example/.localhost",
        ] {
            let refused = access.check("192.0.2.4:7351", Some(origin));
            assert!(matches!(refused, Err(AccessRefusal::Origin(_))), "{origin} {refused:?}");
        }
    }

    #[test]
    fn a_long_name_comes_back_short() {
        let refusal = Access::default().check(&"x".repeat(100_000), None).unwrap_err();
        assert!(refusal.to_string().len() < 400);
    }
}
