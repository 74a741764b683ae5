//! Which devices a server serves: one, or several by names of their own.
//!
//! A device is said as `NAME|FILE`, or as `ID=NAME|FILE` where it is to have another name than
//! that of its definition: two of a kind need one each. What `[[devices]]` leaves out, and what
//! the command line says for all, comes from the keys of the single device.

use serde::Deserialize;

use super::{ConfigError, DeviceDefinition, Id};
use crate::device::HandProgram;
use crate::units::{self, FieldError};

/// Most devices of one server.
pub const MAX_DEVICES: usize = 8;

/// One device to serve.
#[derive(Clone, Debug, PartialEq)]
pub struct ServedDevice {
    /// NAME of `devices/NAME`; `None`: that of the definition.
    pub name: Option<Id>,
    /// Name of a built-in device, or a device file.
    pub source: String,
    /// What its simulated hand does.
    pub hand: HandProgram,
    /// Processor of its loop; `None`: the loops share out the allowed ones.
    pub rt_cpu: Option<usize>,
}

impl Default for ServedDevice {
    fn default() -> Self {
        let hand = HandProgram::default();
        Self { name: None, source: "cho-2005".into(), hand, rt_cpu: None }
    }
}

impl ServedDevice {
    /// The same, but of what `text` says: `NAME|FILE` or `ID=NAME|FILE`.
    pub(super) fn of(&self, field: &str, text: &str) -> Result<Self, FieldError> {
        let (name, source) = match text.split_once('=') {
            // A path may hold one, too; what is before it is no identifier then.
            Some((name, source)) if !name.contains(['/', '.']) => {
                (Some(Id::parse(&format!("{field} (before =)"), name)?), source)
            }
            _ => (None, text),
        };
        Ok(Self { name, source: source.to_owned(), ..self.clone() })
    }

    /// The definition, under the name that it is served by.
    pub fn load(&self) -> Result<DeviceDefinition, ConfigError> {
        let mut definition = DeviceDefinition::load(&self.source)?;
        if let Some(name) = &self.name {
            definition.name = name.clone();
        }
        Ok(definition)
    }
}

/// All definitions, each under a name of its own.
pub fn load_devices(served: &[ServedDevice]) -> Result<Vec<DeviceDefinition>, ConfigError> {
    let mut definitions: Vec<DeviceDefinition> = Vec::new();
    for (i, device) in served.iter().enumerate() {
        let definition = device.load()?;
        if definitions.iter().any(|other| other.name == definition.name) {
            let field = format!("devices[{i}].name");
            let allowed = "must be unique: serve it by another one (name, or --device ID=NAME)";
            let refusal = FieldError::new(field, &definition.name, allowed);
            return Err(ConfigError::field("devices")(refusal));
        }
        definitions.push(definition);
    }
    Ok(definitions)
}

/// A `[[devices]]` of the server file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DeviceTable {
    device: String,
    name: Option<String>,
    hand: Option<String>,
    rt_cpu: Option<i64>,
}

impl DeviceTable {
    pub fn check(&self, usual: &ServedDevice) -> Result<ServedDevice, FieldError> {
        let name = self.name.as_deref().map(|name| Id::parse("name", name)).transpose()?;
        let hand = self.hand.as_deref().map(check_hand).transpose()?;
        let rt_cpu = self.rt_cpu.map(check_processor).transpose()?;
        Ok(ServedDevice {
            name,
            source: self.device.clone(),
            hand: hand.unwrap_or(usual.hand),
            rt_cpu: rt_cpu.or(usual.rt_cpu),
        })
    }
}

/// The devices of a file: those of `[[devices]]`, else the single one.
pub(super) fn check_devices(
    single: Option<&str>,
    usual: &ServedDevice,
    tables: &[DeviceTable],
) -> Result<Vec<ServedDevice>, FieldError> {
    match (single, tables) {
        (None, []) => Ok(vec![usual.clone()]),
        (Some(device), []) => Ok(vec![usual.of("device", device)?]),
        (Some(device), _) => {
            let allowed = "must not be there beside [[devices]]: make it one of those";
            Err(FieldError::new("device", format!("{device:?}"), allowed))
        }
        (None, tables) => {
            check_count(tables.len())?;
            let check = |(i, table): (usize, &DeviceTable)| {
                table.check(usual).map_err(|refusal| refusal.within(&format!("devices[{i}]")))
            };
            tables.iter().enumerate().map(check).collect()
        }
    }
}

/// Refuses more than a server can have.
pub(super) fn check_count(count: usize) -> Result<(), FieldError> {
    if count <= MAX_DEVICES {
        return Ok(());
    }
    let allowed = format!("must be at most {MAX_DEVICES}");
    Err(FieldError::new("devices", format!("{count} of them"), allowed))
}

/// The number of a processor.
pub(super) fn check_processor(cpu: i64) -> Result<usize, FieldError> {
    units::PROCESSOR.check_whole("rt_cpu", cpu).map(|cpu| cpu as usize)
}

/// The name of a hand's program.
pub(super) fn check_hand(text: &str) -> Result<HandProgram, FieldError> {
    text.parse().map_err(|_| {
        let names = HandProgram::all().map(|program| format!("{:?}", program.name())).join(", ");
        FieldError::new("hand", format!("{text:?}"), format!("must be one of {names}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Overrides, ServerConfig};

    fn served(text: &str) -> Result<Vec<ServedDevice>, String> {
        let config = ServerConfig::from_toml(text, "server.toml");
        config.map(|config| config.devices).map_err(|error| error.to_string())
    }

    #[test]
    fn several_devices_have_their_own_hands_and_fall_back_on_the_common_one() {
        let text = "hand = \"circle\"\nrt_cpu = 1\n
            [[devices]]\ndevice = \"cho-2005\"\nname = \"left\"\nhand = \"hold\"\n
            [[devices]]\ndevice = \"cho-2005\"\nrt_cpu = 0\n";
        let devices = served(text).unwrap();
        let summary: Vec<_> = devices.iter().map(|d| (d.hand.name(), d.rt_cpu)).collect();
        assert_eq!(summary, [("hold", Some(1)), ("circle", Some(0))]);
        let names: Vec<_> = load_devices(&devices).unwrap();
        let names: Vec<_> = names.iter().map(|device| device.name.as_str()).collect();
        assert_eq!(names, ["left", "cho-2005"]);
    }

    #[test]
    fn two_of_one_name_are_refused_and_told_what_to_do() {
        let twice = served("[[devices]]\ndevice = \"two-link\"\n".repeat(2).as_str()).unwrap();
        let said = load_devices(&twice).unwrap_err().to_string();
        assert!(said.contains("devices[1].name = two-link") && said.contains("--device ID="));
    }

    #[test]
    fn the_command_line_names_devices_too_and_a_path_with_an_equals_sign_is_a_path() {
        let over = |devices: &[&str]| Overrides {
            devices: devices.iter().map(ToString::to_string).collect(),
            ..Overrides::default()
        };
        let with = |text, devices: &[&str]| {
            ServerConfig::with_overrides(text, "f", over(devices)).map(|config| config.devices)
        };
        let text = "hand = \"circle\"\n[[devices]]\ndevice = \"cho-2005\"\n";
        let devices = with(text, &["left=two-link", "./a=b.toml"]).unwrap();
        assert_eq!(devices[0].name.as_ref().map(Id::as_str), Some("left"));
        assert_eq!((devices[0].source.as_str(), devices[0].hand.name()), ("two-link", "circle"));
        assert_eq!((&devices[1].name, devices[1].source.as_str()), (&None, "./a=b.toml"));
        let said = with("", &["Left=two-link"]).unwrap_err().to_string();
        assert!(said.contains("--device (before =) = \"Left\""), "{said}");
        let said = with("", &["two-link"; 9]).unwrap_err().to_string();
        assert!(said.contains("at most 8"), "{said}");
    }

    #[test]
    fn what_is_wrong_in_a_table_is_named_with_its_place() {
        for (text, named) in [
            ("[[devices]]\n", "devices[0]: missing field `device`"),
            ("[[devices]]\ndevice = \"a\"\nname = \"B\"", "devices[0].name = \"B\""),
            ("[[devices]]\ndevice = \"a\"\nhand = \"wave\"", "devices[0].hand = \"wave\""),
            ("[[devices]]\ndevice = \"a\"\nrt_cpu = -1", "devices[0].rt_cpu = -1"),
            ("device = \"b\"\n[[devices]]\ndevice = \"a\"", "device = \"b\": must not be there"),
        ] {
            let said = served(text).unwrap_err();
            assert!(said.contains(named), "{named}: {said}");
        }
    }
}
