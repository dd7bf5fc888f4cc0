//! The result as JSON and as text.

use std::fmt;

use ferrostep_host::printable::one_line;
use ferrostep_planner::{AxisShaper, ShaperKind};
use ferrostep_session::report::Stop;
use ferrostep_simulator::measures::Report;
use ferrostep_simulator::plan::Machine;
use serde::Serialize;

/// The frame and the nozzle, for the reader of the result.
#[derive(Clone, Debug, Serialize)]
pub struct SimulatedMachine {
    /// Frequencies of X and Y, Hz.
    pub frequency_hz: [f64; 2],
    /// Damping ratio.
    pub damping: f64,
    /// True if there is a second mode.
    pub second_mode: bool,
    /// The nozzle's time constant, s.
    pub nozzle_time_constant_s: f64,
    /// The nozzle's second slope: flow, mm^3/s, and time constant, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nozzle_second_slope: Option<[f64; 2]>,
}

impl From<&Machine> for SimulatedMachine {
    fn from(machine: &Machine) -> Self {
        Self {
            frequency_hz: machine.frame.frequency_hz,
            damping: machine.frame.damping,
            second_mode: machine.frame.second.is_some(),
            nozzle_time_constant_s: machine.nozzle.time_constant_s,
            nozzle_second_slope: machine.nozzle.second.map(|second| [second.above_mm3_per_s, second.time_constant_s]),
        }
    }
}

/// The filters of the steps when the job begins; its commands may set others.
#[derive(Clone, Debug, Serialize)]
pub struct SimulatedFilter {
    /// The kinds of X and Y.
    pub shaper: [String; 2],
    /// The frequencies that they are made for, Hz.
    pub shaper_frequency_hz: [f64; 2],
}

impl SimulatedFilter {
    /// Describes these filters; `None` if neither filters anything.
    pub fn of(shapers: &[AxisShaper; 2]) -> Option<Self> {
        shapers.iter().any(|shaper| shaper.kind != ShaperKind::None).then(|| Self {
            shaper: shapers.map(|shaper| shaper.kind.to_string()),
            shaper_frequency_hz: shapers.map(|shaper| shaper.frequency_hz),
        })
    }
}

/// The plan by other rules.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// The firmware with these rules.
    pub rules: &'static str,
    /// Name of the shaper.
    pub shaper: String,
    /// The frequencies its shapers are made for, Hz.
    pub shaper_frequency_hz: [f64; 2],
    /// Pressure advance, s.
    pub pressure_advance_s: f64,
    /// Measures of the error.
    #[serde(flatten)]
    pub report: Report,
}

/// The result of a simulation.
#[derive(Clone, Debug, Serialize)]
pub struct Simulated {
    /// The file.
    pub file: String,
    /// The firmware by whose rules the moves are planned, if it is another one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rules: Option<&'static str>,
    /// The machine's name; of a trace none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// `gcode`, `prepared` or `trace`.
    pub source: &'static str,
    /// The path measured against: `gcode` or `steps`.
    pub path: &'static str,
    /// Frame and nozzle.
    pub machine: SimulatedMachine,
    /// Excess of the frame's frequencies over those that the filters are made for,
    /// per cent, if given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detune_percent: Option<f64>,
    /// The filters of the steps when the job begins.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_shaper: Option<SimulatedFilter>,
    /// The measures.
    #[serde(flatten)]
    pub report: Report,
    /// The same job by other rules.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compared: Option<Compared>,
    /// Place at which the job stopped, and why.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<Stop>,
}

/// A line of the text: what it is, its unit, its value.
type Row = (&'static str, &'static str, fn(&Report) -> String);

const ROWS: [Row; 20] = [
    ("time", "s", |report| format!("{:.2}", report.time_s)),
    ("printing", "s", |report| format!("{:.2}", report.printing_time_s)),
    ("contour error, rms", "um", |report| format!("{:.1}", report.contour_error_um.rms)),
    ("contour error, 99 %", "um", |report| format!("{:.1}", report.contour_error_um.p99)),
    ("contour error, max", "um", |report| format!("{:.1}", report.contour_error_um.max)),
    ("ringing at stops, rms", "um", |report| format!("{:.1}", report.ringing.rms_um)),
    ("ringing at stops, max", "um", |report| format!("{:.1}", report.ringing.max_um)),
    ("ringing, of the unfiltered plan's", "%", |report| {
        report.ringing.relative.map_or_else(|| "-".to_owned(), |relative| format!("{:.1}", 100.0 * relative))
    }),
    ("stops", "", |report| report.ringing.stops.to_string()),
    ("misplaced at a corner", "mm^3", |report| format!("{:.4}", report.bead.corner_volume_mm3)),
    ("corners", "", |report| report.bead.corners.to_string()),
    ("misplaced at an end", "mm^3", |report| format!("{:.4}", report.bead.end_volume_mm3)),
    ("ends", "", |report| report.bead.ends.to_string()),
    ("misplaced elsewhere, in all", "mm^3", |report| format!("{:.2}", report.bead.elsewhere_volume_mm3)),
    ("oozed beside the lines, in all", "mm^3", |report| format!("{:.2}", report.bead.oozed_volume_mm3)),
    ("true acceleration, 99 %", "mm/s^2", |report| format!("{:.0}", report.true_acceleration_mm_per_s2.p99)),
    ("true acceleration, max", "mm/s^2", |report| format!("{:.0}", report.true_acceleration_mm_per_s2.max)),
    ("extruder, max speed", "mm/s", |report| format!("{:.1}", report.extruder.max_speed_mm_per_s)),
    ("extruder printing, max speed", "mm/s", |report| format!("{:.1}", report.extruder.max_printing_speed_mm_per_s)),
    ("extruder printing, max accel.", "mm/s^2", |report| {
        format!("{:.0}", report.extruder.max_printing_acceleration_mm_per_s2)
    }),
];

/// A frequency to the nearest millihertz, as percentages of others are seldom short.
fn hertz(frequency_hz: f64) -> f64 {
    (frequency_hz * 1e3).round() / 1e3
}

impl fmt::Display for Simulated {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let machine = &self.machine;
        let [x_hz, y_hz] = machine.frequency_hz.map(hertz);
        write!(out, "{}: frame {x_hz} and {y_hz} Hz", one_line(&self.file))?;
        if let Some(percent) = self.detune_percent {
            write!(out, " (moved by {percent} % from what the filters are made for)")?;
        }
        writeln!(
            out,
            ", damping {}{}; nozzle {} s; path of the {}",
            machine.damping,
            if machine.second_mode { ", second mode" } else { "" },
            machine.nozzle_time_constant_s,
            if self.path == "gcode" { "G-code" } else { "steps themselves" },
        )?;
        if let Some(rules) = self.rules {
            writeln!(out, "  planned by {rules}")?;
        }
        if let Some(SimulatedFilter { shaper: [x, y], shaper_frequency_hz }) = &self.input_shaper {
            let [x_hz, y_hz] = shaper_frequency_hz.map(hertz);
            writeln!(out, "  filters of the steps: X {x} for {x_hz} Hz, Y {y} for {y_hz} Hz")?;
        }
        if let Some(compared) = &self.compared {
            writeln!(out, "  {:34} {:>12} {:>12}  {}", "", "steps", compared.rules, compared.shaper)?;
        }
        for (name, unit, value) in ROWS {
            write!(out, "  {name:34} {:>12}", value(&self.report))?;
            if let Some(compared) = &self.compared {
                write!(out, " {:>12}", value(&compared.report))?;
            }
            writeln!(out, "  {unit}")?;
        }
        Ok(())
    }
}
