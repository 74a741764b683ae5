//! Connect strings: no panic, and what one prints it reads.
//!
//! The client library needs tokio and quinn; its parser does not. So the file itself is part
//! of this crate.

#[path = "../../src/client/connect_string.rs"]
#[allow(dead_code)]
mod connect_string;

use connect_string::ConnectString;

/// Bytes as text.
pub fn check(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match text.parse::<ConnectString>() {
        Ok(found) => {
            assert!(!found.host.is_empty());
            let _ = found.is_loopback();
            let _ = found.grpc_authority();
            let again: ConnectString = found.to_string().parse().expect("it reads what it prints");
            assert_eq!(again, found);
        }
        Err(error) => assert!(error.to_string().starts_with("connect string ")),
    }
}
