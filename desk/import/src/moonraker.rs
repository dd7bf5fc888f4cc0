//! The configuration of a running Klipper, as its server Moonraker has it.

use std::fmt;
use std::marker::PhantomData;

use ferrostep_host::printable::one_line;
use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::Value;

use crate::error::ImportError;
use crate::http::{self, Answer, ApiKey, Url};
use crate::imported::Imported;
use crate::{klipper, klipper_map};

/// The request for all that Klipper reports of its configuration.
const PATH: &str = "/printer/objects/query?configfile";

/// Asks a printer for its configuration, and makes a profile of it as of a file.
///
/// # Errors
/// The printer does not answer, or not with a configuration; or as [`read`](crate::read).
pub fn read_moonraker(url: &Url, key: Option<&ApiKey>, assume: bool) -> Result<Imported, ImportError> {
    let name = url.to_string();
    let answer = http::get(url, PATH, key).map_err(|error| ImportError::Read(name.clone(), error))?;
    let text = text_of(&answer).map_err(|error| ImportError::Read(name.clone(), error))?;
    of_configfile(&name, &text, assume)
}

/// Makes a profile of settings as [`text_of`] writes them.
fn of_configfile(name: &str, text: &str, assume: bool) -> Result<Imported, ImportError> {
    // Klipper has read what a file includes.
    let config = klipper::parse(name, text, &mut |_| Err("a printer's settings include no files".to_owned()))?;
    if config.section("printer").is_none() {
        let what = "Klipper has no section [printer]: has it read its configuration? Look at its page, and RESTART it";
        return Err(ImportError::Read(name.to_owned(), what.to_owned()));
    }
    klipper_map::map(&config, assume)
}

/// The parts of an answer that are read.
#[derive(Deserialize)]
struct Reply {
    result: Option<Status>,
    error: Option<Problem>,
}

#[derive(Deserialize)]
struct Status {
    status: Objects,
}

#[derive(Deserialize)]
struct Objects {
    configfile: Option<ConfigFile>,
}

#[derive(Deserialize)]
struct ConfigFile {
    config: InOrder<InOrder<Value>>,
}

#[derive(Deserialize)]
struct Problem {
    message: String,
}

/// An object of JSON whose keys stay in their order, on which fans and macros depend.
struct InOrder<T>(Vec<(String, T)>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for InOrder<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Keys<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Keys<T> {
            type Value = InOrder<T>;

            fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
                out.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<InOrder<T>, A::Error> {
                let mut keys = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    keys.push(entry);
                }
                Ok(InOrder(keys))
            }
        }
        deserializer.deserialize_map(Keys(PhantomData))
    }
}

/// The configuration in an answer, in the form of Klipper's files.
fn text_of(answer: &Answer) -> Result<String, String> {
    let reply = serde_json::from_slice::<Reply>(&answer.body);
    let message =
        reply.as_ref().ok().and_then(|reply| reply.error.as_ref()).map(|error| one_line(&error.message).into_owned());
    let said = message.as_deref().map(|message| format!(": {message}")).unwrap_or_default();
    match answer.status {
        200 => {}
        301 | 302 | 303 | 307 | 308 => {
            let place = answer.location.as_deref().unwrap_or("elsewhere");
            return Err(format!(
                "the server sends to {}: give Moonraker's own address, http://HOST:7125",
                one_line(place)
            ));
        }
        401 | 403 => {
            return Err(format!(
                "Moonraker wants a login (status {}{said}): add this computer to trusted_clients under [authorization] in \
                 moonraker.conf, give its key with --api-key, or copy printer.cfg and import the file",
                answer.status
            ));
        }
        404 => {
            return Err(format!(
                "no Moonraker answers there (status 404{said}): give its address, http://HOST:7125; or copy printer.cfg and \
                 import the file"
            ));
        }
        502..=504 => {
            return Err(format!(
                "Klipper is not running (status {}{said}): start it, look at the error on its page, and try again",
                answer.status
            ));
        }
        status => {
            return Err(format!("Moonraker refuses (status {status}{said}): copy printer.cfg and import the file"));
        }
    }
    let reply = reply.map_err(|error| match error.classify() {
        serde_json::error::Category::Data => {
            format!(
                "the answer has no configuration of Klipper's ({error}): is this Moonraker's address, http://HOST:7125?"
            )
        }
        _ => format!("the answer is no JSON ({error}): is this Moonraker's address, http://HOST:7125?"),
    })?;
    if let Some(message) = message {
        return Err(format!("Moonraker refuses: {message}"));
    }
    let config = reply.result.and_then(|result| result.status.configfile).map(|file| file.config);
    let Some(config) = config.filter(|config| !config.0.is_empty()) else {
        return Err(
            "Klipper has no configuration: it is not ready; look at the error on its page, mend it, and RESTART"
                .to_owned(),
        );
    };
    let mut text = String::new();
    for (section, settings) in config.0 {
        if section.is_empty() || section.contains(['\n', '\r']) || section.trim_start().starts_with("include ") {
            return Err(format!("{:?} cannot name a section of Klipper's: try again", crate::text::shown(&section)));
        }
        text += &format!("[{section}]\n");
        for (key, value) in settings.0 {
            if key.trim() != key || key.is_empty() || key.contains([':', '=', '#', ';', '[', ']', '\n', '\r']) {
                return Err(format!(
                    "[{section}] {:?} cannot name a setting of Klipper's: try again",
                    crate::text::shown(&key)
                ));
            }
            let value = match value {
                Value::String(value) => value.replace("\r\n", "\n").replace('\r', "\n"),
                Value::Null => String::new(),
                other => other.to_string(),
            };
            // Lines after the first continue where they are indented.
            text += &format!("{key}: {}\n", value.replace('\n', "\n    "));
        }
    }
    Ok(text)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn text(status: u16, body: &str) -> Result<String, String> {
        text_of(&Answer { status, location: None, body: body.as_bytes().to_vec() })
    }

    fn of_config(config: &str) -> Result<String, String> {
        text(200, &format!(r#"{{"result": {{"eventtime": 1.5, "status": {{"configfile": {{"config": {config}}}}}}}}}"#))
    }

    #[test]
    fn settings_keep_their_order_and_their_lines() {
        let config = r#"{"printer": {"kinematics": "corexy"}, "gcode_macro B": {"gcode": "\nG28\n  G1 X5\n[x]\n\ty: 1"},
            "fan": {"max_power": 1.0}, "fan_generic a": {}}"#;
        let text = of_config(config).unwrap();
        assert_eq!(
            text,
            "[printer]\nkinematics: corexy\n[gcode_macro B]\ngcode: \n    G28\n      G1 X5\n    [x]\n    \ty: 1\n[fan]\n\
             max_power: 1.0\n[fan_generic a]\n"
        );
        let config = klipper::parse("x", &text, &mut |_| Err(String::new())).unwrap();
        let gcode = config.section("gcode_macro B").unwrap().entry("gcode").unwrap();
        assert_eq!(gcode.value, "\nG28\nG1 X5\n[x]\ny: 1");
        assert_eq!(config.sections.len(), 4);
    }

    #[test]
    fn answers_without_a_configuration_say_what_to_do() {
        for (status, body, expected) in [
            (404, "not found", "no Moonraker answers there (status 404): give its address"),
            (
                401,
                r#"{"error": {"code": 401, "message": "Unauthorized"}}"#,
                "(status 401: Unauthorized): add this computer",
            ),
            (
                503,
                r#"{"error": {"code": 503, "message": "Klippy Host not connected"}}"#,
                "503: Klippy Host not connected): start it",
            ),
            (500, "", "Moonraker refuses (status 500)"),
            (301, "", "give Moonraker's own address"),
            (200, "<html>", "the answer is no JSON"),
            (200, "", "the answer is no JSON"),
            (200, "[]", "no configuration of Klipper's"),
            (200, r#"{"result": {"status": {}}}"#, "it is not ready"),
            (200, r#"{"result": {"status": {"configfile": {"config": {}}}}}"#, "it is not ready"),
            (200, r#"{"result": {"status": {"configfile": {"settings": {}}}}}"#, "no configuration of Klipper's"),
            (200, r#"{"result": "ok"}"#, "no configuration of Klipper's"),
            (200, r#"{"error": {"message": "x\ny"}}"#, "Moonraker refuses: x"),
        ] {
            let error = text(status, body).unwrap_err();
            assert!(error.contains(expected) && !error.contains('\n'), "{status} {body}: {error}");
        }
        for config in [
            r#"{"a\n[printer]": {}}"#,
            r#"{"include /etc/passwd": {}}"#,
            r#"{"a": {"b\n[printer]": "1"}}"#,
            r##"{"a": {"#b": "1"}}"##,
            r#"{"a": {"": "1"}}"#,
        ] {
            assert!(of_config(config).unwrap_err().contains("of Klipper's: try again"), "{config}");
        }
        let error = of_configfile("http://x", "[mcu]\nserial: x\n", false).unwrap_err().to_string();
        assert!(error.starts_with("http://x: cannot be read: Klipper has no section [printer]"), "{error}");
    }
}
