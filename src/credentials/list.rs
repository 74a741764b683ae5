//! The credentials of a server as values, and the judgement of a token.

use subtle::{ConditionallySelectable, ConstantTimeEq};

use super::{Grant, TokenHash};
use crate::config::Id;
use crate::units::FieldError;
use crate::utc::Utc;

/// Most credentials of a server: a judgement compares with each of them.
pub const MAX_CREDENTIALS: usize = 1024;

/// Longest name of a credential.
const LONGEST_NAME: usize = 64;

/// What the audit log calls whoever needs no credential.
pub const LOCAL: &str = "local";

/// Who has a credential, and for what. Its token is not in here.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Credential {
    /// Unique on its server.
    pub name: String,
    /// What it allows.
    pub grant: Grant,
    /// `devices/NAME`: valid for that device alone.
    pub device: Option<String>,
    /// When it was made.
    pub issued: Utc,
    /// From then on it is worth nothing.
    pub expires: Option<Utc>,
    pub(super) hash: TokenHash,
}

impl Credential {
    /// Whether its time is over.
    pub fn is_expired(&self, now: Utc) -> bool {
        self.expires.is_some_and(|expires| expires <= now)
    }

    fn holder(&self) -> Holder {
        Holder { name: self.name.clone(), grant: self.grant, device: self.device.clone() }
    }
}

/// Who has shown a token that counts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Name of the credential.
    pub name: String,
    /// What it allows.
    pub grant: Grant,
    /// `devices/NAME`: allowed on that device alone.
    pub device: Option<String>,
}

impl Holder {
    /// Whether it may do what needs `needed` on `device` (`devices/NAME`).
    pub fn check(&self, needed: Grant, device: &str) -> Result<(), NotAllowed> {
        self.check_device(device)?;
        self.check_grant(needed)
    }

    /// Whether it is for this device.
    pub fn check_device(&self, device: &str) -> Result<(), NotAllowed> {
        let Some(own) = self.device.as_ref().filter(|own| *own != device) else { return Ok(()) };
        let (name, own, device) = (self.name.clone(), own.clone(), device.to_owned());
        Err(NotAllowed::Device { name, own, device })
    }

    /// Whether it allows that much.
    pub fn check_grant(&self, needed: Grant) -> Result<(), NotAllowed> {
        let Self { name, grant, .. } = self;
        if *grant >= needed {
            return Ok(());
        }
        Err(NotAllowed::Grant { name: name.clone(), grant: *grant, needed })
    }
}

/// What a credential does not allow.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotAllowed {
    /// It is too little.
    #[error("credential {name}: role = {grant}: this needs {needed}")]
    Grant { name: String, grant: Grant, needed: Grant },
    /// It is for another device.
    #[error("credential {name}: device = {own}: it is not valid for {device}")]
    Device { name: String, own: String, device: String },
}

/// Why a token does not count.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Denied {
    /// Nobody's at all.
    #[error("a credential is needed here; hapticd pair on the server makes one")]
    Missing,
    /// It is nobody's: wrong, revoked, or never issued. Which of them is not said.
    #[error("the credential is not known here; hapticd pair on the server makes one")]
    Unknown,
    /// It was somebody's until then.
    #[error("credential {name} expired at {at}; hapticd pair --replace on the server renews it")]
    Expired { name: String, at: Utc },
}

/// All credentials of a server, each with a name and a token of its own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Credentials {
    pub(super) entries: Vec<Credential>,
}

impl Credentials {
    /// In the order in which they were made.
    pub fn list(&self) -> &[Credential] {
        &self.entries
    }

    /// The one of a name.
    pub fn get(&self, name: &str) -> Option<&Credential> {
        self.entries.iter().find(|entry| entry.name == name)
    }

    /// Whose token this is.
    pub fn judge(&self, token: &str, now: Utc) -> Result<Holder, Denied> {
        if token.is_empty() {
            return Err(Denied::Missing);
        }
        self.judge_hash(&TokenHash::of(token), now)
    }

    /// The same of a hash: what stays open need not keep the token to be judged again.
    pub fn judge_hash(&self, presented: &TokenHash, now: Utc) -> Result<Holder, Denied> {
        // Every entry is compared as a whole, so the time tells nothing about how near it came.
        let nobody = u32::MAX;
        let mut found = nobody;
        for (place, entry) in (0..).zip(&self.entries) {
            found.conditional_assign(&place, presented.equals(&entry.hash));
        }
        let known = !found.ct_eq(&nobody);
        let entry = bool::from(known).then(|| &self.entries[found as usize]);
        let entry = entry.ok_or(Denied::Unknown)?;
        match entry.expires.filter(|_| entry.is_expired(now)) {
            Some(at) => Err(Denied::Expired { name: entry.name.clone(), at }),
            None => Ok(entry.holder()),
        }
    }

    /// Adds one, in place of another of its name.
    pub(super) fn put(&mut self, credential: Credential) -> Result<(), FieldError> {
        let others = self.entries.iter().filter(|entry| entry.name != credential.name).count();
        check_count(others + 1)?;
        self.take(&credential.name);
        self.entries.push(credential);
        Ok(())
    }

    /// Removes the one of a name.
    pub(super) fn take(&mut self, name: &str) -> Option<Credential> {
        let place = self.entries.iter().position(|entry| entry.name == name)?;
        Some(self.entries.remove(place))
    }
}

/// A name that anyone may give: fit for a label, a log and a shell, without quoting.
pub fn check_name(field: &str, name: &str) -> Result<(), FieldError> {
    let inside = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte);
    let begins = name.starts_with(|c: char| c.is_ascii_alphanumeric());
    if begins && name.len() <= LONGEST_NAME && name.bytes().all(inside) && name != LOCAL {
        return Ok(());
    }
    let shown: String = name.chars().take(LONGEST_NAME + 1).collect();
    let allowed = "must be 1 to 64 of A-Z, a-z, 0-9, \"-\", \"_\" and \".\", beginning with a letter \
                   or digit, and not \"local\", which is whoever needs no credential";
    Err(FieldError::new(field, format!("{shown:?}"), allowed))
}

/// The resource name of a device, said with or without its collection.
pub fn check_device(field: &str, device: &str) -> Result<String, FieldError> {
    let id = Id::parse(field, device.strip_prefix("devices/").unwrap_or(device))?;
    Ok(format!("devices/{id}"))
}

pub(super) fn check_count(count: usize) -> Result<(), FieldError> {
    if count <= MAX_CREDENTIALS {
        return Ok(());
    }
    let allowed = format!("must be at most {MAX_CREDENTIALS} credentials; revoke some");
    Err(FieldError::new("credential", format!("{count} of them"), allowed))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::Token;
    use super::*;

    pub fn credential(name: &str, token: &Token) -> Credential {
        Credential {
            name: name.to_owned(),
            grant: Grant::Controller,
            device: None,
            issued: Utc::from_ms(1_763_803_800_000),
            expires: None,
            hash: token.hash(),
        }
    }

    pub fn several(count: usize) -> (Credentials, Vec<Token>) {
        let tokens: Vec<_> = (0..count).map(|_| Token::random().unwrap()).collect();
        let mut all = Credentials::default();
        for (i, token) in tokens.iter().enumerate() {
            all.put(credential(&format!("c{i}"), token)).unwrap();
        }
        (all, tokens)
    }

    const NOW: Utc = Utc::LAST;

    #[test]
    fn a_token_is_its_holders_and_ten_thousand_others_are_nobodys() {
        let (all, tokens) = several(20);
        for (i, token) in tokens.iter().enumerate() {
            let holder = all.judge(token.as_str(), NOW).unwrap();
            let wanted = Holder { name: format!("c{i}"), grant: Grant::Controller, device: None };
            assert_eq!(holder, wanted);
            assert_eq!(all.judge_hash(&token.hash(), NOW), Ok(wanted));
        }
        for _ in 0..10_000 {
            let stranger = Token::random().unwrap();
            assert_eq!(all.judge(stranger.as_str(), NOW), Err(Denied::Unknown));
        }
    }

    #[test]
    fn a_token_changed_anywhere_is_nobodys_and_the_answer_is_that_of_any_other() {
        let (all, tokens) = several(3);
        let token = tokens[1].as_str();
        let mut wrong = vec!["\u{e9}".repeat(43), tokens[1].hash().to_hex()];
        wrong.extend((1..token.len()).map(|end| token[..end].to_owned()));
        wrong.push(format!("{token}A"));
        wrong.push(format!("{token}\n"));
        wrong.push(token.to_lowercase());
        wrong.extend((0..token.len()).map(|i| {
            let other = if &token[i..=i] == "A" { "B" } else { "A" };
            format!("{}{other}{}", &token[..i], &token[i + 1..])
        }));
        wrong.push("A".repeat(1 << 20));
        let of_nobody = Credentials::default().judge("x", NOW).unwrap_err().to_string();
        assert_eq!(all.judge("", NOW), Err(Denied::Missing));
        for wrong in wrong {
            let said = all.judge(&wrong, NOW).unwrap_err().to_string();
            assert_eq!(said, of_nobody, "{:?}", wrong.get(..50));
        }
    }

    #[test]
    fn it_counts_until_its_last_millisecond() {
        let token = Token::random().unwrap();
        let expires = Utc::from_ms(1_763_803_900_000);
        let mut all = Credentials::default();
        all.put(Credential { expires: Some(expires), ..credential("anna", &token) }).unwrap();
        assert!(all.judge(token.as_str(), Utc::from_ms(expires.ms() - 1)).is_ok());
        for now in [expires, Utc::LAST] {
            let denied = all.judge(token.as_str(), now).unwrap_err();
            assert_eq!(denied, Denied::Expired { name: "anna".into(), at: expires });
            assert!(denied.to_string().contains("2025-11-22T09:31:40Z"), "{denied}");
        }
    }

    #[test]
    fn a_holder_may_do_what_its_role_includes_on_its_device() {
        let holder = |grant, device: Option<&str>| Holder {
            name: "anna".into(),
            grant,
            device: device.map(str::to_owned),
        };
        let everywhere = holder(Grant::Controller, None);
        assert_eq!(everywhere.check(Grant::Observer, "devices/left"), Ok(()));
        assert_eq!(everywhere.check(Grant::Controller, "devices/right"), Ok(()));
        let said = everywhere.check(Grant::Operator, "devices/left").unwrap_err().to_string();
        assert_eq!(said, "credential anna: role = controller: this needs operator");
        let bound = holder(Grant::Operator, Some("devices/left"));
        assert_eq!(bound.check(Grant::Operator, "devices/left"), Ok(()));
        // Not a prefix, not the whole server, not the bare identifier.
        for other in ["devices/right", "devices/left2", "devices/", "", "left"] {
            let said = bound.check(Grant::Observer, other).unwrap_err().to_string();
            assert!(said.contains("device = devices/left: it is not valid for"), "{said}");
        }
    }

    #[test]
    fn names_follow_the_rule() {
        let longest = "a".repeat(64);
        for good in ["a", "9", "Anna", "lab.pc-2_b", "local2", &longest] {
            assert_eq!(check_name("name", good), Ok(()), "{good}");
        }
        let too_long = "a".repeat(65);
        for bad in [
            "",
            "-a",
            ".",
            "..",
            "_a",
            "a b",
            "a/b",
            "../x",
            "a\n",
            "a\0",
            "\u{e9}",
            "a\u{202e}b",
            "\u{1b}[2J",
            "a\"b",
            "local",
            &too_long,
        ] {
            let error = check_name("NAME", bad).unwrap_err();
            assert_eq!(error.field, "NAME", "{bad:?}");
            assert!(error.value.chars().all(|c| c.is_ascii_graphic() || c == ' ' || c == '\u{e9}'));
        }
        assert_eq!(check_device("d", "left"), check_device("d", "devices/left"));
        for bad in ["", "devices/", "devices/devices/left", "Left", "left/../right"] {
            assert!(check_device("device", bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn one_credential_too_many_is_refused_by_the_number_allowed() {
        let token = Token::random().unwrap();
        let entry = credential("c", &token);
        let mut all = Credentials { entries: vec![entry.clone(); MAX_CREDENTIALS - 1] };
        for entry in &mut all.entries {
            entry.name.clear();
        }
        all.put(entry.clone()).unwrap();
        all.put(entry).unwrap();
        let said = all.put(credential("d", &token)).unwrap_err().to_string();
        assert_eq!(
            said,
            "credential = 1025 of them: must be at most 1024 credentials; revoke some"
        );
    }
}
