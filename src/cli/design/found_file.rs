//! A found linkage as a device file that `serve` takes.
//!
//! It is the given device's file with other values. What its author wrote in comments does not
//! survive; what it means does.

use std::path::PathBuf;

use toml::{Table, Value};

use crate::config::{DeviceDefinition, Id};

/// Where such a file goes: its name becomes the device's.
pub fn parse_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    if path.extension().is_none_or(|ending| ending != "toml") {
        return Err("must end in .toml".into());
    }
    Id::parse("file name without .toml", &stem).map_err(|error| error.to_string())?;
    Ok(path)
}

/// The given device's file with these values in `[mechanism]`, a new description where there is
/// one, and a comment above it all.
pub fn device_file<'a>(
    device: &DeviceDefinition,
    comment: &str,
    description: Option<String>,
    mechanism: impl IntoIterator<Item = (&'a str, Value)>,
) -> anyhow::Result<String> {
    let mut file: Table = device.text.parse()?;
    if let Some(description) = description {
        file.insert("description".into(), description.into());
    }
    if let Some(table) = file.get_mut("mechanism").and_then(Value::as_table_mut) {
        table.extend(mechanism.into_iter().map(|(key, value)| (key.to_owned(), value)));
    }
    let text = format!("{comment}\n\n{}", toml::to_string(&file)?);
    // Nobody is left with a file that no server takes.
    DeviceDefinition::from_toml("found", &text, "the found design")?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_no_server_takes_is_refused_before_the_search() {
        assert_eq!(parse_path("a/better.toml"), Ok(PathBuf::from("a/better.toml")));
        for (name, told) in
            [("better.txt", ".toml"), ("better", ".toml"), ("Better.toml", "Better")]
        {
            let error = parse_path(name).unwrap_err();
            assert!(error.contains(told), "{name}: {error}");
        }
    }
}
