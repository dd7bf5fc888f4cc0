//! The nodes of the executed path.

/// The layer of a node where the file marks none: the record counts them by height.
pub(crate) const UNMARKED: u32 = u32::MAX;

/// Kind of motion between the node before and this one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Kind {
    /// The nozzle moves without filament.
    #[default]
    Travel = 0,
    /// The nozzle moves and lays filament.
    Print = 1,
    /// The filament alone is drawn back.
    Retract = 2,
    /// The filament alone is pushed.
    Prime = 3,
    /// The printer homes or probes.
    Homing = 4,
    /// The printer waits for a heater.
    Heating = 5,
    /// The printer waits for something else.
    Wait = 6,
}

impl Kind {
    /// All kinds, in the order of their numbers.
    pub const ALL: [Self; 7] =
        [Self::Travel, Self::Print, Self::Retract, Self::Prime, Self::Homing, Self::Heating, Self::Wait];

    /// Returns true if the nozzle moves.
    pub const fn moves(self) -> bool {
        matches!(self, Self::Travel | Self::Print | Self::Homing)
    }
}

/// The end of a part of the path, which is straight, and whose speed changes evenly along it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Node {
    /// Time at which it is reached, s from the first line on.
    pub time_s: f64,
    /// Position of the nozzle then, mm.
    pub position_mm: [f32; 3],
    /// The nozzle's speed then.
    pub speed_mm_per_s: f32,
    /// Filament for each mm of path, mm^2, for a part that prints, or that travels while it draws
    /// filament back; for filament alone its length, mm.
    pub bead: f32,
    /// Height and width of the bead by the slicer's comments, mm; 0 where they are unknown.
    pub height_mm: f32,
    /// See `height_mm`.
    pub width_mm: f32,
    /// The volume that is compressed in the nozzle then, mm^3; negative: the gap
    /// after a retraction.
    pub pressure_mm3: f32,
    /// Distance from the path that the lines ask for, mm: what input shaping and corners take off.
    /// 0 if that path is unknown.
    pub deviation_mm: f32,
    /// True if the part's move was slowed because the board could not keep up with it.
    pub is_slowed: bool,
    /// True if the job stopped before the part, which lies where its line asks for.
    pub is_rest: bool,
    /// Number of the limit that holds the part's speed, in the page's list of their names, from 1;
    /// 0: unknown.
    pub limit: u8,
    /// The speed that the line asks for, mm/s; 0 if unknown.
    pub feed_mm_per_s: f32,
    /// Number of the line in the file.
    pub line: u32,
    /// Layer, from 0; 0 also before the first.
    pub layer: u32,
    /// Kind of the part.
    pub kind: Kind,
    /// Number of the feature in the list of their names.
    pub feature: u8,
    /// The tool.
    pub tool: u8,
}

impl Node {
    /// Distance to another node, mm.
    pub(crate) fn distance_mm(&self, other: &Self) -> f64 {
        let squares = self.position_mm.iter().zip(other.position_mm).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
        squares.sum::<f64>().sqrt()
    }

    /// Filament that flows in at this node, mm^3/s.
    pub fn flow_mm3_per_s(&self) -> f32 {
        if self.kind == Kind::Print { self.speed_mm_per_s * self.bead } else { 0.0 }
    }
}
