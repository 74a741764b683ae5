//! Files of the state directory that only its owner may read, and how they are replaced.
//!
//! A replacement is written beside the old file, synced, put in its place, and the directory
//! is synced: after a crash there is the old one or the new one, never half of either.
//!
//! `sudo hapticd pair` must not leave behind what the server's own user cannot read: what root
//! makes here belongs to the owner of the directory. That owner may be less trusted than root,
//! so links are not followed, and only files that nobody else has a name for are given away.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, fchown};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;

const MODE: u32 = 0o600;

/// Opens a file of the state directory with these options, for its owner alone where it is new.
pub(crate) fn open(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    let no_links = OFlags::NOFOLLOW.bits() as i32;
    let file = options.mode(MODE).custom_flags(no_links).open(path)?;
    give_away(path, &file)?;
    Ok(file)
}

/// Gives the file at `path` to the owner of its directory where root has just made it.
pub(crate) fn adopt(path: &Path) -> io::Result<()> {
    open(path, OpenOptions::new().read(true)).map(drop)
}

fn give_away(path: &Path, file: &File) -> io::Result<()> {
    let root = rustix::process::geteuid().is_root();
    let (found, directory) = (file.metadata()?, fs::metadata(directory(path))?);
    if root && found.is_file() && found.uid() == 0 && found.nlink() == 1 && directory.uid() != 0 {
        fchown(file, Some(directory.uid()), Some(directory.gid()))?;
    }
    Ok(())
}

fn directory(path: &Path) -> &Path {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    parent.unwrap_or(Path::new("."))
}

/// Where a replacement is written before it takes the place of `path`.
pub(super) fn beside(path: &Path) -> PathBuf {
    path.with_extension("toml.new")
}

/// Puts `text` in place of the file at `path`. On an error before the change of names the old
/// one is still there. One process at a time.
pub(super) fn replace(path: &Path, text: &str) -> io::Result<()> {
    let temporary = beside(path);
    // What an interrupted replacement left.
    match fs::remove_file(&temporary) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut file = open(&temporary, OpenOptions::new().write(true).create_new(true))?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    fs::rename(&temporary, path)?;
    sync_directory(path)
}

/// Makes the names in the directory of `path` last.
pub(crate) fn sync_directory(path: &Path) -> io::Result<()> {
    File::open(directory(path))?.sync_all()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt, chown, symlink};

    use super::*;

    #[test]
    fn a_replacement_is_private_and_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("credentials.toml");
        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, PermissionsExt::from_mode(0o666)).unwrap();
        fs::write(beside(&path), "half of an interrupted o").unwrap();
        replace(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, MODE);
        assert!(!beside(&path).exists());
    }

    #[test]
    fn a_replacement_that_cannot_be_written_leaves_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("credentials.toml");
        fs::write(&path, "old").unwrap();
        fs::create_dir(beside(&path)).unwrap();
        replace(&path, "new").unwrap_err();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    }

    #[test]
    fn a_link_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (link, aim) = (folder.path().join("audit.jsonl"), folder.path().join("aim"));
        symlink(&aim, &link).unwrap();
        open(&link, OpenOptions::new().append(true).create(true)).unwrap_err();
        assert!(!aim.exists());
    }

    /// Of other users than root there is nothing to give away.
    #[test]
    fn what_root_makes_belongs_to_the_owner_of_the_directory_unless_it_has_another_name() {
        if !rustix::process::geteuid().is_root() {
            println!("skipped: only root can give files away");
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        chown(folder.path(), Some(65_534), Some(65_533)).unwrap();
        let path = folder.path().join("credentials.toml");
        replace(&path, "new").unwrap();
        let owner =
            |path: &Path| fs::metadata(path).map(|found| (found.uid(), found.gid())).unwrap();
        assert_eq!(owner(&path), (65_534, 65_533));

        let other = folder.path().join("elsewhere");
        fs::write(&other, "root's").unwrap();
        fs::hard_link(&other, folder.path().join("planted")).unwrap();
        adopt(&folder.path().join("planted")).unwrap();
        assert_eq!(owner(&other).0, 0, "a file with two names stays root's");
        fs::remove_file(folder.path().join("planted")).unwrap();
        adopt(&other).unwrap();
        assert_eq!(owner(&other), (65_534, 65_533));
    }
}
