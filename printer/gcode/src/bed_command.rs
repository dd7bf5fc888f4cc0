//! Commands that measure the bed and follow it.

use crate::Decimal;

/// A part of the bed, in the current unit. An end that is missing is the one of the whole bed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BedArea {
    /// L, or X: its left end.
    pub left: Option<Decimal>,
    /// R, or W: its right end, or its width.
    pub right: Option<Decimal>,
    /// F, or Y: its front end.
    pub front: Option<Decimal>,
    /// B, or H: its back end, or its height.
    pub back: Option<Decimal>,
    /// `right` and `back` are sizes, and none of the four is missing.
    pub is_size: bool,
}

/// G29, G30, G34, G35, G80, M48, M420, M421, M555 and Klipper's words for them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BedCommand {
    /// G29, G80, BED_MESH_CALIBRATE: measures the mesh, and Z follows it.
    Measure {
        /// Part of the bed to measure; `None`: all of it.
        area: Option<BedArea>,
        /// O: not if Z follows a mesh already.
        unless_on: bool,
    },
    /// M555: the part that the next [`Self::Measure`] without one measures.
    Area(BedArea),
    /// G30: probes the bed at one place.
    Probe {
        /// X of the probe; where it is without.
        x: Option<Decimal>,
        /// Y of the probe.
        y: Option<Decimal>,
    },
    /// M48, PROBE_ACCURACY: probes one place again and again.
    Repeat {
        /// P, SAMPLES: how often.
        samples: Option<u8>,
        /// X of the probe; where it is without.
        x: Option<Decimal>,
        /// Y of the probe.
        y: Option<Decimal>,
    },
    /// M420, G29 A, F and T: whether Z follows the mesh.
    Follow {
        /// S.
        on: Option<bool>,
        /// Z: at which height the correction has faded away; 0: it does not fade.
        fade: Option<Decimal>,
        /// V: reports the mesh.
        reports: bool,
    },
    /// M421 I J: the height of one point.
    SetPoint {
        /// I: its column.
        column: u8,
        /// J: its row.
        row: u8,
        /// Z, or Q: the height, or what is added to it.
        height: Decimal,
        /// Q.
        adds: bool,
    },
    /// G35, SCREWS_TILT_CALCULATE: probes the bed above its screws, and says by how
    /// much to turn each.
    Screws,
    /// G34, Z_TILT_ADJUST, QUAD_GANTRY_LEVEL: probes the bed, and moves each of Z's motors until it
    /// is level to the axes.
    Align {
        /// I, or RETRIES and one more: how often they may be moved.
        rounds: Option<u8>,
        /// T, RETRY_TOLERANCE: how far apart the points may be.
        accuracy: Option<Decimal>,
        /// A: by how many times the measured height they are moved.
        amplification: Option<Decimal>,
    },
    /// BED_MESH_CLEAR, G29 J: the mesh is forgotten.
    Clear,
}

impl BedCommand {
    /// True if Z may follow a mesh after it.
    pub const fn switches_on(&self) -> bool {
        matches!(self, Self::Measure { .. } | Self::Follow { on: Some(true), .. })
    }

    /// True if it moves the machine.
    pub const fn probes(&self) -> bool {
        matches!(
            self,
            Self::Measure { .. } | Self::Probe { .. } | Self::Repeat { .. } | Self::Screws | Self::Align { .. }
        )
    }

    /// True if it only reports.
    pub const fn is_query(&self) -> bool {
        matches!(self, Self::Follow { on: None, fade: None, .. })
    }

    /// True if a machine without a mesh already is as it asks.
    pub const fn asks_for_none(&self) -> bool {
        matches!(self, Self::Clear | Self::Follow { on: Some(false), .. })
    }
}
