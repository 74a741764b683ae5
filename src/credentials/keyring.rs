//! The credentials of a running server: judged in memory, read again when their file changed.
//!
//! A judgement opens no file. [`Keyring::refresh`] looks at the file, seldom, and is called
//! beside whatever may not wait for a disk. A list that cannot be read leaves the one before
//! in force, so that a slip of an editor locks nobody out; a file that is gone lets nobody in.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use super::{CredentialFile, Credentials, CredentialsError, Denied, Holder, TokenHash};
use crate::utc::Utc;

/// Between two looks at the file.
const PERIOD_NS: u64 = 500_000_000;

/// Two changes within one step of a file system's clock look alike, and are of one length where
/// only hashes differ. A file is read again until its last change is older than any such step.
const SETTLED_MS: i64 = 5000;

/// What a look at the file came to.
#[derive(Debug)]
pub enum Refreshed {
    /// Nothing is new, or it is not yet time to look.
    Same,
    /// Other credentials count than before: who is connected is judged anew.
    Changed,
    /// They cannot be read any more; those read last count. Said once for each reason.
    Unreadable(CredentialsError),
}

/// The credentials in force.
#[derive(Debug)]
pub struct Keyring {
    file: CredentialFile,
    /// Held only as long as it takes to copy or exchange a pointer.
    in_force: RwLock<Arc<Credentials>>,
    watch: Mutex<Watch>,
}

#[derive(Debug, Default)]
struct Watch {
    next_look_ns: u64,
    /// The file as it was read last, where that need not be done again.
    seen: Option<Stamp>,
    /// What was said about it.
    complaint: Option<String>,
}

/// How one state of a file is told from another; `None`: there was none.
type Stamp = Option<(u64, i64, i64, u64)>;

impl Keyring {
    /// Those in a state directory now; a file that cannot be read is an error.
    pub fn open(state_dir: &Path) -> Result<Self, CredentialsError> {
        let file = CredentialFile::in_directory(state_dir);
        let in_force = RwLock::new(Arc::new(file.load()?));
        // What counts is what the first look finds, whatever happened since.
        Ok(Self { file, in_force, watch: Mutex::default() })
    }

    /// The list in force.
    pub fn credentials(&self) -> Arc<Credentials> {
        Arc::clone(&self.in_force.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Whose token this is.
    pub fn judge(&self, token: &str, now: Utc) -> Result<Holder, Denied> {
        self.credentials().judge(token, now)
    }

    /// The same of a hash, by which a connection that stays open is judged again.
    pub fn judge_hash(&self, presented: &TokenHash, now: Utc) -> Result<Holder, Denied> {
        self.credentials().judge_hash(presented, now)
    }

    /// Looks whether the file has changed, at most every 500 ms of the device clock, and takes
    /// over what it says. Reads a file: not for a thread that forces wait for. Another thread
    /// that is looking already is not waited for.
    pub fn refresh(&self, now_ns: u64) -> Refreshed {
        let Ok(mut watch) = self.watch.try_lock() else { return Refreshed::Same };
        if now_ns < watch.next_look_ns {
            return Refreshed::Same;
        }
        watch.next_look_ns = now_ns.saturating_add(PERIOD_NS);
        // The stamp first: what changes while it is read is found at the next look.
        let stamp = stamp(self.file.path());
        match &stamp {
            Ok(stamp) if watch.seen == Some(*stamp) => return Refreshed::Same,
            _ => watch.seen = stamp.ok().filter(settled),
        }
        match self.file.load() {
            Ok(read) => self.take_over(&mut watch, read),
            Err(error) => watch.complain(error),
        }
    }

    fn take_over(&self, watch: &mut Watch, read: Credentials) -> Refreshed {
        let path = self.file.path().display();
        if watch.complaint.take().is_some() {
            tracing::info!(%path, "credentials can be read again");
        }
        if *self.credentials() == read {
            return Refreshed::Same;
        }
        tracing::info!(%path, count = read.list().len(), "credentials have changed");
        *self.in_force.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(read);
        Refreshed::Changed
    }
}

impl Watch {
    fn complain(&mut self, error: CredentialsError) -> Refreshed {
        let said = error.to_string();
        if self.complaint.as_ref() == Some(&said) {
            return Refreshed::Same;
        }
        tracing::error!(
            error = said,
            "credentials cannot be read; those read before stay in force"
        );
        self.complaint = Some(said);
        Refreshed::Unreadable(error)
    }
}

fn stamp(path: &Path) -> io::Result<Stamp> {
    match fs::metadata(path) {
        Ok(found) => Ok(Some((found.ino(), found.mtime(), found.ctime(), found.len()))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// Whether a change after this one would look different.
fn settled(stamp: &Stamp) -> bool {
    let now_s = i64::try_from(Utc::now().ms() / 1000).unwrap_or(i64::MAX);
    stamp.is_none_or(|(_, mtime_s, ctime_s, _)| {
        let age_ms = (now_s - mtime_s.max(ctime_s)).saturating_mul(1000);
        age_ms > SETTLED_MS
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::credentials::{Grant, Wanted};

    const NOW: Utc = Utc::LAST;

    fn wanted(name: &str) -> Wanted {
        let name = name.to_owned();
        Wanted { name, grant: Grant::Observer, device: None, days: None, replace: true }
    }

    /// Looks each time that it is asked.
    struct Looking {
        folder: tempfile::TempDir,
        keyring: Keyring,
        now_ns: u64,
    }

    impl Looking {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let keyring = Keyring::open(folder.path()).unwrap();
            Self { folder, keyring, now_ns: 0 }
        }

        fn file(&self) -> CredentialFile {
            CredentialFile::in_directory(self.folder.path())
        }

        fn look(&mut self) -> Refreshed {
            self.now_ns += PERIOD_NS;
            self.keyring.refresh(self.now_ns)
        }
    }

    #[test]
    fn what_is_issued_and_revoked_counts_at_the_next_look_and_not_before() {
        let mut looking = Looking::new();
        assert!(matches!(looking.look(), Refreshed::Same));
        let (token, _) = looking.file().issue(wanted("anna"), NOW).unwrap();
        let judged = |looking: &Looking| looking.keyring.judge(token.as_str(), NOW);
        assert!(matches!(looking.keyring.refresh(looking.now_ns + PERIOD_NS - 1), Refreshed::Same));
        assert_eq!(judged(&looking), Err(Denied::Unknown), "it did not look yet");
        assert!(matches!(looking.look(), Refreshed::Changed));
        assert_eq!(judged(&looking).unwrap().name, "anna");
        assert!(matches!(looking.look(), Refreshed::Same));
        looking.file().revoke("anna").unwrap();
        assert!(matches!(looking.look(), Refreshed::Changed));
        assert_eq!(judged(&looking), Err(Denied::Unknown));
    }

    /// As fast as they come, so that their times and lengths are alike.
    #[test]
    fn changes_that_look_alike_are_seen_all_the_same() {
        let mut looking = Looking::new();
        for _ in 0..50 {
            let (token, _) = looking.file().issue(wanted("anna"), NOW).unwrap();
            assert!(matches!(looking.look(), Refreshed::Changed));
            assert!(looking.keyring.judge(token.as_str(), NOW).is_ok());
        }
    }

    #[test]
    fn a_list_that_cannot_be_read_is_told_once_and_the_one_before_counts() {
        let mut looking = Looking::new();
        let (token, _) = looking.file().issue(wanted("anna"), NOW).unwrap();
        assert!(matches!(looking.look(), Refreshed::Changed));
        let path = looking.file().path().to_owned();
        let good = fs::read_to_string(&path).unwrap();
        for broken in ["", "rubbish", "[[credential]]\n# end of credentials\n"] {
            fs::write(&path, broken).unwrap();
            let first = looking.look();
            assert!(
                matches!(&first, Refreshed::Unreadable(error)
                if error.to_string().contains("credentials.toml")),
                "{first:?}"
            );
            for _ in 0..3 {
                assert!(matches!(looking.look(), Refreshed::Same), "{broken:?} told again");
                assert_eq!(looking.keyring.judge(token.as_str(), NOW).unwrap().name, "anna");
            }
            fs::write(&path, &good).unwrap();
            assert!(matches!(looking.look(), Refreshed::Same), "it is the list in force");
        }
        assert!(Keyring::open(looking.folder.path()).is_ok());
        fs::write(&path, "rubbish").unwrap();
        assert!(Keyring::open(looking.folder.path()).is_err(), "no server starts with it");
    }

    #[test]
    fn a_file_that_is_gone_lets_nobody_in() {
        let mut looking = Looking::new();
        let (token, _) = looking.file().issue(wanted("anna"), NOW).unwrap();
        looking.look();
        fs::remove_file(looking.file().path()).unwrap();
        assert!(matches!(looking.look(), Refreshed::Changed));
        assert_eq!(looking.keyring.judge(token.as_str(), NOW), Err(Denied::Unknown));
    }

    #[test]
    fn an_old_file_is_not_read_again() {
        let mut looking = Looking::new();
        looking.file().issue(wanted("anna"), NOW).unwrap();
        let path = looking.file().path().to_owned();
        looking.look();
        let seen = |looking: &Looking| looking.keyring.watch.lock().unwrap().seen;
        assert_eq!(seen(&looking), None, "it is new: the next look reads it again");
        let stamp = super::stamp(&path).unwrap();
        assert!(!settled(&stamp));
        let (ino, _, _, len) = stamp.unwrap();
        assert!(settled(&Some((ino, 1_000_000, 1_000_000, len))) && settled(&None));
        // As if it had been read when it was old.
        looking.keyring.watch.lock().unwrap().seen = Some(stamp);
        assert!(matches!(looking.look(), Refreshed::Same));
        assert_eq!(seen(&looking), Some(stamp));
    }
}
