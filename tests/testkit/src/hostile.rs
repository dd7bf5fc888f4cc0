//! Programs that no slicer writes: moves of half a micrometre to a third of a millimetre, in lines
//! and curves, at all speeds, on machines of any resolution.
//!
//! Each is made from a number, so that a program that once failed can be made again. This module
//! does not use the planner.

use std::fmt::Write as _;

/// SplitMix64 (Steele, Lea, Flood 2014): a seed gives the same numbers everywhere.
#[derive(Clone, Copy, Debug)]
pub struct Random(u64);

impl Random {
    /// Starts from a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number.
    pub fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = self.0;
        word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        word ^ word >> 31
    }

    /// Returns a number from 0 to less than `end`.
    pub fn below(&mut self, end: u64) -> u64 {
        self.word() % end.max(1)
    }

    /// Returns a number from 0 to less than 1.
    pub fn share(&mut self) -> f64 {
        (self.word() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a number from one to another, evenly over the orders of magnitude.
    pub fn magnitude(&mut self, least: f64, most: f64) -> f64 {
        least * (most / least).powf(self.share())
    }

    /// Returns one of these.
    pub fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u64) as usize]
    }
}

/// A program and the machine that it is for.
#[derive(Clone, Debug)]
pub struct Hostile {
    /// The machine, as a profile's TOML.
    pub profile: String,
    /// Blocks in its look-ahead ring.
    pub look_ahead: usize,
    /// True if its acceleration is the trapezoid's.
    pub is_trapezoid: bool,
    /// The G-code.
    pub text: String,
}

impl Hostile {
    /// The program of this number, with this many moves or a few more.
    pub fn new(seed: u64, moves: usize) -> Self {
        let mut random = Random::new(seed);
        let acceleration = random.one_of(&["trapezoid", "trapezoid", "trapezoid", "s-curve", "s-curve-table"]);
        let profile = machine(&mut random, acceleration);
        let look_ahead = random.one_of(&[2, 3, 5, 16, 128, 128]);
        let text = Writer::new(random).program(moves);
        Self { profile, look_ahead, is_trapezoid: acceleration == "trapezoid", text }
    }
}

/// A machine of any resolution, 200 mm wide.
fn machine(random: &mut Random, acceleration: &str) -> String {
    let kinematics = random.one_of(&["cartesian", "corexy", "corexz"]);
    let mut steps = [(); 4].map(|()| random.magnitude(20.0, 1_600.0));
    if random.below(2) == 0 {
        steps = [80.0, 80.0, 400.0, 95.0];
    } else if random.below(2) == 0 {
        steps = steps.map(f64::round);
    }
    let steps = steps.map(|steps| (steps * 100.0).round() / 100.0);
    // The motors of X and Y are alike, as in real machines.
    let [x, _, z, e] = steps;
    // Within the minimum event interval; an axis of CoreXY uses both motors.
    let [feed_x, feed_z, feed_e] =
        [(300.0, x), (30.0, z), (100.0, e)].map(|(most, steps)| f64::min(most, 200_000.0 / steps));
    let print = random.magnitude(200.0, 10_000.0).round();
    let jerk = random.magnitude(2_000.0, 500_000.0).round();
    let deviation = (random.magnitude(0.005, 0.2) * 1e4).round() / 1e4;
    let corners = random.one_of(&["", "z = 0.4, e = 1", "x = 8, y = 8, z = 0.4, e = 4.5", "z = 50, e = 200"]);
    format!(
        "name = \"hostile\"\nkinematics = \"{kinematics}\"\nacceleration = \"{acceleration}\"\n\
         size_mm = {{ x = 200, y = 200, z = 200 }}\n\
         steps_per_mm = {{ x = {x}, y = {x}, z = {z}, e = {e} }}\n\
         max_feed_mm_per_s = {{ x = {feed_x}, y = {feed_x}, z = {feed_z}, e = {feed_e} }}\n\
         max_acceleration_mm_per_s2 = {{ x = {print}, y = {print}, z = 500, e = 10000 }}\n\
         acceleration_mm_per_s2 = {{ print = {print}, travel = {print}, retract = 1500 }}\n\
         junction_deviation_mm = {deviation}\n\
         instantaneous_corner_velocity_mm_per_s = {{ {corners} }}\n\
         jerk_mm_per_s3 = {jerk}\nminimum_event_interval_us = 2.0\nmin_extrusion_celsius = 170\n\
         [homing.x]\n{HOME}[homing.y]\n{HOME}[homing.z]\n{HOME}\
         [nozzle]\n{HEATER}sensor = \"semitec-104gt-2\"\n[bed]\n{HEATER}sensor = \"epcos-100k\"\n\
         [firmware_retraction]\nlength_mm = 3\nretract_mm_per_s = 45\nextra_recover_mm = 0\nrecover_mm_per_s = 8\n\
         lift_mm = 0\n[driver]\npulse_width_us = 1.0\ndirection_setup_us = 0.1\nboth_edges = false\n"
    )
}

const HOME: &str = "end = \"min\"\nsensor = \"end-stop\"\nposition_mm = 0\nfast_mm_per_s = 30\nslow_mm_per_s = 5\n\
                    back_off_mm = 2\n";

const HEATER: &str = "min_celsius = 5\nmax_celsius = 200\nproportional = 0.1\nintegral = 0.004\nderivative = 0.1\n\
                      residency_window_celsius = 1\nresidency_s = 10\n";

/// Writes a program; positions are in hundredths of a micrometre, as the G-code's last digit.
struct Writer {
    random: Random,
    text: String,
    at: [i64; 3],
    moves: usize,
    relative: bool,
}

/// Units in a mm.
const PER_MM: f64 = 100_000.0;

impl Writer {
    fn new(random: Random) -> Self {
        let at = [100.0, 100.0, 50.0].map(|mm: f64| (mm * PER_MM) as i64);
        let text = "M302 P1\nG28\nM83\nG1 X100 Y100 Z50 F6000\n".to_owned();
        Self { random, text, at, moves: 0, relative: false }
    }

    fn program(mut self, moves: usize) -> String {
        while self.moves < moves {
            match self.random.below(12) {
                0 => {
                    self.relative = !self.relative;
                    self.text.push_str(if self.relative { "G91\nM83\n" } else { "G90\nM83\n" });
                }
                1 => {
                    let acceleration = self.random.magnitude(50.0, 20_000.0).round();
                    let _ = writeln!(self.text, "M204 S{acceleration}");
                }
                2 => self.text.push_str(["M400\n", "G4 P1\n", "G92 E0\n", "M106 S99\n"][self.random.below(4) as usize]),
                3 => {
                    let extruder = self.random.share() * 4.0 - 2.0;
                    let _ = writeln!(self.text, "G1 E{extruder:.5} F{}", 60 + self.random.below(3_000));
                    self.moves += 1;
                }
                4 => self.scattered(),
                5..=7 => self.curve(),
                _ => self.line(),
            }
        }
        self.text
    }

    /// Pieces in line, all of one length or of many.
    fn line(&mut self) {
        let angle = self.angle();
        let rise = if self.random.below(6) == 0 { self.random.share() * 0.1 } else { 0.0 };
        let piece = self.piece_mm();
        let alike = self.random.below(2) == 0;
        let extrusion = self.extrusion();
        self.feed();
        for _ in 0..1 + self.random.below(60) {
            let length = if alike { piece } else { self.piece_mm() };
            self.go([angle.cos() * length, angle.sin() * length, rise * length], extrusion * length);
        }
    }

    /// Pieces of a circle.
    fn curve(&mut self) {
        let piece = self.piece_mm();
        let turn = self.random.magnitude(1e-4, 0.5) * if self.random.below(2) == 0 { 1.0 } else { -1.0 };
        let extrusion = self.extrusion();
        let mut angle = self.angle();
        self.feed();
        for _ in 0..1 + self.random.below(80) {
            self.go([angle.cos() * piece, angle.sin() * piece, 0.0], extrusion * piece);
            angle += turn;
        }
    }

    /// Moves of any direction and length, each with its own feed.
    fn scattered(&mut self) {
        for _ in 0..1 + self.random.below(30) {
            let (angle, length) = (self.angle(), self.random.magnitude(0.0005, 3.0));
            let rise = if self.random.below(4) == 0 { self.random.share() - 0.5 } else { 0.0 };
            let extrusion = self.extrusion();
            self.feed();
            self.go([angle.cos() * length, angle.sin() * length, rise * length], extrusion * length);
        }
    }

    fn piece_mm(&mut self) -> f64 {
        self.random.magnitude(0.0005, 0.3)
    }

    /// Direction along an axis, along a diagonal, or any.
    fn angle(&mut self) -> f64 {
        let eighth = core::f64::consts::FRAC_PI_4;
        if self.random.below(2) == 0 {
            self.random.below(8) as f64 * eighth
        } else {
            self.random.share() * 8.0 * eighth
        }
    }

    /// Filament for a mm of path.
    fn extrusion(&mut self) -> f64 {
        match self.random.below(4) {
            0 | 1 => 0.0,
            2 => 0.033,
            _ => self.random.share() * 0.4 - 0.2,
        }
    }

    fn feed(&mut self) {
        let feed = self.random.magnitude(20.0, 18_000.0).round();
        let _ = writeln!(self.text, "G1 F{feed}");
    }

    /// A move, turned back where it would leave the machine.
    fn go(&mut self, by_mm: [f64; 3], filament_mm: f64) {
        let mut words = String::new();
        for (axis, letter) in "XYZ".chars().enumerate() {
            let mut by = (by_mm[axis] * PER_MM).round() as i64;
            let end = self.at[axis] + by;
            if !(1_000_000..19_000_000).contains(&end) {
                by = -by;
            }
            if by == 0 {
                continue;
            }
            self.at[axis] += by;
            let value = if self.relative { by } else { self.at[axis] };
            let _ = write!(words, " {letter}{:.5}", value as f64 / PER_MM);
        }
        if filament_mm.abs() >= 0.000_01 {
            let _ = write!(words, " E{filament_mm:.5}");
        }
        if !words.is_empty() {
            let _ = writeln!(self.text, "G1{words}");
            self.moves += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_makes_the_same_program_again() {
        let [one, other] = [Hostile::new(7, 100), Hostile::new(7, 100)];
        assert_eq!((one.text.clone(), one.profile), (other.text, other.profile));
        assert_ne!(one.text, Hostile::new(8, 100).text);
        assert!(one.text.lines().filter(|line| line.starts_with("G1 ")).count() >= 100);
    }
}
