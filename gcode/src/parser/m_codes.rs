//! Heaters, fans, limits, reports and the rest of the machine.

use super::Code;
use crate::remarks::{Remark, Remarks};
use crate::{AxisWords, Command, Decimal, DriverWords, ParseError, RetractionWords, WaitTarget};

/// Maximum interval of M113 and M155, seconds.
const MAX_INTERVAL_S: u8 = 60;
/// Maximum of M220 and M221, percent.
const MAX_PERCENT: u16 = 999;
/// Maximum of M906, mA: more than any of the drivers can deliver.
const MAX_CURRENT_MA: u16 = 3000;
/// Maximum of M914.
const MAX_STALL_THRESHOLD: u16 = 255;
/// Maximum T of M790, seconds.
const MAX_SILENCE_S: u16 = 3600;
/// T of M790 if the line has none, seconds.
const DEFAULT_SILENCE_S: u16 = 30;

pub(super) fn parse<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    if code.has_subcode {
        // M862.1 to M862.6: checks of the printer's model and nozzle.
        return Ok(if code.number == 862 { Command::Accepted } else { code.unknown() });
    }
    match code.number {
        17 => Ok(Command::EnableMotors(code.words(remarks)?.axis_flags())),
        18 | 84 => {
            let mut words = code.words(remarks)?;
            Ok(match words.nearest(b'S', 1)? {
                Some(seconds) => Command::IdleTimeout { seconds },
                None => Command::DisableMotors(words.axis_flags()),
            })
        }
        82 => code.without_words(Command::AbsoluteExtrusion, remarks),
        83 => code.without_words(Command::RelativeExtrusion, remarks),
        86 => Ok(Command::HeaterTimeout(code.words(remarks)?.whole_up_to(b'S', u16::MAX)?)),
        104 | 109 | 140 | 190 => temperature(code, remarks),
        106 | 107 => fan(code, remarks),
        105 => Ok(Command::ReportTemperatures),
        108 => Ok(Command::EndWait),
        110 => Ok(Command::SetLineNumber(code.words(remarks)?.whole(b'N'))),
        112 => Ok(Command::EmergencyStop),
        113 => Ok(Command::KeepAlive(code.words(remarks)?.whole_to(b'S', MAX_INTERVAL_S)?)),
        114 => Ok(Command::ReportPosition),
        115 => Ok(Command::ReportFirmware),
        117 => Ok(Command::Display(code.free_text())),
        118 => Ok(echo(code.free_text())),
        119 => Ok(Command::ReportEndStops),
        122 => code.without_words(Command::ReportDrivers, remarks),
        155 => match code.words(remarks)?.whole_to(b'S', MAX_INTERVAL_S)? {
            Some(seconds) => Ok(Command::AutoReportTemperatures { seconds }),
            None => Ok(Command::Accepted),
        },
        201 => Ok(Command::MaxAcceleration(code.words(remarks)?.axis_limits())),
        203 => Ok(Command::MaxFeed(code.words(remarks)?.axis_limits())),
        204 => {
            let mut words = code.words(remarks)?;
            Ok(Command::Acceleration {
                print: words.above_zero(b'P'),
                retract: words.above_zero(b'R'),
                travel: words.above_zero(b'T'),
                both: words.above_zero(b'S'),
            })
        }
        205 => {
            let mut words = code.words(remarks)?;
            Ok(Command::Junction { deviation: words.above_zero(b'J'), corner_velocity: words.axis_limits() })
        }
        207 => {
            let mut words = code.words(remarks)?;
            Ok(Command::RetractSettings(RetractionWords {
                length: words.not_negative(b'S')?,
                feed: words.above_zero(b'F'),
                lift: words.not_negative(b'Z')?,
            }))
        }
        208 => {
            let mut words = code.words(remarks)?;
            // Extra length may be negative: less comes back than went.
            let (length, feed) = (words.value(b'S'), words.above_zero(b'F'));
            Ok(Command::RecoverSettings(RetractionWords { length, feed, lift: None }))
        }
        211 => Ok(Command::SoftLimits(code.words(remarks)?.switch(b'S')?)),
        149 => temperature_units(code),
        200 => volumetric(code, remarks),
        220 => {
            let mut words = code.words(remarks)?;
            let percent = words.above_zero(b'S');
            Ok(Command::FeedPercent(words.at_most(b'S', percent, MAX_PERCENT)?))
        }
        221 => {
            let mut words = code.words(remarks)?;
            if words.names_other_tool() {
                return Ok(code.unknown());
            }
            // An error, unlike a feed of 0: without filament nothing would be printed.
            let percent = words.required_above_zero(b'S')?;
            Ok(Command::FlowPercent(words.at_most(b'S', percent, MAX_PERCENT)?))
        }
        // ANCHOR: m302
        302 => {
            let mut words = code.words(remarks)?;
            Ok(Command::ColdExtrusion { minimum: words.not_negative(b'S')?, allow: words.switch(b'P')? })
        }
        // ANCHOR_END: m302
        290 => {
            let mut words = code.words(remarks)?;
            let (mut axes, by) = (words.axes(), words.value(b'S'));
            axes.z = axes.z.or(by);
            Ok(Command::ShiftZ { words: axes, keeps_offset: words.switch(b'P')? == Some(false) })
        }
        400 => Ok(Command::Finish),
        410 => Ok(Command::QuickStop),
        569 => stealth_chop(code, remarks),
        851 => {
            let AxisWords { x, y, z, .. } = code.words(remarks)?.axes();
            Ok(Command::ProbeOffset(AxisWords { x, y, z, e: None }))
        }
        906 => Ok(Command::DriverCurrent(driver_words(code, remarks, MAX_CURRENT_MA)?)),
        914 => Ok(Command::StallThreshold(driver_words(code, remarks, MAX_STALL_THRESHOLD)?)),
        790 => {
            let mut words = code.words(remarks)?;
            let Some(size) = words.nearest(b'S', 1)?.and_then(|size| u32::try_from(size).ok()) else {
                return Err(ParseError::WordsExpected { command: "M790", words: "S" });
            };
            let silence_s = words.whole_up_to(b'T', MAX_SILENCE_S)?.unwrap_or(DEFAULT_SILENCE_S);
            Ok(Command::ReceiveJob { size, silence_s })
        }
        795 => {
            let mut words = code.words(remarks)?;
            Ok(Command::AdaptiveExtrusion {
                on: words.switch(b'S')?,
                layer_height: words.required_above_zero(b'H')?,
                line_width: words.required_above_zero(b'W')?,
                filament_diameter: words.required_above_zero(b'D')?,
            })
        }
        796 => {
            let mut words = code.words(remarks)?;
            Ok(Command::MotionChoice {
                interpolation: words.whole_to(b'I', 4)?,
                acceleration: words.whole_to(b'A', 2)?,
            })
        }
        797 => Ok(Command::ReportMotion),
        798 => {
            let mut words = code.words(remarks)?;
            Ok(Command::Timing { on: words.switch(b'S')?, clear: words.has(b'R') })
        }
        999 => Ok(Command::Restart),
        // Progress and timers of a display, sounds, object labels; parts and corrections that this machine does not have.
        73..=77
        | 141
        | 142
        | 300
        | 412
        | 413
        | 420
        | 425
        | 486
        | 530
        | 532
        | 555
        | 572
        | 573
        | 593
        | 862
        | 900
        | 907 => Ok(Command::Accepted),
        _ => Ok(code.unknown()),
    }
}

fn temperature<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    let is_nozzle = matches!(code.number, 104 | 109);
    if is_nozzle && words.names_other_tool() {
        return Ok(code.unknown());
    }
    let target = words.not_negative(b'S')?;
    Ok(match code.number {
        104 => Command::SetNozzle(target),
        140 => Command::SetBed(target),
        _ => {
            let wait = match (target, words.not_negative(b'R')?) {
                (Some(target), _) => WaitTarget::Heating(target),
                (None, Some(target)) => WaitTarget::HeatingOrCooling(target),
                (None, None) => WaitTarget::Current,
            };
            if is_nozzle { Command::WaitNozzle(wait) } else { Command::WaitBed(wait) }
        }
    })
}

/// M569. With P it is the M569 of another firmware, which sets a driver's direction by its number.
fn stealth_chop<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    if words.has(b'P') {
        return Ok(Command::Accepted);
    }
    let (motors, on) = (words.axis_flags(), words.switch(b'S')?);
    if on.is_some() && motors.is_empty() {
        return Err(ParseError::WordsExpected { command: "M569", words: "X, Y, Z or E" });
    }
    Ok(Command::StealthChop { motors, on })
}

/// M906 and M914.
fn driver_words(code: Code<'_>, remarks: &mut Remarks, high: u16) -> Result<DriverWords, ParseError> {
    let mut words = code.words(remarks)?;
    let mut number = |letter| words.whole_up_to(letter, high);
    Ok(DriverWords { x: number(b'X')?, y: number(b'Y')?, z: number(b'Z')?, e: number(b'E')? })
}

/// M106 and M107. Slicers write powers such as 252.45, which are rounded.
fn fan<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    let index = words.whole_to(b'P', u8::MAX)?.unwrap_or(0);
    if code.number != 106 {
        return Ok(Command::Fan { index, power: 0 });
    }
    let power = words.nearest_byte(b'S')?;
    if index > 0 && power.is_none() {
        words.remark(Remark::FanPower);
    }
    Ok(Command::Fan { index, power: power.unwrap_or(u8::MAX) })
}

/// M200: whether E is a length of filament or a volume.
fn volumetric<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    let has_diameter = words.value(b'D').is_some_and(|diameter| diameter > Decimal::ZERO);
    match words.switch(b'S')? {
        Some(false) => Ok(Command::Accepted),
        None if !has_diameter => Ok(Command::Accepted),
        _ => Err(ParseError::NotSupported {
            command: "M200",
            why: "volumes in E would be read as mm of filament; switch volumetric E off in the slicer, or write M200 D0",
        }),
    }
}

/// M149: the unit of temperatures.
fn temperature_units(code: Code<'_>) -> Result<Command<'_>, ParseError> {
    // Its words are letters without numbers.
    let mut remarks = Remarks::default();
    let words = code.words(&mut remarks)?;
    if words.has(b'F') || words.has(b'K') {
        let why = "temperatures would be read as degrees Celsius; use M149 C";
        return Err(ParseError::NotSupported { command: "M149 F and K", why });
    }
    Ok(Command::Accepted)
}

/// M118: the flags E1, A1 and P (port), upper case, each followed by a blank, then the text.
fn echo(mut text: &str) -> Command<'_> {
    let (mut echo_prefix, mut action_prefix) = (false, false);
    loop {
        let end = text.find([' ', '\t']).unwrap_or(text.len());
        let (word, rest) = text.split_at_checked(end).unwrap_or((text, ""));
        match word.as_bytes() {
            b"E1" => echo_prefix = true,
            b"A1" => action_prefix = true,
            // Off, as by default.
            b"E0" | b"A0" => {}
            // There is one port, the one the command came by.
            [b'P', digits @ ..] if Decimal::parse(digits).is_ok_and(|port| !port.is_negative()) => {}
            _ => return Command::Echo { echo_prefix, action_prefix, text },
        }
        text = rest.trim_start_matches([' ', '\t']);
    }
}
