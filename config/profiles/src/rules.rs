//! The firmware by whose rules a print's time is planned, and those of its limits that
//! no other key has.

use ferrostep_checked_toml::{Range, Section, range};

use crate::axes::MOTORS;

const RATIO: Range = range(0.0, 0.99, "");
const JERK: Range = range(0.001, 1_000.0, "mm/s");
const CHORD: Range = range(0.01, 10.0, "mm");
const BLOCKS: Range = range(4.0, 4_096.0, "moves");

/// Rules by which a print's time is planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlannedBy {
    /// The rules of this firmware.
    Own,
    /// Klipper's and Kalico's.
    Klipper,
    /// Marlin's with junction deviation.
    MarlinJunctionDeviation,
    /// Marlin's with classic jerk.
    MarlinClassicJerk,
    /// RepRapFirmware's.
    Rrf,
}

impl PlannedBy {
    /// All rules with their names, as `--rules` and `rules.planned_by` have them.
    pub const NAMED: [(&'static str, Self); 5] = [
        ("own", Self::Own),
        ("klipper", Self::Klipper),
        ("marlin-junction-deviation", Self::MarlinJunctionDeviation),
        ("marlin-classic-jerk", Self::MarlinClassicJerk),
        ("rrf", Self::Rrf),
    ];

    /// The rules of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::NAMED.into_iter().find(|(known, _)| *known == name).map(|(_, rules)| rules)
    }

    /// The name.
    pub fn name(self) -> &'static str {
        Self::NAMED.into_iter().find(|(_, rules)| *rules == self).map_or("", |(name, _)| name)
    }
}

/// The part of a profile that only the rules of other firmwares need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RuleKeys {
    /// The rules that hold where a command names none.
    pub planned_by: PlannedBy,
    /// Speed in a corner of 90 degrees at every acceleration, mm/s, where the profile
    /// says it (Klipper).
    pub square_corner_velocity_mm_per_s: Option<f64>,
    /// Share of a short move that is not spent on accelerating, 0 to less than 1 (Klipper).
    pub minimum_cruise_ratio: f64,
    /// Change of the speed of X, Y, Z and E at a corner, mm/s (Marlin's classic jerk,
    /// RepRapFirmware).
    pub jerk_mm_per_s: Option<[f64; 4]>,
    /// Length of the chords that arcs are cut into, mm (Klipper, Marlin).
    pub arc_chord_mm: f64,
    /// Moves that the firmware plans together; `None`: as many as it has by itself (Marlin,
    /// RepRapFirmware).
    pub queued_moves: Option<usize>,
    /// True if moves of different kinds join without a stop (RepRapFirmware).
    pub joins_all_kinds: bool,
}

/// The rules of a profile. They bind no prepared job.
pub(crate) fn read(keys: &Section<'_>, square_corner_velocity_mm_per_s: Option<f64>) -> RuleKeys {
    let table = keys.apart().section_of_defaults(
        "rules",
        "the firmware [by whose rules](rules.md) `estimate` and `sweep` plan a file, and those of its limits that no other key has",
    );
    let planned_by = table
        .word("planned_by", PlannedBy::NAMED)
        .or(PlannedBy::Own, "firmware, unless `--rules` names another; `import` writes this key; `own`: this firmware");
    let minimum_cruise_ratio =
        table.number("minimum_cruise_ratio", RATIO).or(0.5, "Klipper's: minimum share of a short move at cruise speed");
    let jerk_mm_per_s = table.numbers("jerk_mm_per_s", MOTORS, [JERK; 4]).optional(
        "`instantaneous_corner_velocity_mm_per_s`, or 10 where that has no limit",
        "Marlin's classic jerk and RepRapFirmware's M566: maximum speed change of an axis at a corner",
    );
    let arc_chord_mm = table
        .number("arc_chord_mm", CHORD)
        .or(1.0, "chord length of arcs: Klipper's `resolution` of `[gcode_arcs]`, Marlin's `MAX_ARC_SEGMENT_MM`");
    let queued_moves = table.whole("queued_moves", BLOCKS).optional(
        "16 for Marlin, 60 for RepRapFirmware",
        "moves that are planned together: Marlin's `BLOCK_BUFFER_SIZE`, RepRapFirmware's M595 P",
    );
    let joins_all_kinds = table
        .flag("joins_all_kinds")
        .or(false, "RepRapFirmware's M566 P1: no stop between moves that print, travel, retract or lift");
    RuleKeys {
        planned_by,
        square_corner_velocity_mm_per_s,
        minimum_cruise_ratio,
        jerk_mm_per_s,
        arc_chord_mm,
        queued_moves: queued_moves.map(|count| count as usize),
        joins_all_kinds,
    }
}
