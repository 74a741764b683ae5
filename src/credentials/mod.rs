//! Credentials: who may use a server, and for what.
//!
//! ```text
//! hapticd pair ─▶ CredentialFile ─▶ STATE_DIR/credentials.toml ─▶ Keyring ─▶ judge(token, now)
//! ```
//!
//! A [`Token`] is 32 random bytes that its holder has and nobody else; the server keeps its
//! SHA-256. A [`Credential`] says whose it is, what it allows ([`Grant`]), perhaps on which device
//! and until when. [`CredentialFile`] issues and revokes; a running server has a [`Keyring`],
//! which judges in memory. What needs which grant is decided where something is asked for: this
//! module knows no socket and no session. docs/security.md is the whole of it in words.

mod file;
mod grant;
mod keyring;
mod layout;
mod list;
pub(crate) mod private;
mod token;

pub use file::{CredentialFile, CredentialsError, Wanted};
pub use grant::Grant;
pub use keyring::{Keyring, Refreshed};
pub use list::{
    Credential, Credentials, Denied, Holder, LOCAL, MAX_CREDENTIALS, NotAllowed, check_device,
    check_name,
};
pub use token::{Token, TokenHash};
