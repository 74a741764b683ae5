//! The layout of the file of credentials, and the check of each of its values.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::list::{check_count, check_device, check_name};
use super::{Credential, Credentials, Grant, TokenHash};
use crate::config::ConfigError;
use crate::units::FieldError;
use crate::utc::{Utc, UtcError};

impl Credentials {
    /// Reads what [`Credentials::to_toml`] writes; `file` is for messages only.
    pub(super) fn from_toml(text: &str, file: &str) -> Result<Self, ConfigError> {
        let layout: Layout = crate::config::parse_toml(text, file)?;
        Self::check(&layout).map_err(|source| ConfigError::Field { file: file.to_owned(), source })
    }

    fn check(layout: &Layout) -> Result<Self, FieldError> {
        check_count(layout.credential.len())?;
        let (mut names, mut hashes) = (BTreeSet::new(), BTreeSet::new());
        let mut entries = Vec::new();
        for (i, entry) in layout.credential.iter().enumerate() {
            let field = |key: &str| format!("credential[{i}].{key}");
            let entry = entry.check(field)?;
            if !names.insert(entry.name.clone()) {
                return Err(FieldError::new(field("name"), entry.name, "must be unique"));
            }
            if !hashes.insert(entry.hash) {
                let allowed = "must be another one than every credential's before it";
                return Err(FieldError::new(field("sha256"), entry.hash.to_hex(), allowed));
            }
            entries.push(entry);
        }
        Ok(Self { entries })
    }

    pub(super) fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(&Layout {
            credential: self.entries.iter().map(EntryLayout::from).collect(),
        })
    }
}

/// The layout of the file.
#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Layout {
    #[serde(default)]
    credential: Vec<EntryLayout>,
}

/// What narrows a credential stands before what it cannot be without, so that no entry cut short
/// is a wider one.
#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct EntryLayout {
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    expires: Option<String>,
    issued: String,
    role: String,
    sha256: String,
}

impl EntryLayout {
    fn check(&self, field: impl Fn(&str) -> String) -> Result<Credential, FieldError> {
        check_name(&field("name"), &self.name)?;
        let moment = |key: &str, text: &str| {
            let refusal =
                |error: UtcError| FieldError::new(field(key), shown(text), error.to_string());
            text.parse::<Utc>().map_err(refusal)
        };
        let device = self.device.as_ref().map(|device| {
            let written = check_device(&field("device"), device)?;
            let allowed = "must be devices/NAME";
            let same = written == *device;
            same.then_some(written)
                .ok_or_else(|| FieldError::new(field("device"), shown(device), allowed))
        });
        let hash = TokenHash::from_hex(&self.sha256).ok_or_else(|| {
            FieldError::new(field("sha256"), shown(&self.sha256), "must be 64 hexadecimal digits")
        });
        Ok(Credential {
            name: self.name.clone(),
            grant: Grant::parse(&field("role"), &self.role)?,
            device: device.transpose()?,
            issued: moment("issued", &self.issued)?,
            expires: self.expires.as_ref().map(|text| moment("expires", text)).transpose()?,
            hash: hash?,
        })
    }
}

/// What was found, no longer than any value that could be right.
fn shown(text: &str) -> String {
    format!("{:?}", text.chars().take(80).collect::<String>())
}

impl From<&Credential> for EntryLayout {
    fn from(entry: &Credential) -> Self {
        Self {
            name: entry.name.clone(),
            device: entry.device.clone(),
            expires: entry.expires.map(|expires| expires.to_string()),
            issued: entry.issued.to_string(),
            role: entry.grant.name().to_owned(),
            sha256: entry.hash.to_hex(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Token;
    use super::super::list::tests::{credential, several};
    use super::*;

    #[test]
    fn what_is_written_can_be_read() {
        let token = Token::random().unwrap();
        let (mut all, _) = several(3);
        let whole = Credential {
            grant: Grant::Operator,
            device: Some("devices/left".into()),
            expires: Some(Utc::LAST),
            ..credential("a.B-c_9", &token)
        };
        all.put(whole).unwrap();
        let text = all.to_toml().unwrap();
        assert_eq!(Credentials::from_toml(&text, "f").unwrap(), all);
        assert!(!text.contains(token.as_str()), "only its hash");
        assert_eq!(Credentials::from_toml("", "f").unwrap(), Credentials::default());
    }

    #[test]
    fn each_bad_value_is_refused_by_its_key_path() {
        let (all, _) = several(2);
        let text = all.to_toml().unwrap();
        let hash = all.list()[1].hash.to_hex();
        for (from, to, named) in [
            ("name = \"c1\"", "name = \"c0\"", "credential[1].name = c0: must be unique"),
            ("name = \"c1\"", "name = \"c/1\"", "credential[1].name = \"c/1\": must be 1 to 64 of"),
            ("name = \"c1\"", "name = 1", "credential[1].name: invalid type"),
            ("name = \"c1\"", "nmae = \"c1\"", "credential[1].nmae: unknown field"),
            (
                "name = \"c1\"",
                "name = \"c1\"\ndevice = \"left\"",
                "credential[1].device = \"left\"",
            ),
            (
                "name = \"c1\"",
                "name = \"c1\"\ndevice = \"devices/../x\"",
                "credential[1].device = \"../x\"",
            ),
            (
                "name = \"c1\"",
                "name = \"c1\"\nexpires = \"soon\"",
                "credential[1].expires = \"soon\": must be a moment in UTC",
            ),
            (hash.as_str(), &hash[2..], "credential[1].sha256 = "),
            (hash.as_str(), &all.list()[0].hash.to_hex(), "must be another one"),
        ] {
            assert!(text.contains(from), "{from} in\n{text}");
            let broken = text.replacen(from, to, 1);
            let said = Credentials::from_toml(&broken, "c.toml").unwrap_err().to_string();
            assert!(said.starts_with("c.toml:") && said.contains(named), "{named}: {said}");
        }
        let role = text.replacen("role = \"controller\"", "role = \"root\"", 1);
        let said = Credentials::from_toml(&role, "c.toml").unwrap_err().to_string();
        assert!(said.contains("credential[0].role = \"root\": must be \"observer\""), "{said}");
    }

    /// TOML cut short is TOML again at many places; at none of them it allows more.
    #[test]
    fn an_entry_cut_short_is_never_a_wider_one() {
        let token = Token::random().unwrap();
        let mut all = Credentials::default();
        let narrow = Credential {
            device: Some("devices/left".into()),
            expires: Some(Utc::LAST),
            ..credential("anna", &token)
        };
        all.put(narrow).unwrap();
        let text = all.to_toml().unwrap();
        for end in 0..text.len() {
            if let Ok(read) = Credentials::from_toml(&text[..end], "f") {
                assert!(read.list().is_empty() || read == all, "{}", &text[..end]);
            }
        }
    }
}
