//! A host's numbered lines, and the buffers of a port that receives bytes.

use std::collections::VecDeque;

use ferrostep_gcode::Emergency;
use ferrostep_gcode::meatpack::Settings;
use ferrostep_usb::Buffers;

/// A line as hosts number it, with its checksum and without a line end.
pub fn numbered(number: impl Into<i64>, text: &str) -> String {
    let number = number.into();
    let line = format!("N{number} {text}");
    format!("{line}*{}", checksum(&line))
}

/// The checksum of a line: all its bytes, by exclusive or.
pub fn checksum(line: &str) -> u8 {
    line.bytes().fold(0, |sum, byte| sum ^ byte)
}

/// The buffers of a port's interrupt. The port sends nothing.
#[derive(Debug)]
pub struct PortBuffers {
    /// Bytes that wait to be read.
    pub bytes: VecDeque<u8>,
    /// The most of them that fit.
    pub room: usize,
    /// Commands that acted before they were read, in their order.
    pub emergencies: Vec<Emergency>,
    /// Reports on the host's packing, in their order.
    pub reports: Vec<Settings>,
}

impl Default for PortBuffers {
    /// Starts empty, with room for everything.
    fn default() -> Self {
        Self { bytes: VecDeque::new(), room: usize::MAX, emergencies: Vec::new(), reports: Vec::new() }
    }
}

impl Buffers for PortBuffers {
    fn put(&mut self, byte: u8) -> bool {
        let fits = self.bytes.len() < self.room;
        if fits {
            self.bytes.push_back(byte);
        }
        fits
    }

    fn take(&mut self) -> Option<u8> {
        None
    }

    fn emergency(&mut self, emergency: Emergency) {
        self.emergencies.push(emergency);
    }

    fn report_packing(&mut self, settings: Settings) {
        self.reports.push(settings);
    }
}
