//! Actions that a person can take at the machine, and the lines of G-code for them.

use serde::Deserialize;

/// Maximum move for one press of a button, mm.
const MAX_JOG_MM: f64 = 100.0;

/// Maximum change of the nozzle height for one press, mm.
const MAX_OFFSET_MM: f64 = 0.5;

/// Maximum length of filament for one press, mm.
const MAX_FILAMENT_MM: f64 = 50.0;

/// Speeds of X and Y moves, Z moves, and filament, mm/min.
const JOG_MM_PER_MIN: u32 = 3000;
const LIFT_MM_PER_MIN: u32 = 300;
const FILAMENT_MM_PER_MIN: u32 = 180;

/// An axis of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// X.
    X,
    /// Y.
    Y,
    /// Z.
    Z,
}

/// Press of a button on the page.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Control {
    /// Homes all axes.
    Home {},
    /// Moves an axis relative to its current position.
    Jog {
        /// The axis.
        axis: Axis,
        /// Distance, mm.
        mm: f64,
    },
    /// Sets the target temperatures of nozzle and bed, °C; 0 means off.
    Heat {
        /// Target of the nozzle, °C.
        nozzle_celsius: u16,
        /// Target of the bed, °C.
        bed_celsius: u16,
    },
    /// Sets the part cooling fan.
    Fan {
        /// Speed, 0 to 100 %.
        percent: u8,
    },
    /// Raises or lowers the nozzle relative to the path, until the next homing.
    Offset {
        /// Change of the height, mm; up is positive.
        mm: f64,
    },
    /// Feeds filament or draws it back.
    Filament {
        /// Length, mm; feeding is positive.
        mm: f64,
    },
}

impl Control {
    /// Parses a control sent by the page.
    ///
    /// # Errors
    /// The text is not a control, or its value is out of range.
    pub fn read(text: &[u8]) -> Result<Self, String> {
        let control: Self = serde_json::from_slice(text).map_err(|error| format!("not a control: {error}"))?;
        let within = |value: f64, most: f64, what: &str| {
            let is_within = value != 0.0 && value.abs() <= most;
            if is_within { Ok(()) } else { Err(format!("{what} of {value} mm: expected at most {most} mm, and not 0")) }
        };
        match control {
            Self::Jog { mm, .. } => within(mm, MAX_JOG_MM, "a move")?,
            Self::Offset { mm } => within(mm, MAX_OFFSET_MM, "a change of the height")?,
            Self::Filament { mm } => within(mm, MAX_FILAMENT_MM, "a piece of filament")?,
            Self::Fan { percent } if percent > 100 => return Err(format!("a fan at {percent} %: expected 0 to 100 %")),
            Self::Home {} | Self::Heat { .. } | Self::Fan { .. } => {}
        }
        Ok(control)
    }

    /// Returns true if the control may be used during a print: it changes neither the path nor the
    /// temperatures that the file sets.
    #[must_use]
    pub const fn acts_in_a_print(self) -> bool {
        matches!(self, Self::Fan { .. } | Self::Offset { .. })
    }

    /// Returns the lines of G-code, which must be sent together.
    #[must_use]
    pub fn lines(self) -> Vec<String> {
        // OctoPrint does the same: relative positioning, the move, absolute positioning.
        let relative = |line: String| vec!["G91".to_owned(), line, "G90".to_owned()];
        match self {
            Self::Home {} => vec!["G28".to_owned()],
            Self::Jog { axis: Axis::X, mm } => relative(format!("G1 X{mm} F{JOG_MM_PER_MIN}")),
            Self::Jog { axis: Axis::Y, mm } => relative(format!("G1 Y{mm} F{JOG_MM_PER_MIN}")),
            Self::Jog { axis: Axis::Z, mm } => relative(format!("G1 Z{mm} F{LIFT_MM_PER_MIN}")),
            Self::Heat { nozzle_celsius, bed_celsius } => {
                vec![format!("M104 S{nozzle_celsius}"), format!("M140 S{bed_celsius}")]
            }
            Self::Fan { percent: 0 } => vec!["M107".to_owned()],
            Self::Fan { percent } => vec![format!("M106 S{}", u16::from(percent) * 255 / 100)],
            Self::Offset { mm } => vec![format!("M290 Z{mm}")],
            Self::Filament { mm } => relative(format!("G1 E{mm} F{FILAMENT_MM_PER_MIN}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Result<Vec<String>, String> {
        Control::read(text.as_bytes()).map(Control::lines)
    }

    #[test]
    fn each_control_has_its_lines() {
        for (text, expected) in [
            (r#"{"do":"home"}"#, &["G28"][..]),
            (r#"{"do":"jog","axis":"x","mm":-10}"#, &["G91", "G1 X-10 F3000", "G90"]),
            (r#"{"do":"jog","axis":"z","mm":0.1}"#, &["G91", "G1 Z0.1 F300", "G90"]),
            (r#"{"do":"heat","nozzle_celsius":215,"bed_celsius":60}"#, &["M104 S215", "M140 S60"]),
            (r#"{"do":"fan","percent":50}"#, &["M106 S127"]),
            (r#"{"do":"fan","percent":100}"#, &["M106 S255"]),
            (r#"{"do":"fan","percent":0}"#, &["M107"]),
            (r#"{"do":"offset","mm":-0.05}"#, &["M290 Z-0.05"]),
            (r#"{"do":"filament","mm":5}"#, &["G91", "G1 E5 F180", "G90"]),
        ] {
            assert_eq!(
                lines(text).as_deref(),
                Ok(expected.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>().as_slice()),
                "{text}"
            );
        }
    }

    #[test]
    fn what_is_no_control_or_too_far_is_refused() {
        for text in [
            "",
            "G28",
            r#"{"do":"jump"}"#,
            r#"{"do":"home","axis":"x"}"#,
            r#"{"do":"jog","axis":"e","mm":1}"#,
            r#"{"do":"jog","axis":"x","mm":0}"#,
            r#"{"do":"jog","axis":"x","mm":100.5}"#,
            r#"{"do":"jog","axis":"x","mm":"1\nM112"}"#,
            r#"{"do":"fan","percent":101}"#,
            r#"{"do":"fan","percent":-1}"#,
            r#"{"do":"offset","mm":1}"#,
            r#"{"do":"filament","mm":1e9}"#,
        ] {
            assert!(lines(text).is_err(), "{text}");
        }
    }
}
