//! Remarks about odd lines, which are executed all the same, and about lines and
//! words without effect.

use core::fmt;

use crate::ShortText;
use crate::not_executed::NOT_EXECUTED;

/// One remark. Letters are upper case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark {
    /// A word without a number was ignored.
    NoNumber(u8),
    /// A number of zero or less was ignored where it must be above zero.
    NotAboveZero(u8),
    /// The fraction of a number that must be whole was dropped.
    Fraction(u8),
    /// A number above its range became the maximum.
    TooLarge(u8),
    /// A word without a meaning to this command or machine.
    NoEffect(u8),
    /// A word without a number counts as zero (G92).
    Zero(u8),
    /// A command that this firmware does not execute: its index in [`NOT_EXECUTED`].
    NotExecuted(u8),
    /// A second command in the line, and everything after it, was ignored.
    SecondCommand,
    /// G4 without P and S.
    BareDwell,
    /// A fan that the machine does not have, by M106 P, M107 P or SET_FAN_SPEED. Some firmware
    /// takes P for the power.
    OtherFan,
    /// A number without its letter was ignored.
    NoLetter,
    /// A temperature or flow of a second extruder.
    OtherTool,
    /// A line for the host (`@pause`).
    HostCommand,
    /// A line that begins with `//`.
    SlashComment,
    /// A command without effect, since its S is missing.
    WithoutS,
    /// M115 U: a check of the firmware's version.
    FirmwareVersion,
    /// M569 with P, which is another firmware's.
    DriverByNumber,
    /// A nozzle or model for which the job is (M862.1, M862.3), where the profile does not say what
    /// the machine has.
    MachineUnknown,
    /// Words of SET_VELOCITY_LIMIT about corners and short moves.
    CornerLimits,
    /// A heater or thermometer that the machine does not have.
    OtherHeater,
    /// TEMPERATURE_WAIT with MAXIMUM.
    WaitsForHeatOnly,
    /// The bed's mesh, on a machine that cannot measure one.
    NoBed,
    /// The alignment of Z's motors, on a machine that does not know how.
    OneZMotor,
    /// M30 without a file's name.
    ProgramEnd,
    /// A K of M900 that is not a time: the one in force is kept.
    OtherAdvance,
    /// A word, `KEY=VALUE`, that the command does not have; `true`: not the only one in the line.
    UnknownWord(ShortText, bool),
    /// M425 on a machine whose profile has no table `backlash`.
    NoBacklash,
    /// M42 on a machine without outputs.
    NoOutputs,
    /// M150 on a machine without a light of several colours.
    NoLight,
    /// M80 and M81 on a machine whose power supply cannot be switched.
    NoSupply,
    /// M141 and M191 on a machine that does not know its chamber's temperature.
    NoChamber,
    /// G29 with words that do not measure here.
    NothingMeasured,
    /// A target below 0, with which other firmwares switch a heater off.
    BelowZeroIsOff,
    /// A power of 1 or less, of 255.
    SmallPower,
    /// M106 with words of other firmwares that set up a fan.
    NoFanPower,
    /// G90 has ended M83, and filament is to be pushed.
    AbsoluteExtrusion,
    /// M24 or M602 without a paused print.
    NotPaused,
    /// A command for the files of a card, in a print's own file.
    NoFiles,
    /// M524 in a file on the desk.
    EndsCardPrint,
    /// M280, M401, M402 and BLTOUCH_DEBUG on a machine whose probe has no pin to move, and M280
    /// of another servo.
    NoServo,
}

/// Parts of a line that were ignored or changed, so that the host learns how the line was read.
///
/// `Display` writes all remarks in one line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Remarks {
    /// A bit for each letter, `A` the lowest.
    no_number: u32,
    not_above_zero: u32,
    fraction: u32,
    too_large: u32,
    no_effect: u32,
    zero: u32,
    /// A bit for each remark about the line as a whole.
    about_line: u32,
    /// A bit for each entry of [`NOT_EXECUTED`].
    not_executed: u128,
    /// A bit for each unknown word that was met, of 32 kinds of spelling.
    unknown_words: u32,
    /// The newest of them, and whether it has company.
    unknown_word: Option<(ShortText, bool)>,
}

/// The bit of a word in [`Remarks::unknown_words`].
fn word_bit(word: ShortText) -> u32 {
    let sum = word.as_str().bytes().fold(0_u32, |sum, byte| sum.wrapping_mul(31).wrapping_add(byte.into()));
    1 << (sum.wrapping_mul(0x9e37_79b1) >> 27)
}

/// Texts of the bits of `about_line`.
const ABOUT_LINE: &[&str] = &[
    "one command a line: the second and everything after it is ignored",
    "without P or S: waits until all motion has ended",
    "MAXIMUM: cooling is not waited for; no effect",
    "this machine has no such fan (P is its number, S the power; the profile's fans); no effect",
    "a number without its letter is ignored",
    "T: this machine has one extruder, 0; no effect",
    "a line with @ is for the host; no effect",
    "not a comment, which begins with ;, and not a command; no effect",
    "without S: no effect",
    "U: the firmware's version is not checked",
    "P: drivers are named by X, Y, Z and E here; no effect",
    "not checked: the profile does not say (nozzle_diameter_mm, model_names)",
    "of the limits VELOCITY, ACCEL and SQUARE_CORNER_VELOCITY have an effect",
    "heaters and thermometers are extruder, heater_bed and chamber; no effect",
    "this machine has no probe, its bed must be level by itself; no effect",
    "without a file's name: ends a program, which needs no command here; what follows is executed",
    "the profile has no outputs; no effect",
    "the profile has no power_supply: M80 has no effect, M81 switches heaters, fans and motors off all the same",
    "the profile has no chamber; no effect, and nothing is waited for",
    "the profile has no such servo (table bltouch: P0); no effect",
    "the profile has no z_motors with points; no effect",
    "the profile has no light of several colours (color of its outputs); no effect",
    "the profile has no backlash; no effect",
    "K: expected 0 to 2 s (Linear Advance 1.0 has other numbers); the advance stays",
    "nothing is measured (G29 or G29 P1 measures the bed, M420 S1 follows the mesh, M420 S0 ends that)",
    "a target below 0 is off",
    "S: full power is 255, as in Marlin (in RepRapFirmware 1)",
    "the fan's power stays; S sets it",
    "E is absolute since G90, as in Marlin, although M83 came before: write M83 after G90 if E is relative",
    "no print is paused; no effect",
    "a print's file cannot choose, write or delete files of the card; no effect",
    "a print from the card ends here; no effect elsewhere",
];

/// The bit of [`Remark::NoBed`].
const NO_BED: u32 = 1 << 14;

/// The bit of [`Remark::OneZMotor`].
const ONE_Z_MOTOR: u32 = 1 << 20;

/// The bit of [`Remark::NoBacklash`].
const NO_BACKLASH: u32 = 1 << 22;

impl Remarks {
    /// No remarks.
    pub const NONE: Self = Remarks {
        no_number: 0,
        not_above_zero: 0,
        fraction: 0,
        too_large: 0,
        no_effect: 0,
        zero: 0,
        about_line: 0,
        not_executed: 0,
        unknown_words: 0,
        unknown_word: None,
    };

    /// True if there are no remarks.
    pub fn is_empty(&self) -> bool {
        *self == Self::NONE
    }

    /// Adds a remark.
    pub fn add(&mut self, remark: Remark) {
        let letter = |letter: u8| 1 << (letter.wrapping_sub(b'A') & 31);
        match remark {
            Remark::NoNumber(word) => self.no_number |= letter(word),
            Remark::NotAboveZero(word) => self.not_above_zero |= letter(word),
            Remark::Fraction(word) => self.fraction |= letter(word),
            Remark::TooLarge(word) => self.too_large |= letter(word),
            Remark::NoEffect(word) => self.no_effect |= letter(word),
            Remark::Zero(word) => self.zero |= letter(word),
            Remark::NotExecuted(index) => self.not_executed |= 1 << (index & 127),
            Remark::SecondCommand => self.about_line |= 1,
            Remark::BareDwell => self.about_line |= 1 << 1,
            Remark::OtherFan => self.about_line |= 1 << 3,
            Remark::NoLetter => self.about_line |= 1 << 4,
            Remark::OtherTool => self.about_line |= 1 << 5,
            Remark::HostCommand => self.about_line |= 1 << 6,
            Remark::SlashComment => self.about_line |= 1 << 7,
            Remark::WithoutS => self.about_line |= 1 << 8,
            Remark::FirmwareVersion => self.about_line |= 1 << 9,
            Remark::DriverByNumber => self.about_line |= 1 << 10,
            Remark::MachineUnknown => self.about_line |= 1 << 11,
            Remark::CornerLimits => self.about_line |= 1 << 12,
            Remark::OtherHeater => self.about_line |= 1 << 13,
            Remark::WaitsForHeatOnly => self.about_line |= 1 << 2,
            Remark::NoBed => self.about_line |= NO_BED,
            Remark::ProgramEnd => self.about_line |= 1 << 15,
            Remark::OtherAdvance => self.about_line |= 1 << 23,
            Remark::UnknownWord(word, in_company) => {
                self.unknown_words |= word_bit(word);
                self.unknown_word = Some((word, in_company));
            }
            Remark::NoOutputs => self.about_line |= 1 << 16,
            Remark::NoLight => self.about_line |= 1 << 21,
            Remark::NoSupply => self.about_line |= 1 << 17,
            Remark::NoChamber => self.about_line |= 1 << 18,
            Remark::NoServo => self.about_line |= 1 << 19,
            Remark::OneZMotor => self.about_line |= ONE_Z_MOTOR,
            Remark::NoBacklash => self.about_line |= NO_BACKLASH,
            Remark::NothingMeasured => self.about_line |= 1 << 24,
            Remark::BelowZeroIsOff => self.about_line |= 1 << 25,
            Remark::SmallPower => self.about_line |= 1 << 26,
            Remark::NoFanPower => self.about_line |= 1 << 27,
            Remark::AbsoluteExtrusion => self.about_line |= 1 << 28,
            Remark::NotPaused => self.about_line |= 1 << 29,
            Remark::NoFiles => self.about_line |= 1 << 30,
            Remark::EndsCardPrint => self.about_line |= 1 << 31,
        }
    }

    /// Adds [`Remark::NoEffect`] for each letter in a mask, bit 0 = A.
    pub(crate) fn add_no_effect(&mut self, letters: u32) {
        self.no_effect |= letters;
    }

    /// True if the only remark is about limits of corners and short moves.
    pub fn is_corner_limits_alone(&self) -> bool {
        let mut alone = Self::NONE;
        alone.add(Remark::CornerLimits);
        *self == alone
    }

    /// True if the only remarks are about words without effect.
    pub fn is_no_effect_alone(&self) -> bool {
        *self == Self { no_effect: self.no_effect, ..Self::NONE }
    }

    /// True if the line is a command that this firmware, or this machine, does not
    /// execute, known or not.
    pub fn is_not_executed(&self) -> bool {
        self.not_executed != 0 || self.about_line & (NO_BED | ONE_Z_MOTOR | NO_BACKLASH) != 0
    }

    /// True if the line is a command that this firmware does not know.
    pub fn is_unknown(&self) -> bool {
        self.entries().any(|entry| entry.outcome == crate::Outcome::Unknown)
    }

    /// The entries of [`NOT_EXECUTED`] among the remarks.
    pub(crate) fn entries(&self) -> impl Iterator<Item = &'static crate::NotExecuted> {
        let bits = self.not_executed;
        NOT_EXECUTED.iter().zip(0..).filter(move |(_, bit)| bits >> bit & 1 == 1).map(|(entry, _)| entry)
    }

    /// Adds all of `other`; returns the remarks that are new.
    pub fn merge(&mut self, other: &Self) -> Self {
        let merge = |all: &mut u32, more: u32| {
            let new = more & !*all;
            *all |= more;
            new
        };
        let unknown_words = merge(&mut self.unknown_words, other.unknown_words);
        let not_executed = other.not_executed & !self.not_executed;
        self.not_executed |= other.not_executed;
        Self {
            no_number: merge(&mut self.no_number, other.no_number),
            not_above_zero: merge(&mut self.not_above_zero, other.not_above_zero),
            fraction: merge(&mut self.fraction, other.fraction),
            too_large: merge(&mut self.too_large, other.too_large),
            no_effect: merge(&mut self.no_effect, other.no_effect),
            zero: merge(&mut self.zero, other.zero),
            about_line: merge(&mut self.about_line, other.about_line),
            not_executed,
            unknown_words,
            unknown_word: other.unknown_word.filter(|_| unknown_words != 0),
        }
    }
}

impl fmt::Display for Remarks {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        let words = [
            (self.no_number, "without a number is ignored"),
            (self.not_above_zero, "is not above 0 and is ignored"),
            (self.fraction, "must be whole, the fraction is dropped"),
            (self.too_large, "is too large and becomes the largest value"),
            (self.zero, "without a number is read as 0"),
            (self.no_effect, "has no effect"),
        ];
        for (letters, says) in words {
            for letter in (b'A'..=b'Z').filter(|letter| letters >> (letter - b'A') & 1 == 1) {
                write!(out, "{separator}{} {says}", char::from(letter))?;
                separator = "; ";
            }
        }
        if let Some((word, in_company)) = self.unknown_word {
            let says = if in_company { " and others have no effect" } else { " has no effect" };
            write!(out, "{separator}{word}{says}")?;
            separator = "; ";
        }
        for says in ABOUT_LINE.iter().zip(0..).filter(|(_, bit)| self.about_line >> bit & 1 == 1).map(|(says, _)| says)
        {
            write!(out, "{separator}{says}")?;
            separator = "; ";
        }
        for entry in self.entries() {
            write!(out, "{separator}{entry}")?;
            separator = "; ";
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_remark_is_reported_once() {
        let mut said = Remarks::default();
        let mut line = Remarks::default();
        line.add(Remark::NoNumber(b'E'));
        line.add(Remark::SecondCommand);
        assert_eq!(said.merge(&line), line);
        assert!(said.merge(&line).is_empty());
        line.add(Remark::NoNumber(b'Z'));
        line.add(Remark::Fraction(b'E'));
        assert_eq!(
            said.merge(&line).to_string(),
            "Z without a number is ignored; E must be whole, the fraction is dropped"
        );
    }

    #[test]
    fn every_remark_has_a_text() {
        for (remark, text) in [
            (Remark::NotAboveZero(b'T'), "T is not above 0 and is ignored"),
            (Remark::TooLarge(b'S'), "S is too large and becomes the largest value"),
            (Remark::SecondCommand, "one command a line: the second and everything after it is ignored"),
            (Remark::BareDwell, "without P or S: waits until all motion has ended"),
            (Remark::NoServo, "the profile has no such servo (table bltouch: P0); no effect"),
            (
                Remark::OtherFan,
                "this machine has no such fan (P is its number, S the power; the profile's fans); no effect",
            ),
            (Remark::NoLetter, "a number without its letter is ignored"),
            (Remark::OtherTool, "T: this machine has one extruder, 0; no effect"),
            (Remark::HostCommand, "a line with @ is for the host; no effect"),
            (Remark::SlashComment, "not a comment, which begins with ;, and not a command; no effect"),
            (Remark::WithoutS, "without S: no effect"),
            (Remark::FirmwareVersion, "U: the firmware's version is not checked"),
            (Remark::DriverByNumber, "P: drivers are named by X, Y, Z and E here; no effect"),
            (Remark::MachineUnknown, "not checked: the profile does not say (nozzle_diameter_mm, model_names)"),
            (Remark::CornerLimits, "of the limits VELOCITY, ACCEL and SQUARE_CORNER_VELOCITY have an effect"),
            (Remark::OtherHeater, "heaters and thermometers are extruder, heater_bed and chamber; no effect"),
            (Remark::NoChamber, "the profile has no chamber; no effect, and nothing is waited for"),
            (Remark::WaitsForHeatOnly, "MAXIMUM: cooling is not waited for; no effect"),
            (Remark::NoBed, "this machine has no probe, its bed must be level by itself; no effect"),
            (Remark::OneZMotor, "the profile has no z_motors with points; no effect"),
            (Remark::NoBacklash, "the profile has no backlash; no effect"),
            (Remark::OtherAdvance, "K: expected 0 to 2 s (Linear Advance 1.0 has other numbers); the advance stays"),
            (Remark::UnknownWord(ShortText::new("SPEED"), false), "SPEED has no effect"),
            (Remark::UnknownWord(ShortText::new("SPEED"), true), "SPEED and others have no effect"),
            (Remark::BelowZeroIsOff, "a target below 0 is off"),
            (Remark::SmallPower, "S: full power is 255, as in Marlin (in RepRapFirmware 1)"),
            (Remark::NoFanPower, "the fan's power stays; S sets it"),
            (Remark::NotPaused, "no print is paused; no effect"),
            (Remark::EndsCardPrint, "a print from the card ends here; no effect elsewhere"),
            (Remark::NoEffect(b'W'), "W has no effect"),
            (Remark::Zero(b'E'), "E without a number is read as 0"),
        ] {
            let mut remarks = Remarks::default();
            remarks.add(remark);
            assert_eq!(remarks.to_string(), text);
        }
    }
}
