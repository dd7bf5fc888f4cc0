//! Observes a rehearsal for remarks that no single line shows.

use std::rc::Rc;

use ferrostep_hal_shim::Heater;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_printer::{Heating, Ports, Printer, Profile, Tally};

use crate::command_code::code;
use crate::job::Onlooker;
use crate::remarks::{RemarkKind, RemarkList};
use crate::rules::Refusals;

/// Commands that wait for a person: pauses, and filament changes.
const PAUSES: [&str; 8] = ["M0", "M1", "M25", "M125", "M226", "M600", "M601", "PAUSE"];

/// Returns true if a command asks the printer to wait for a person.
pub fn is_pause(text: &str) -> bool {
    text.starts_with(['M', 'm', 'P', 'p']) && PAUSES.iter().any(|pause| pause.eq_ignore_ascii_case(code(text)))
}

/// Units of 10 nm in a mm.
const UNITS_PER_MM: f64 = 100_000.0;

/// Notes remarks about the lines of a job.
#[derive(Debug)]
pub struct Watch<'a> {
    remarks: &'a RemarkList,
    max_flow_mm3_per_s: Option<f64>,
    /// Cross-section of the filament.
    filament_mm2: f64,
    line: u32,
    is_arc: bool,
    tally: Tally,
    position_10nm: [i64; 4],
    /// The line that asks for the greatest flow, and that flow, mm^3/s.
    most: Option<(u32, f64)>,
    refusals: Option<Rc<Refusals>>,
}

impl<'a> Watch<'a> {
    /// Watches a job on this machine.
    pub fn new(profile: &Profile, remarks: &'a RemarkList) -> Self {
        let diameter_mm = profile.extrusion.filament_diameter_10nm as f64 / UNITS_PER_MM;
        Self {
            remarks,
            max_flow_mm3_per_s: profile.max_volumetric_flow_mm3_per_s.map(f64::from),
            filament_mm2: std::f64::consts::PI / 4.0 * diameter_mm * diameter_mm,
            line: 0,
            is_arc: false,
            tally: Tally::default(),
            position_10nm: [0; 4],
            most: None,
            refusals: None,
        }
    }

    /// The same with remarks about commands that another firmware does not have or refuses.
    #[must_use]
    pub fn with_refusals(self, refusals: Option<Rc<Refusals>>) -> Self {
        Self { refusals, ..self }
    }

    /// Adds the remark about a text without commands; one that was not read to its end may have
    /// them. A prepared job, whose lines are not watched, has none.
    pub fn end_of_text(&self, is_whole: bool) {
        if is_whole && self.line == 0 {
            let message = "no line of the file is a command: is it the one that was meant?";
            self.remarks.note(RemarkKind::NoCommands, None, message);
        }
    }

    /// Adds the remarks about the end of a job; of one that `has_ended`, not of one that stopped on
    /// its way, those about heaters and motors left on.
    pub fn end(&self, heating: &impl Heating, has_ended: bool) {
        for heater in Heater::ALL.into_iter().filter(|_| has_ended) {
            let celsius = heating.status(heater).target_celsius;
            if celsius > 0.0 {
                let (name, code) = match heater {
                    Heater::Nozzle => ("nozzle", "M104"),
                    Heater::Bed => ("bed", "M140"),
                    Heater::Chamber => ("chamber", "M141"),
                    Heater::Nozzle1 => ("nozzle of T1", "M104 T1"),
                };
                let message = format!("the {name} is still on at the end, at {celsius} C: end the job with {code} S0");
                self.remarks.note(RemarkKind::HeaterOn, None, message);
            }
        }
        if let (Some(limit), Some((line, flow))) = (self.max_flow_mm3_per_s, self.most) {
            let message = format!(
                "moves ask for more filament than the nozzle melts ({limit} mm^3/s, max_volumetric_flow_mm3_per_s): at most \
                 {flow:.1} mm^3/s, in line {line}"
            );
            self.remarks.note(RemarkKind::Flow, Some(line), message);
        }
    }

    /// The flow that a move asks for by its feed, mm^3/s.
    fn flow<P: Ports>(&self, printer: &Printer<'_, P>, tally: &Tally, position_10nm: &[i64; 4]) -> Option<f64> {
        let filament_mm = (tally.filament_100pm - self.tally.filament_100pm) as f64 / FILAMENT_UNITS_PER_MM as f64;
        let squares = (0..3).map(|axis| (position_10nm[axis] - self.position_10nm[axis]) as f64 / UNITS_PER_MM);
        let path_mm = squares.map(|side_mm| side_mm * side_mm).sum::<f64>().sqrt();
        let is_drawing = filament_mm > 0.0 && path_mm > 0.0;
        is_drawing.then(|| filament_mm * self.filament_mm2 * printer.feed_mm_per_s() / path_mm)
    }
}

impl<P: Ports> Onlooker<P> for Watch<'_> {
    fn begins(&mut self, _: &Printer<'_, P>, line: u32, text: &str) {
        self.line = line;
        self.is_arc = ["G2", "G3", "G02", "G03"].iter().any(|arc| arc.eq_ignore_ascii_case(code(text)));
        if is_pause(text) {
            let message = format!("{} asks the printer to wait for a person", code(text));
            self.remarks.note(RemarkKind::Pause, Some(line), message);
        }
    }

    fn ended(&mut self, printer: &Printer<'_, P>) {
        let tally = printer.tally();
        let position_10nm = printer.logical_10nm();
        if tally.clamped_moves != self.tally.clamped_moves {
            let message = if self.is_arc {
                "the arc leaves the travel and is drawn in to its edge"
            } else {
                "the target lies outside the travel and is drawn in to its edge"
            };
            self.remarks.note(RemarkKind::SoftLimit, Some(self.line), message);
        }
        if tally.unhomed_moves != self.tally.unhomed_moves {
            let message = "an axis moves that is not homed: its position is unknown, and no limit stops it";
            self.remarks.note(RemarkKind::NotHomed, Some(self.line), message);
        }
        if let Some(limit) = self.max_flow_mm3_per_s
            && let Some(flow) = self.flow(printer, &tally, &position_10nm)
            && flow > limit.max(self.most.map_or(0.0, |(_, most)| most))
        {
            self.most = Some((self.line, flow));
        }
        while let Some(message) = self.refusals.as_ref().and_then(|refusals| refusals.take()) {
            self.remarks.note(RemarkKind::Foreign, Some(self.line), message);
        }
        self.tally = tally;
        self.position_10nm = position_10nm;
    }

    fn remarked(&mut self, kind: RemarkKind, line: u32, message: &str) {
        self.remarks.note(kind, Some(line), message);
    }
}
