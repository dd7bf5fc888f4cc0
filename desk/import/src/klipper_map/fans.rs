//! Klipper's fans.

use super::{Reading, profile_name};

/// Outputs for fans beside those for the part and for the hot end.
const OTHER_OUTPUTS: [&str; 4] = ["fan2", "fan3", "fan4", "fan5"];
const CHECK_OUTPUT: &str = "name the board's output that it is connected to: the import wrote the first free one";

impl<'a> Reading<'a> {
    pub(super) fn fans(&mut self) {
        self.kick_start("fan", "part");
        let mut free = OTHER_OUTPUTS.into_iter();
        let sections: Vec<&'a str> = self.config.sections.iter().map(|section| section.name.as_str()).collect();
        for section in sections {
            let (kind, name) = section.split_once(' ').unwrap_or((section, section));
            match kind {
                // A profile has one fan for the hot end, at the output of this name.
                "heater_fan" if self.entry(section, "heater").is_none_or(|entry| entry.value == "extruder") => {
                    self.keep(section, "heater", &["fans.hotend.turns"], "hotend", "");
                    self.kick_start(section, "hotend");
                }
                "controller_fan" | "fan_generic" => {
                    let Some(output) = free.next() else { continue };
                    let name = profile_name(name);
                    let turns = if kind == "controller_fan" { "controller" } else { "command" };
                    self.draft.put(&format!("fans.{name}.turns"), turns);
                    self.draft.put(&format!("fans.{name}.output"), output);
                    self.keep(section, "pin", &[&format!("fans.{name}.output")], output, CHECK_OUTPUT);
                    if kind == "controller_fan" {
                        self.keep_number(section, "fan_speed", &[&format!("fans.{name}.power")], |share| share);
                        self.keep_number(section, "idle_timeout", &[&format!("fans.{name}.idle_s")], |seconds| seconds);
                    }
                    self.kick_start(section, &name);
                }
                _ => {}
            }
        }
    }

    fn kick_start(&mut self, section: &str, fan: &str) {
        self.keep_number(section, "kick_start_time", &[&format!("fans.{fan}.kick_start_s")], |seconds| seconds);
    }
}
