//! The server's certificate: made once, kept in the state directory, known by its hash.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::sign::CertifiedKey;

use super::Security;
use crate::quic::{fingerprint, provider};

/// One file holds both, so that they can only be replaced together.
const FILE: &str = "identity.pem";

/// A certificate with its key.
#[derive(Debug)]
pub struct Identity {
    /// What clients see.
    pub certificate: CertificateDer<'static>,
    /// Who vouches for it; empty where its hash does.
    pub chain: Vec<CertificateDer<'static>>,
    /// What proves it.
    pub key: PrivateKeyDer<'static>,
}

/// Why there is no identity.
#[derive(Debug, thiserror::Error)]
pub enum IdentityError {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    File { path: PathBuf, source: std::io::Error },
    /// The file holds no certificate with its key. It is left as it is.
    #[error(
        "{path}: {what}; move the file away to get a new identity (clients must then learn its hash)"
    )]
    Malformed { path: PathBuf, what: String },
    /// A file that somebody brought is not what it was said to be.
    #[error("{path}: {what}")]
    Brought { path: PathBuf, what: String },
    /// No certificate could be made.
    #[error("cannot make a certificate: {0}")]
    Generate(#[from] rcgen::Error),
    /// What was made or read cannot be used.
    #[error("cannot use a certificate: {0}")]
    Use(#[from] rustls::Error),
}

impl Identity {
    /// The identity kept in `state_dir`, made and kept there if there is none yet.
    pub fn load_or_create(state_dir: &Path) -> Result<Self, IdentityError> {
        let path = state_dir.join(FILE);
        let file = |source| IdentityError::File { path: path.clone(), source };
        match fs::read(&path) {
            Ok(pem) => from_pem(&path, &pem),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let pem = generate()?;
                keep(state_dir, &path, &pem).map_err(file)?;
                from_pem(&path, pem.as_bytes())
            }
            Err(error) => Err(file(error)),
        }
    }

    /// SHA-256 of the certificate.
    pub fn sha256(&self) -> [u8; 32] {
        fingerprint(&self.certificate)
    }

    /// One that people bring: certificates, the server's first, and its key.
    pub fn load(certificate: &Path, key: &Path) -> Result<Self, IdentityError> {
        let read = |path: &Path| {
            fs::read(path).map_err(|source| IdentityError::File { path: path.to_owned(), source })
        };
        let malformed = |path: &Path, what: &str, error: &dyn std::fmt::Display| {
            IdentityError::Brought { path: path.to_owned(), what: format!("{what}: {error}") }
        };
        let chain =
            CertificateDer::pem_slice_iter(&read(certificate)?).collect::<Result<Vec<_>, _>>();
        let mut chain =
            chain.map_err(|error| malformed(certificate, "no certificate", &error))?.into_iter();
        let first = chain.next();
        let first =
            first.ok_or_else(|| malformed(certificate, "no certificate", &"it has none"))?;
        let secret = PrivateKeyDer::from_pem_slice(&read(key)?)
            .map_err(|error| malformed(key, "no private key", &error))?;
        let identity = Self { certificate: first, chain: chain.collect(), key: secret };
        identity
            .certified()
            .map_err(|error| malformed(key, "it is not the certificate's key", &error))?;
        Ok(identity)
    }

    /// What gRPC is spoken over; TLS is needed, or will do as plaintext does.
    pub fn grpc_security(&self, needed: bool) -> Result<Security, rustls::Error> {
        Security::tls(self.certified()?, &["h2"], needed)
    }

    /// What HTTPS is spoken over.
    pub fn https_security(&self) -> Result<Security, rustls::Error> {
        Security::tls(self.certified()?, &["h2", "http/1.1"], true)
    }

    /// As a handshake shows it.
    pub(super) fn certified(&self) -> Result<CertifiedKey, rustls::Error> {
        let chain = [std::slice::from_ref(&self.certificate), &self.chain].concat();
        CertifiedKey::from_der(chain, self.key.clone_key(), &provider())
    }
}

/// The identity in the text of a file; `path` is for messages only.
pub(super) fn from_pem(path: &Path, pem: &[u8]) -> Result<Identity, IdentityError> {
    let malformed = |what: &str, error: &dyn std::fmt::Display| IdentityError::Malformed {
        path: path.to_owned(),
        what: format!("{what}: {error}"),
    };
    let certificate =
        CertificateDer::from_pem_slice(pem).map_err(|error| malformed("no certificate", &error))?;
    let key =
        PrivateKeyDer::from_pem_slice(pem).map_err(|error| malformed("no private key", &error))?;
    let identity = Identity { certificate, chain: Vec::new(), key };
    identity
        .certified()
        .map_err(|error| malformed("the key is not that of the certificate", &error))?;
    Ok(identity)
}

fn generate() -> Result<String, rcgen::Error> {
    let names = vec!["hapticd".to_owned(), "localhost".to_owned()];
    let certified = rcgen::generate_simple_self_signed(names)?;
    Ok(format!("{}{}", certified.cert.pem(), certified.signing_key.serialize_pem()))
}

/// Written beside, synced, then put in place; readable by the owner alone.
pub(super) fn keep(state_dir: &Path, path: &Path, pem: &str) -> std::io::Result<()> {
    fs::create_dir_all(state_dir)?;
    let mut file = tempfile::NamedTempFile::new_in(state_dir)?;
    file.write_all(pem.as_bytes())?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    fs::File::open(state_dir)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identity_is_made_once_and_kept() {
        let dir = tempfile::tempdir().unwrap();
        let first = Identity::load_or_create(dir.path()).unwrap().sha256();
        assert_eq!(Identity::load_or_create(dir.path()).unwrap().sha256(), first);
        let other = tempfile::tempdir().unwrap();
        assert_ne!(Identity::load_or_create(other.path()).unwrap().sha256(), first);
    }

    #[test]
    fn a_broken_identity_is_named_and_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(FILE);
        fs::write(&path, "rubbish").unwrap();
        let error = Identity::load_or_create(dir.path()).unwrap_err().to_string();
        assert!(error.contains("identity.pem") && error.contains("no certificate"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "rubbish");
    }

    #[test]
    fn a_certificate_with_the_key_of_another_is_refused_by_its_path() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(FILE);
        let (one, other) = (generate().unwrap(), generate().unwrap());
        let key = other.find("-----BEGIN PRIVATE").unwrap();
        let certificate = &one[..one.find("-----BEGIN PRIVATE").unwrap()];
        fs::write(&path, format!("{certificate}{}", &other[key..])).unwrap();
        let error = Identity::load_or_create(dir.path()).unwrap_err().to_string();
        assert!(error.contains(path.to_str().unwrap()) && error.contains("the key is"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn nobody_else_can_read_the_key() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        Identity::load_or_create(dir.path()).unwrap();
        let mode = fs::metadata(dir.path().join(FILE)).unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0);
    }
}
