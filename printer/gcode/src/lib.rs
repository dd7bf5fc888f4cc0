//! G-code for 3D printers: bytes to lines, lines to commands, replies to text.
//!
//! `no_std`, no heap, no panics: every byte sequence is answered.
//!
//! [`LineReader`] cuts bytes into [`Line`]s, [`LineNumbers`] says which of them a host must send
//! again, [`parse`] makes a [`Command`] of a line's text, and a [`Reply`] prints what goes back.
//! [`EmergencyScanner`] watches the raw bytes for the few commands that must not wait their turn.
//! [`meatpack`] unpacks bytes that a host has packed.
#![cfg_attr(not(test), no_std)]

mod bed_command;
mod card_command;
mod command;
mod command_words;
mod decimal;
mod emergency;
mod line;
mod line_reader;
pub mod meatpack;
mod not_executed;
mod parse_error;
mod parser;
mod pin_command;
mod protocol;
mod real;
mod remarks;
mod reply;
mod reply_text;
mod skew_command;
mod supply_command;
mod tower_words;

pub use bed_command::{BedArea, BedCommand};
pub use card_command::{CardCommand, InterruptedPrint};
pub use command::Command;
pub use command_words::{
    AdvanceWords, ArcForm, AxisFlags, AxisWords, BacklashWords, DriverSetting, DriverWords, FeedWords,
    FilamentSensorWords, GainWords, PrintClockCommand, RetractionWords, SettingsCommand, ShaperWords, TunedHeater,
    Units, WaitTarget,
};
pub use decimal::{Decimal, NumberError};
pub use emergency::{Emergency, EmergencyScanner};
pub use line::{Checksum, LINE_CAPACITY, Line, LineError};
pub use line_reader::LineReader;
pub use not_executed::{NAMED, NOT_EXECUTED, NotExecuted, Outcome};
pub use parse_error::{ParseError, ShortText};
pub use parser::{HeaterModelWords, parse, parse_with_remarks};
pub use pin_command::PinCommand;
pub use protocol::{LineNumbers, Verdict};
pub use real::Real;
pub use remarks::{Remark, Remarks};
pub use reply::{
    AdvanceState, ChamberTemperature, EndStopState, FirmwareInfo, MotionFigures, NozzleTemperature, Position, Reply,
    ResendReason, ShaperState, Temperatures, TimingFigures,
};
pub use skew_command::{Diagonals, SkewCommand};
pub use supply_command::SupplyCommand;
pub use tower_words::{TowerCourse, TowerWords};
