//! The file of the credentials: `STATE_DIR/credentials.toml`, readable by its owner alone.
//!
//! Whoever changes it holds the lock `credentials.lock` from reading to writing, so that of two
//! commands at once neither loses what the other made. Readers need no lock: the file is
//! replaced as a whole. What cannot be understood is an error and is never written over; the
//! last line says that it is whole.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::list::check_name;
use super::{Credential, Credentials, Grant, Token, private};
use crate::config::ConfigError;
use crate::units::FieldError;
use crate::utc::Utc;

const FILE: &str = "credentials.toml";
const LOCK: &str = "credentials.lock";

const FIRST_LINES: &str = "# Who may use this server: `hapticd pair` makes, lists and revokes what is in here.\n\
     # Tokens are not in it, only their SHA-256.\n\n";
const LAST_LINE: &str = "# end of credentials";

/// Largest file that is read: all credentials that there may be, with names of full length, fit.
const LARGEST_BYTES: u64 = 1 << 19;

/// How long one command waits for another.
const PATIENCE: Duration = Duration::from_secs(10);
const PAUSE: Duration = Duration::from_millis(10);

/// Why credentials cannot be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum CredentialsError {
    /// The system refuses.
    #[error("{path}: {action}: {source}")]
    Io { path: String, action: &'static str, source: io::Error },
    /// The file was cut short.
    #[error(
        "{path}: the last line is not {LAST_LINE:?}: the file was cut short; it was left as it is"
    )]
    CutShort { path: String },
    /// The file cannot be understood.
    #[error("{0}; the file was left as it is")]
    Malformed(ConfigError),
    /// Others than the owner may say who is let in.
    #[error("{path}: mode = {mode:03o}: must not be writable by group or others (chmod 600)")]
    Writable { path: String, mode: u32 },
    /// What was asked for cannot be.
    #[error("{0}")]
    Field(#[from] FieldError),
    /// There is one of that name.
    #[error("name = {name}: there is a {grant} of that name already; --replace replaces it")]
    Exists { name: String, grant: Grant },
    /// There is none of that name.
    #[error("name = {name}: no such credential; there are: {names}")]
    NoSuch { name: String, names: String },
    /// Somebody else does not let go of the lock.
    #[error("{path}: another hapticd pair has been at it for {} s; try again", PATIENCE.as_secs())]
    Busy { path: String },
    /// No random numbers.
    #[error("the system gives no random numbers for a token")]
    Random,
}

/// A credential to be made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// A name of its own.
    pub name: String,
    /// What it allows.
    pub grant: Grant,
    /// `devices/NAME`: that device alone.
    pub device: Option<String>,
    /// Days until it is worth nothing; `None`: it holds until it is revoked.
    pub days: Option<u32>,
    /// Take the place of one of that name.
    pub replace: bool,
}

/// Where the credentials of a server are kept.
#[derive(Clone, Debug)]
pub struct CredentialFile {
    path: PathBuf,
    lock: PathBuf,
}

impl CredentialFile {
    /// The file in a state directory; whether it is there or not.
    pub fn in_directory(state_dir: &Path) -> Self {
        Self { path: state_dir.join(FILE), lock: state_dir.join(LOCK) }
    }

    /// The file itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What is in the file; none where there is no file.
    pub fn load(&self) -> Result<Credentials, CredentialsError> {
        let mut file = match File::open(&self.path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Ok(Credentials::default());
            }
            Err(error) => return Err(self.io("cannot read")(error)),
        };
        self.read(&mut file)
    }

    fn read(&self, file: &mut File) -> Result<Credentials, CredentialsError> {
        let found = file.metadata().map_err(self.io("cannot read"))?;
        let path = self.path.display().to_string();
        let mode = found.mode() & 0o777;
        if mode & 0o022 != 0 {
            return Err(CredentialsError::Writable { path, mode });
        }
        if found.len() > LARGEST_BYTES {
            let allowed = format!("must be at most {LARGEST_BYTES} bytes");
            let source = FieldError::new("size", found.len(), allowed);
            return Err(CredentialsError::Malformed(ConfigError::Field { file: path, source }));
        }
        let mut text = String::new();
        file.take(LARGEST_BYTES).read_to_string(&mut text).map_err(self.io("cannot read"))?;
        if text.lines().next_back().map(str::trim_end) != Some(LAST_LINE) {
            return Err(CredentialsError::CutShort { path });
        }
        Credentials::from_toml(&text, &path).map_err(CredentialsError::Malformed)
    }

    /// Makes a credential and its token, which nobody can show again.
    pub fn issue(&self, wanted: Wanted, now: Utc) -> Result<(Token, Credential), CredentialsError> {
        let Wanted { name, grant, device, days, replace } = wanted;
        check_name("name", &name)?;
        let token = Token::random().ok_or(CredentialsError::Random)?;
        let issued = now.whole_second();
        let expires = days.map(|days| issued.plus_days(days));
        let made = Credential { name, grant, device, issued, expires, hash: token.hash() };
        self.change(|all| {
            if let Some(other) = all.get(&made.name).filter(|_| !replace) {
                let (name, grant) = (other.name.clone(), other.grant);
                return Err(CredentialsError::Exists { name, grant });
            }
            Ok(all.put(made.clone())?)
        })?;
        Ok((token, made))
    }

    /// Takes a credential back; a keyring sees it at its next look.
    pub fn revoke(&self, name: &str) -> Result<Credential, CredentialsError> {
        check_name("name", name)?;
        self.change(|all| {
            all.take(name).ok_or_else(|| {
                let names: Vec<_> = all.list().iter().map(|entry| entry.name.as_str()).collect();
                let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
                CredentialsError::NoSuch { name: name.to_owned(), names }
            })
        })
    }

    /// Reads, changes and writes while nobody else does.
    fn change<T>(
        &self,
        change: impl FnOnce(&mut Credentials) -> Result<T, CredentialsError>,
    ) -> Result<T, CredentialsError> {
        let _locked = self.lock()?;
        let mut all = self.load()?;
        let changed = change(&mut all)?;
        let text = all.to_toml().map_err(io::Error::other).map_err(self.io("cannot be TOML"))?;
        let text = format!("{FIRST_LINES}{text}{LAST_LINE}\n");
        private::replace(&self.path, &text).map_err(self.io("cannot replace"))?;
        Ok(changed)
    }

    /// The lock goes with the file that is returned, also when its process is killed.
    fn lock(&self) -> Result<File, CredentialsError> {
        let path = self.lock.display().to_string();
        let io = |action| {
            let path = path.clone();
            move |source| CredentialsError::Io { path, action, source }
        };
        if let Some(directory) = self.lock.parent() {
            fs::create_dir_all(directory).map_err(io("cannot make its directory"))?;
        }
        let options = &mut OpenOptions::new();
        options.write(true).create(true).truncate(false);
        let file = private::open(&self.lock, options).map_err(io("cannot open"))?;
        let deadline = Instant::now() + PATIENCE;
        loop {
            match file.try_lock() {
                Ok(()) => return Ok(file),
                Err(TryLockError::Error(error)) => return Err(io("cannot lock")(error)),
                Err(TryLockError::WouldBlock) if Instant::now() >= deadline => {
                    return Err(CredentialsError::Busy { path });
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
            }
        }
    }

    fn io(&self, action: &'static str) -> impl FnOnce(io::Error) -> CredentialsError {
        let path = self.path.display().to_string();
        move |source| CredentialsError::Io { path, action, source }
    }
}

#[cfg(test)]
#[path = "file_tests.rs"]
mod tests;
