//! Why something that a user wrote cannot be used: file, key path, value, and what is allowed.
//!
//! Two kinds of refusal meet here: the file is no TOML of the expected layout ([`parse`] says
//! where), or a value is outside its range (a [`FieldError`], with the same key paths).

use std::{fs, io, path::Path};

use serde::de::DeserializeOwned;

use crate::units::FieldError;

/// A configuration that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        source: io::Error,
    },
    /// Not TOML, an unknown key, a missing key, or a value of another type.
    #[error("{file}:{line}: {key}: {message}")]
    Layout {
        /// The file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Key path of that line, such as `actuators[2].kind`; the table where there is none.
        key: String,
        /// What was found and what was expected.
        message: String,
    },
    /// A value that is not allowed.
    #[error("{file}: {source}")]
    Field {
        /// The file.
        file: String,
        /// Key path, value and range.
        source: FieldError,
    },
    /// No such device.
    #[error(
        "no device {name:?}; built in: {built_in}; any other is named by the path of its .toml file"
    )]
    UnknownDevice {
        /// What was asked for.
        name: String,
        /// Those there are.
        built_in: String,
    },
}

impl ConfigError {
    /// Puts the file before a refused field.
    pub(super) fn field(file: &str) -> impl FnOnce(FieldError) -> Self {
        move |source| Self::Field { file: file.to_owned(), source }
    }
}

/// The text of a file.
pub(super) fn read(path: &Path) -> Result<String, ConfigError> {
    let file = path.display().to_string();
    fs::read_to_string(path).map_err(|source| ConfigError::Read { file, source })
}

/// Reads TOML into its layout; `file` is for messages only.
pub(crate) fn parse<T: DeserializeOwned>(text: &str, file: &str) -> Result<T, ConfigError> {
    toml::from_str(text).map_err(|error| {
        let offset = error.span().map_or(0, |span| span.start).min(text.len());
        let (line, key) = locate(text, offset);
        let message = error.message().replace('\n', " ");
        ConfigError::Layout { file: file.to_owned(), line, key, message }
    })
}

/// Line number and key path at a byte of a TOML text.
fn locate(text: &str, offset: usize) -> (usize, String) {
    let mut table = String::new();
    let mut headers = Vec::new();
    let (mut line, mut start) = (0, 0);
    for content in text.split_inclusive('\n') {
        line += 1;
        let trimmed = content.trim();
        if let Some(name) = trimmed.strip_prefix("[[").and_then(|rest| rest.split("]]").next()) {
            let before = headers.iter().filter(|header| *header == name).count();
            headers.push(name.to_owned());
            table = format!("{name}[{before}]");
        } else if let Some(name) = trimmed.strip_prefix('[').filter(|_| !trimmed.contains('=')) {
            table = name.split(']').next().unwrap_or(name).to_owned();
        }
        start += content.len();
        if start > offset {
            break;
        }
    }
    let end = start.min(text.len());
    let last = text[..end].lines().next_back().unwrap_or_default().trim();
    let key = last.split_once('=').map(|(key, _)| key.trim()).unwrap_or_default();
    let path = match (table.as_str(), key) {
        ("", "") => "file".to_owned(),
        ("", key) => key.to_owned(),
        (table, "") => table.to_owned(),
        (table, key) => format!("{table}.{key}"),
    };
    (line.max(1), path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Layout {
        #[serde(default)]
        _top: f64,
        #[serde(default)]
        _rows: Vec<Row>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Row {
        _size: f64,
    }

    fn message(text: &str) -> String {
        parse::<Layout>(text, "some.toml").unwrap_err().to_string()
    }

    #[test]
    fn an_unknown_key_is_named_with_its_table_and_line() {
        let said = message("_top = 1\n[[_rows]]\n_size = 1\n[[_rows]]\n_size = 2\ncolour = 3\n");
        assert!(said.starts_with("some.toml:6: _rows[1].colour: unknown field `colour`"), "{said}");
        assert!(said.contains("_size"), "says what is known: {said}");
        let said = message("tpo = 1\n");
        assert!(said.starts_with("some.toml:1: tpo: unknown field `tpo`"), "{said}");
    }

    #[test]
    fn a_value_of_another_type_is_shown() {
        let said = message("_top = \"high\"\n");
        assert!(said.starts_with("some.toml:1: _top: ") && said.contains("\"high\""), "{said}");
    }

    #[test]
    fn a_missing_key_is_named() {
        let said = message("[[_rows]]\n");
        assert!(said.contains("_rows[0]") && said.contains("`_size`"), "{said}");
    }

    #[test]
    fn what_is_no_toml_has_a_line() {
        for text in ["a = [1,", "=", "\u{0}", "[", "_top = 1\n_top = 2", "é = \"", "_top = é"] {
            assert!(message(text).starts_with("some.toml:"), "{text:?}");
        }
    }
}
