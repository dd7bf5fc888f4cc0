//! The boards as their makers describe them, written down a second time, to be compared
//! with the images.
#![allow(clippy::unwrap_used, reason = "a name that is none is a mistake in this file")]

/// A pin: its port's letter and its number.
pub type Pin = (char, u8);

/// A board.
#[derive(Debug)]
pub struct BoardFacts {
    /// Name.
    pub name: &'static str,
    /// The profile that it is built with.
    pub profile: &'static str,
    /// Start of the board's image.
    pub image_address: u32,
    /// End of the flash for an image; settings are kept after it.
    pub flash_end: u32,
    /// File name of the plain bytes.
    pub bytes_file: &'static str,
    /// File name of Prusa's container, for a boot loader that takes one.
    pub container: Option<&'static str>,
    /// Frequency of its crystal, MHz.
    pub crystal_mhz: u32,
    /// Steps of X (A), Y (B), Z and E, then their directions.
    pub signals: [[&'static str; 4]; 2],
    /// True if a low direction signal is backwards.
    pub inverted: [bool; 4],
    /// True if each edge of a step signal is a step.
    pub both_edges: bool,
    /// Steps a millimetre of the profile that the board is built with.
    pub steps_per_mm: [i64; 4],
    /// True if X and Y move both of A and B in that profile.
    pub core_xy: bool,
    /// Enable pins of the motors that move, in their order; low = on.
    pub enable: [&'static str; 4],
    /// Enable pins of the other sockets.
    pub spare: &'static [&'static str],
    /// True if each driver has a separate line, at any pin.
    pub own_lines: bool,
    /// Heaters; high = on. Those of nozzle and bed are the first.
    pub heaters: &'static [&'static str],
    /// True if a timer switches those of nozzle and bed.
    pub heaters_are_timed: bool,
    /// Fans; high = on.
    pub fans: &'static [&'static str],
}

/// All boards that have names.
pub static BOARDS: [BoardFacts; 3] = [
    BoardFacts {
        name: "bench",
        profile: "cartesian",
        image_address: 0x0800_0000,
        flash_end: 0x080c_0000,
        bytes_file: "ferrostep.bin",
        container: None,
        crystal_mhz: 8,
        signals: [["C0", "C1", "C2", "C3"], ["C4", "C5", "C6", "C7"]],
        inverted: [false; 4],
        both_edges: false,
        steps_per_mm: [80, 80, 400, 95],
        core_xy: false,
        enable: ["C8"; 4],
        spare: &[],
        own_lines: false,
        heaters: &["A6", "A7"],
        heaters_are_timed: true,
        fans: &["B6", "B7"],
    },
    BoardFacts {
        name: "prusa-buddy",
        profile: "prusa-mini",
        image_address: 0x0802_0200,
        flash_end: 0x080c_0000,
        bytes_file: "ferrostep.bin",
        container: Some("ferrostep.bbf"),
        crystal_mhz: 12,
        signals: [["D1", "D13", "D4", "D9"], ["D0", "D12", "D15", "D8"]],
        inverted: [true, true, false, false],
        both_edges: true,
        steps_per_mm: [100, 100, 400, 325],
        core_xy: false,
        enable: ["D3", "D14", "D2", "D10"],
        spare: &[],
        own_lines: false,
        heaters: &["B1", "B0"],
        heaters_are_timed: true,
        fans: &["E11", "E9"],
    },
    BoardFacts {
        name: "btt-octopus-1.1",
        profile: "corexy",
        image_address: 0x0800_8000,
        flash_end: 0x0808_0000,
        bytes_file: "firmware.bin",
        container: None,
        crystal_mhz: 12,
        signals: [["F13", "G0", "F11", "F9"], ["F12", "G1", "G3", "F10"]],
        inverted: [false; 4],
        both_edges: true,
        steps_per_mm: [160, 160, 800, 400],
        core_xy: true,
        enable: ["F14", "F15", "G5", "G2"],
        spare: &["A0", "F1", "D4", "E0"],
        own_lines: true,
        heaters: &["A2", "A1", "A3", "B10", "B11"],
        heaters_are_timed: false,
        fans: &["A8", "E5", "D12", "D13", "D14", "D15"],
    },
];

impl BoardFacts {
    /// Returns true if the board is a printer's, with drivers for its motors.
    pub fn is_printer(&self) -> bool {
        self.name != "bench"
    }

    /// All enable pins, each once.
    pub fn all_enable(&self) -> Vec<Pin> {
        let mut pins: Vec<Pin> = self.enable.iter().chain(self.spare).map(|name| pin(name)).collect();
        pins.sort_unstable();
        pins.dedup();
        pins
    }

    /// The heaters' pins.
    pub fn heater_pins(&self) -> Vec<Pin> {
        self.heaters.iter().map(|name| pin(name)).collect()
    }
}

/// The pin of a name such as `B10`.
///
/// # Panics
/// The text is not a pin's name.
pub fn pin(name: &str) -> Pin {
    let (port, number) = name.split_at(1);
    (port.chars().next().unwrap(), number.parse().unwrap())
}
