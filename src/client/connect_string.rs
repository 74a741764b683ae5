//! One string that connects every client and command:
//! `hapticd://HOST:7351/?sha256=HEX&grpc=PORT`.
//!
//! `serve` prints it. `grpc` is left out where it is the usual port. On this machine a bare
//! HOST:PORT, or just HOST, will do.

use std::fmt;
use std::net::{IpAddr, Ipv6Addr};
use std::str::FromStr;

/// UDP port of the stream.
pub const DEFAULT_STREAM_PORT: u16 = 7351;
/// TCP port of the services.
pub const DEFAULT_GRPC_PORT: u16 = 7350;

/// UDP port of sealed datagrams.
pub const DEFAULT_UDP_PORT: u16 = 7352;

const SCHEME: &str = "hapticd";

/// Where a server is and how to know it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConnectString {
    /// Name or address; IPv6 without brackets.
    pub host: String,
    /// UDP port of the stream.
    pub stream_port: u16,
    /// TCP port of the services.
    pub grpc_port: u16,
    /// SHA-256 of the server's certificate.
    pub sha256: Option<[u8; 32]>,
    /// Credential, where the server wants one.
    pub token: Option<String>,
    /// UDP port of sealed datagrams, where it is not [`DEFAULT_UDP_PORT`], or not the one that
    /// the server says: of a proxy.
    pub udp_port: Option<u16>,
}

/// A connect string that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "connect string {text:?}: {what}; it looks like hapticd://HOST:7351/?sha256=HEX, or HOST:PORT on this machine"
)]
pub struct ConnectStringError {
    text: String,
    what: String,
}

impl ConnectString {
    /// A server on this machine.
    pub fn local(stream_port: u16, grpc_port: u16) -> Self {
        let host = "127.0.0.1".to_owned();
        Self { host, stream_port, grpc_port, sha256: None, token: None, udp_port: None }
    }

    /// True when the host is this machine without asking anybody.
    pub fn is_loopback(&self) -> bool {
        self.host == "localhost" || self.host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
    }

    /// HOST:PORT of the services.
    pub fn grpc_authority(&self) -> String {
        authority(&self.host, self.grpc_port)
    }
}

fn authority(host: &str, port: u16) -> String {
    if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
}

impl fmt::Display for ConnectString {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut query = form_urlencoded::Serializer::new(String::new());
        if let Some(hash) = &self.sha256 {
            let hex: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
            query.append_pair("sha256", &hex);
        }
        if let Some(token) = &self.token {
            query.append_pair("token", token);
        }
        if self.grpc_port != DEFAULT_GRPC_PORT {
            query.append_pair("grpc", &self.grpc_port.to_string());
        }
        if let Some(port) = self.udp_port {
            query.append_pair("udp", &port.to_string());
        }
        write!(f, "{SCHEME}://{}/", authority(&self.host, self.stream_port))?;
        let query = query.finish();
        if query.is_empty() { Ok(()) } else { write!(f, "?{query}") }
    }
}

impl FromStr for ConnectString {
    type Err = ConnectStringError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let fail = |what: String| ConnectStringError { text: without_token(text), what };
        let whole =
            if text.contains("://") { text.to_owned() } else { format!("{SCHEME}://{text}/") };
        let uri: http::Uri = whole.parse().map_err(|error| fail(format!("{error}")))?;
        if uri.scheme_str() != Some(SCHEME) {
            return Err(fail(format!("it must begin with {SCHEME}://")));
        }
        let written_host =
            uri.host().filter(|host| !host.is_empty()).ok_or_else(|| fail("no host".into()))?;
        let host = host_of(written_host).map_err(&fail)?;
        let authority = uri.authority().map_or("", http::uri::Authority::as_str);
        if authority.contains('@') {
            return Err(fail("a user name has no place in it".into()));
        }
        let written_port =
            authority.strip_prefix(written_host).and_then(|rest| rest.strip_prefix(':'));
        let stream_port = match written_port {
            None => DEFAULT_STREAM_PORT,
            Some(port) => port_of("port", port).map_err(&fail)?,
        };
        let mut found = Self {
            host,
            stream_port,
            grpc_port: DEFAULT_GRPC_PORT,
            sha256: None,
            token: None,
            udp_port: None,
        };
        for (key, value) in form_urlencoded::parse(uri.query().unwrap_or("").as_bytes()) {
            match key.as_ref() {
                "sha256" => {
                    let hash =
                        unhex(&value).ok_or_else(|| fail("sha256 must be 64 hex digits".into()))?;
                    found.sha256 = Some(hash);
                }
                "udp" => found.udp_port = Some(port_of("udp", &value).map_err(&fail)?),
                "grpc" => found.grpc_port = port_of("grpc", &value).map_err(&fail)?,
                "token" => found.token = Some(value.into_owned()),
                // A newer server may say more; what is unknown is not needed here.
                _ => {}
            }
        }
        Ok(found)
    }
}

/// A name or an address, one of IPv6 without its brackets: what a URI may have beyond that
/// could not be written again.
fn host_of(written: &str) -> Result<String, String> {
    let in_brackets = written.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let good = match in_brackets {
        Some(address) => address.parse::<Ipv6Addr>().is_ok(),
        None => !written.contains(['[', ']']),
    };
    if good {
        return Ok(in_brackets.unwrap_or(written).to_owned());
    }
    Err(format!("host = {written}: must be a name, an address, or one of IPv6 in brackets"))
}

/// A token that was mistyped into a log is a token in a log.
fn without_token(text: &str) -> String {
    let Some((head, rest)) = text.split_once("token=") else { return text.to_owned() };
    let tail = rest.find('&').map_or("", |end| &rest[end..]);
    format!("{head}token=...{tail}")
}

fn port_of(what: &str, text: &str) -> Result<u16, String> {
    let port = text.parse().ok().filter(|port| *port != 0);
    port.ok_or_else(|| format!("{what} = {text}: must be a port, 1 to 65535"))
}

fn unhex(text: &str) -> Option<[u8; 32]> {
    let digits: Vec<u8> =
        text.chars().map(|c| c.to_digit(16).map(|d| d as u8)).collect::<Option<_>>()?;
    let bytes: Vec<u8> =
        digits.chunks(2).map(|pair| pair[0] << 4 | pair.get(1).unwrap_or(&0)).collect();
    if digits.len() == 64 { bytes.try_into().ok() } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_can_be_read() {
        let full = ConnectString {
            host: "lab.example".into(),
            stream_port: 9000,
            grpc_port: 9001,
            sha256: Some([0xa5; 32]),
            token: Some("a+b c".into()),
            udp_port: Some(9002),
        };
        for string in [
            full.clone(),
            ConnectString { host: "::1".into(), ..full },
            ConnectString::local(7351, 7350),
        ] {
            assert_eq!(string.to_string().parse(), Ok(string));
        }
    }

    #[test]
    fn a_bare_address_will_do() {
        assert_eq!("127.0.0.1:9000".parse(), Ok(ConnectString::local(9000, DEFAULT_GRPC_PORT)));
        let host: ConnectString = "localhost".parse().unwrap();
        assert_eq!((host.stream_port, host.is_loopback()), (DEFAULT_STREAM_PORT, true));
        let six: ConnectString = "[::1]:7".parse().unwrap();
        assert_eq!((six.host.as_str(), six.stream_port, six.is_loopback()), ("::1", 7, true));
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, what) in [
            ("http://host:1/", "must begin with hapticd://"),
            ("hapticd://host:1/?sha256=12", "64 hex digits"),
            ("hapticd://host:1/?grpc=0", "1 to 65535"),
            ("hapticd://host:1/?udp=70000", "udp = 70000: must be a port"),
            ("", "looks like"),
            ("host:port", "port = port: must be a port, 1 to 65535"),
            ("host:0", "1 to 65535"),
            ("v[+]", "host = v[+]: must be a name"),
            ("[v6]:7351", "one of IPv6 in brackets"),
            ("hapticd://somebody@host:9000/", "a user name"),
        ] {
            let error = text.parse::<ConnectString>().unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        }
    }

    #[test]
    fn a_refusal_does_not_tell_the_token() {
        for text in ["hapticd://h/?token=SECRET&grpc=0", "hapticd://h:x/?grpc=1&token=SECRET"] {
            let said = text.parse::<ConnectString>().unwrap_err().to_string();
            assert!(!said.contains("SECRET") && said.contains("token=..."), "{said}");
        }
    }
}
