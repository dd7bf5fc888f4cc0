//! Heaters, fans, limits, reports and the rest of the machine.

use super::code::Code;
use super::words::{Strays, Words, skip_blanks};
use super::{drivers, pressure_advance};
use crate::remarks::{Remark, Remarks};
use crate::{
    AxisWords, BacklashWords, Command, Decimal, DriverSetting, FeedWords, FilamentSensorWords, GainWords, ParseError,
    PrintClockCommand, RetractionWords, SettingsCommand, SkewCommand, SupplyCommand, TunedHeater, WaitTarget,
};

/// Maximum interval of M113 and M155, seconds.
const MAX_INTERVAL_S: u8 = 60;
/// Maximum of M220 and M221, percent.
const MAX_PERCENT: u16 = 999;
/// Maximum C of M303.
const MAX_CYCLES: u8 = 20;
/// Maximum T of M790, seconds.
const MAX_SILENCE_S: u16 = 3600;
/// T of M790 if the line has none, seconds.
const DEFAULT_SILENCE_S: u16 = 30;

pub(super) fn parse<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    if code.has_subcode {
        // M862.1 to M862.6: checks of the printer's model and nozzle.
        return match (code.number, code.subcode) {
            (862, 1) => {
                let words = code.words(words)?;
                // A and F say what the filament asks of the nozzle, T which tool is meant.
                b"AFT".iter().for_each(|&letter| words.needless_zero(letter));
                Ok(Command::CheckNozzle(words.value(b'P')))
            }
            (862, 3) => Ok(Command::CheckModel(model(code.free_text()))),
            (862, _) => code.not_executed(words),
            _ => Ok(code.unknown()),
        };
    }
    if let Some(command) = super::card_codes::parse(&code, words) {
        return command.map(Command::Card);
    }
    match code.number {
        0 | 1 => stop(code, words),
        602 => code.without_words(Command::ResumePrint, words),
        125 | 600 | 601 => pause(code, words),
        603 | 701 | 702 => filament(code, words),
        // P makes it wait for a pin, and this machine has no pin names.
        226 if code.peek(&mut Remarks::default())?.has(b'P') => Ok(code.unknown()),
        226 => pause(code, words),
        876 => {
            let words = code.words(words)?;
            // P: a host says, as OctoPrint does when it connects, whether it shows prompts. Those
            // that do not are told as well.
            let shows_prompts = words.whole_to(b'P', 1)?;
            match words.whole_to(b'S', u8::MAX)? {
                Some(button) => Ok(Command::PromptAnswer(button)),
                None if shows_prompts.is_some() => Ok(Command::Accepted),
                None => Err(ParseError::WordsExpected { command: "M876", words: "S" }),
            }
        }
        42 => {
            let words = code.words(words)?;
            let number = words.whole(b'P').and_then(|number| u8::try_from(number).ok());
            words.remark_small_power(b'S');
            Ok(match words.nearest_byte(b'S')? {
                Some(power) => Command::SetOutput { number, power },
                None => {
                    words.remark(Remark::WithoutS);
                    Command::Accepted
                }
            })
        }
        150 => {
            let words = code.words(words)?;
            let brightness = words.nearest_byte(b'P')?.unwrap_or(u8::MAX);
            let mut colors = [0; 4];
            for (color, letter) in colors.iter_mut().zip(*b"RUBW") {
                let undimmed = words.nearest_byte(letter)?.unwrap_or(0);
                *color = (u16::from(undimmed) * u16::from(brightness) / 255) as u8;
            }
            Ok(Command::SetLight { colors })
        }
        48 | 420 | 421 | 555 => super::bed::m_code(code, words),
        17 => Ok(Command::EnableMotors(code.words(words)?.axis_flags())),
        18 | 84 => {
            let words = code.words(words)?;
            Ok(match words.nearest(b'S', 1)? {
                Some(seconds) => Command::IdleTimeout { seconds },
                None => Command::DisableMotors(words.axis_flags()),
            })
        }
        // A title may follow.
        75 => Ok(Command::PrintClock(PrintClockCommand::Start)),
        76 => code.without_words(Command::PrintClock(PrintClockCommand::Pause), words),
        77 => code.without_words(Command::PrintClock(PrintClockCommand::Stop), words),
        78 => {
            // The number keeps a slip of the finger from clearing what years have counted.
            let clears = code.words(words)?.whole(b'S') == Some(78);
            let command = if clears { PrintClockCommand::Clear } else { PrintClockCommand::Report };
            Ok(Command::PrintClock(command))
        }
        280 | 401 | 402 => super::pin::m_code(&code, words),
        80 => {
            let asks = code.words(words)?.flag(b'S');
            Ok(Command::Supply(if asks { SupplyCommand::Report } else { SupplyCommand::On }))
        }
        81 => Ok(Command::Supply(SupplyCommand::Off { when_cool: code.words(words)?.flag(b'S') })),
        82 => code.without_words(Command::AbsoluteExtrusion, words),
        83 => code.without_words(Command::RelativeExtrusion, words),
        // Marlin kills an idle machine; here the heaters go off. S0, which slicers write to be left
        // alone, leaves them watched.
        85 => match code.words(words)?.whole_up_to(b'S', u16::MAX)? {
            Some(0) => Ok(Command::HeaterTimeout(None)),
            seconds => Ok(Command::HeaterTimeout(seconds)),
        },
        86 => Ok(Command::HeaterTimeout(code.words(words)?.whole_up_to(b'S', u16::MAX)?)),
        87 => code.without_words(Command::HeaterTimeout(Some(0)), words),
        92 => {
            let words = code.words(words)?;
            Ok(Command::StepsPerMm(words.tool(b'T'), words.axis_limits()))
        }
        104 | 109 | 140 | 141 | 190 | 191 => temperature(code, words),
        106 | 107 => fan(code, words),
        105 => Ok(Command::ReportTemperatures),
        108 => Ok(Command::EndWait),
        110 => Ok(Command::SetLineNumber(code.words(words)?.whole(b'N'))),
        112 => Ok(Command::EmergencyStop),
        113 => Ok(Command::KeepAlive(code.words(words)?.whole_to(b'S', MAX_INTERVAL_S)?)),
        114 => {
            // A remark about D and R; whatever follows, the answer is the same.
            let _ = code.words(words);
            Ok(Command::ReportPosition)
        }
        115 => {
            if code.free_text().starts_with(['U', 'u']) {
                words.remark(Remark::FirmwareVersion);
            }
            Ok(Command::ReportFirmware)
        }
        117 => Ok(Command::Display(code.free_text())),
        118 => Ok(echo(code.free_text())),
        119 => Ok(Command::ReportEndStops),
        123 => code.without_words(Command::ReportFans, words),
        122 => code.without_words(Command::ReportDrivers, words),
        155 => {
            let words = code.words(words)?;
            Ok(match words.whole_to(b'S', MAX_INTERVAL_S)? {
                Some(seconds) => Command::AutoReportTemperatures { seconds },
                None => {
                    words.remark(Remark::WithoutS);
                    Command::Accepted
                }
            })
        }
        201 | 203..=205 | 207 | 208 if code.peek(&mut Remarks::default())?.is_empty() => {
            Ok(Command::ReportSetting(match code.number {
                201 => "M201",
                203 => "M203",
                204 => "M204",
                205 => "M205",
                207 => "M207",
                _ => "M208",
            }))
        }
        201 => Ok(Command::MaxAcceleration(code.words(words)?.axis_limits())),
        203 => Ok(Command::MaxFeed(code.words(words)?.axis_limits())),
        204 => {
            let words = code.words(words)?;
            Ok(Command::Acceleration {
                print: words.above_zero(b'P'),
                retract: words.above_zero(b'R'),
                travel: words.above_zero(b'T'),
                both: words.above_zero(b'S'),
            })
        }
        205 => {
            let words = code.words(words)?;
            // Smallest feeds and the time of the shortest move; 0: none.
            b"STB".iter().for_each(|&letter| words.needless_zero(letter));
            Ok(Command::Junction { deviation: words.above_zero(b'J'), corner_velocity: words.axis_limits() })
        }
        206 => {
            let words = code.places(words)?;
            let [x, y, z] = b"XYZ".map(|axis| words.value(axis));
            Ok(Command::HomeOffset(AxisWords { x, y, z, e: None }))
        }
        207 => {
            let words = code.words(words)?;
            Ok(Command::RetractSettings(RetractionWords {
                length: words.not_negative(b'S')?,
                feed: words.above_zero(b'F'),
                lift: words.not_negative(b'Z')?,
            }))
        }
        208 => {
            let words = code.words(words)?;
            // RepRapFirmware's limits of the axes, whose S says which end.
            if b"XYZ".iter().any(|&axis| words.is_present(axis)) {
                return Ok(Command::Accepted);
            }
            // Extra length may be negative: less comes back than went.
            let (length, feed) = (words.value(b'S'), words.above_zero(b'F'));
            Ok(Command::RecoverSettings(RetractionWords { length, feed, lift: None }))
        }
        211 => Ok(Command::SoftLimits(code.words(words)?.switch(b'S')?)),
        149 => temperature_units(code),
        200 => volumetric(code, words),
        220 => {
            let words = code.words(words)?;
            let percent = words.above_zero(b'S');
            let percent = words.at_most(b'S', percent, MAX_PERCENT)?;
            Ok(Command::FeedPercent(FeedWords { percent, keeps: words.flag(b'B'), restores: words.flag(b'R') }))
        }
        221 => {
            let words = code.words(words)?;
            // D is RepRapFirmware's.
            let tool = words.tool(b'T').or(words.tool(b'D'));
            // An error, unlike a feed of 0: without filament nothing would be printed.
            let percent = words.required_above_zero(b'S')?;
            Ok(Command::FlowPercent(tool, words.at_most(b'S', percent, MAX_PERCENT)?))
        }
        218 => {
            let words = code.places(words)?;
            let (tool, [x, y, z]) = (words.tool(b'T'), b"XYZ".map(|axis| words.value(axis)));
            Ok(Command::ToolOffset { tool, offset: AxisWords { x, y, z, e: None } })
        }
        301 | 304 | 309 => gains(code, words),
        303 => autotune(code, words),
        306 => Ok(Command::HeaterModel { text: code.text.trim_matches([' ', '\t']), words: code.rest }),
        // ANCHOR: m302
        302 => {
            let words = code.words(words)?;
            Ok(Command::ColdExtrusion { minimum: words.not_negative(b'S')?, allow: words.switch(b'P')? })
        }
        // ANCHOR_END: m302
        290 => {
            let words = code.places(words)?;
            let (mut axes, by) = (words.axes(), words.value(b'S'));
            axes.z = axes.z.or(by);
            Ok(Command::ShiftZ { words: axes, keeps_offset: words.switch(b'P')? == Some(false) })
        }
        30 => {
            words.remark(Remark::ProgramEnd);
            Ok(Command::Finish)
        }
        400 => finish(code, words),
        410 => Ok(Command::QuickStop),
        500 => code.without_words(Command::Settings(SettingsCommand::Store), words),
        501 => code.without_words(Command::Settings(SettingsCommand::Load), words),
        502 => code.without_words(Command::Settings(SettingsCommand::Reset), words),
        503 => {
            let headings = code.words(words)?.switch(b'S')?.unwrap_or(true);
            Ok(Command::Settings(SettingsCommand::Report { headings }))
        }
        504 => code.without_words(Command::Settings(SettingsCommand::Validate), words),
        412 => {
            let words = code.words(words)?;
            let (on, distance, resets) = (words.switch(b'S')?, words.value(b'D'), words.has(b'R'));
            Ok(Command::FilamentSensor(FilamentSensorWords { on, distance, resets }))
        }
        425 => {
            let words = code.places(words)?;
            let play = b"XYZ".map(|axis| words.value(axis));
            Ok(Command::Backlash(BacklashWords { play, correction: words.value(b'F'), smoothing: words.value(b'S') }))
        }
        569 => drivers::stealth_chop(code, words),
        572 => pressure_advance::parse(code, words, &pressure_advance::M572),
        900 => pressure_advance::parse(code, words, &pressure_advance::M900),
        593 => super::input_shaper::parse(code, words),
        851 => {
            let words = code.places(words)?;
            let [x, y, z] = b"XYZ".map(|axis| words.value(axis));
            Ok(Command::ProbeOffset(AxisWords { x, y, z, e: None }))
        }
        852 => {
            let words = code.words(words)?;
            let [xy, of_xy, xz, yz] = b"ISJK".map(|plane| words.value(plane));
            Ok(Command::Skew(SkewCommand::Factors([xy.or(of_xy), xz, yz])))
        }
        906 => drivers::setting(DriverSetting::Current, code, words),
        913 => drivers::setting(DriverSetting::SpreadCycleAbove, code, words),
        914 => drivers::setting(DriverSetting::StallThreshold, code, words),
        955 | 956 => super::accelerometer::parse(code, words),
        790 => {
            let words = code.words(words)?;
            let Some(size) = words.nearest(b'S', 1)?.and_then(|size| u32::try_from(size).ok()) else {
                return Err(ParseError::WordsExpected { command: "M790", words: "S" });
            };
            let silence_s = words.whole_up_to(b'T', MAX_SILENCE_S)?.unwrap_or(DEFAULT_SILENCE_S);
            Ok(Command::ReceiveJob { size, silence_s })
        }
        791 => Ok(Command::BlackBox { clear: code.words(words)?.has(b'R') }),
        795 => {
            let words = code.words(words)?;
            Ok(Command::AdaptiveExtrusion {
                on: words.switch(b'S')?,
                layer_height: words.required_above_zero(b'H')?,
                line_width: words.required_above_zero(b'W')?,
                filament_diameter: words.required_above_zero(b'D')?,
            })
        }
        796 => {
            let words = code.words(words)?;
            Ok(Command::MotionChoice {
                interpolation: words.whole_to(b'I', 4)?,
                acceleration: words.whole_to(b'A', 3)?,
            })
        }
        797 => Ok(Command::ReportMotion),
        798 => {
            let words = code.words(words)?;
            Ok(Command::Timing { on: words.switch(b'S')?, clear: words.has(b'R') })
        }
        999 => Ok(Command::Restart),
        73 => progress(code, words),
        _ => code.not_executed(words),
    }
}

/// M301, M304 and M309. C and L of M301, what the filament takes, have no effect; its H is
/// RepRapFirmware's, 0 is the bed.
fn gains<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    let mut is_nozzle = code.number == 301;
    let mut tool = None;
    if is_nozzle {
        tool = words.tool(b'E');
        is_nozzle = match words.whole(b'H') {
            None | Some(1) => true,
            Some(0) => false,
            Some(_) => return Err(ParseError::WordsExpected { command: "M301", words: "H1 (nozzle) or H0 (bed)" }),
        };
    }
    let [proportional, integral, derivative] = b"PID".map(|letter| words.value(letter));
    let fan = if is_nozzle { words.value(b'F') } else { None };
    let gains = GainWords { proportional, integral, derivative, fan };
    Ok(match code.number {
        309 => Command::ChamberGains(gains),
        _ if is_nozzle => Command::NozzleGains(tool, gains),
        _ => Command::BedGains(gains),
    })
}

/// M303: E is Marlin's word, -1 is the bed and -2 the chamber, H RepRapFirmware's, 0 is the bed,
/// and T its tool. D switches messages of the control in Marlin, and heats nothing.
fn autotune<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    if words.is_present(b'D') {
        return Ok(Command::Accepted);
    }
    let of = match (words.whole(b'E').or(words.whole(b'T')), words.whole(b'H')) {
        (Some(tool @ 0..), None) => TunedHeater::Nozzle(Some(u8::try_from(tool).unwrap_or(u8::MAX))),
        (None, Some(1) | None) => TunedHeater::Nozzle(None),
        (Some(-1), None) | (None, Some(0)) => TunedHeater::Bed,
        (Some(-2), None) => TunedHeater::Chamber,
        _ => {
            let words = "E0 or H1 (nozzle), E-1 or H0 (bed), E-2 (chamber)";
            return Err(ParseError::WordsExpected { command: "M303", words });
        }
    };
    let cycles = words.whole_to(b'C', MAX_CYCLES)?;
    let uses = words.flag(b'U');
    Ok(Command::Autotune { of, target: words.not_negative(b'S')?, cycles, uses })
}

fn temperature<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    let is_nozzle = matches!(code.number, 104 | 109);
    let mut tool = None;
    if is_nozzle {
        tool = words.tool(b'T');
    } else {
        words.needless(b'T');
        // RepRapFirmware's further beds and chambers.
        if words.is_other_than(b'P', 0) {
            return Ok(Command::Accepted);
        }
    }
    let target = words.target(b'S');
    if target.is_none() && matches!(code.number, 104 | 140 | 141) {
        words.remark(Remark::WithoutS);
    }
    Ok(match code.number {
        104 => Command::SetNozzle(tool, target),
        140 => Command::SetBed(target),
        141 => Command::SetChamber(target),
        _ => {
            let wait = match (target, words.target(b'R')) {
                (Some(target), _) => WaitTarget::Heating(target),
                (None, Some(target)) => WaitTarget::HeatingOrCooling(target),
                (None, None) => WaitTarget::Current,
            };
            match code.number {
                109 => Command::WaitNozzle(tool, wait),
                190 => Command::WaitBed(wait),
                _ => Command::WaitChamber(wait),
            }
        }
    })
}

/// M400. Bambu's firmware also takes the words of G4, and U1 for a pause.
#[inline(never)]
fn finish<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    if words.flag(b'U') {
        return Ok(Command::Pause(AxisWords::default()));
    }
    let from_milliseconds = words.nearest(b'P', 1)?;
    let milliseconds = words.nearest(b'S', 1000)?.or(from_milliseconds);
    Ok(milliseconds.map_or(Command::Finish, |milliseconds| Command::Dwell { milliseconds }))
}

/// M73: numbers that are too large become the largest, for no print is worse for that.
fn progress<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    // Q and S set the same for a quieter mode (Prusa), which this machine does not have.
    let _ = (words.value(b'Q'), words.value(b'S'));
    let mut up_to = |letter: u8, most: u16| -> Result<Option<u16>, ParseError> {
        let Some(value) = words.nearest(letter, 1)? else { return Ok(None) };
        if value > u64::from(most) {
            words.remark(Remark::TooLarge(letter));
        }
        Ok(Some(u16::try_from(value).unwrap_or(most).min(most)))
    };
    let (percent, minutes_left) = (up_to(b'P', 100)?, up_to(b'R', u16::MAX)?);
    Ok(Command::Progress { percent: percent.map(|percent| percent as u8), minutes_left })
}

/// M0, M1: a time, and a text for the person.
fn stop<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let mut text = code.free_text();
    let mut times = 0;
    while let Some(length) = time_length(text) {
        times += length;
        text = text.get(length..).unwrap_or_default();
    }
    // A comment in brackets does not belong to it.
    text = text.get(skip_blanks(text.as_bytes(), 0)..).unwrap_or_default();
    let times = code.free_text().get(..times).unwrap_or_default();
    words.read(times, Strays::Remarked)?;
    let longest_ms = match words.nearest(b'S', 1000)? {
        Some(milliseconds) => Some(milliseconds),
        None => words.nearest(b'P', 1)?,
    };
    Ok(Command::Stop { longest_ms, text })
}

/// Length of the word P or S at the start of a text, with the blanks after it; `None` if it
/// begins with another.
fn time_length(text: &str) -> Option<usize> {
    let bytes = text.as_bytes();
    let at = match bytes {
        [b'P' | b'p' | b'S' | b's', ..] => skip_blanks(bytes, 1),
        _ => return None,
    };
    let (length, number) = Decimal::parse_prefix(bytes.get(at..)?);
    let end = at + length;
    let ends = matches!(bytes.get(end), None | Some(b' ' | b'\t' | b'P' | b'p' | b'S' | b's'));
    (number.is_ok() && ends).then(|| skip_blanks(bytes, end))
}

/// M125, M226, M600 and M601.
fn pause<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    let park = AxisWords { x: words.value(b'X'), y: words.value(b'Y'), z: words.not_negative(b'Z')?, e: None };
    if code.number != 600 {
        return Ok(Command::Pause(park));
    }
    // Marlin's words, with either sign.
    Ok(Command::ChangeFilament { tool: words.tool(b'T'), park, unload: words.value(b'U'), load: words.value(b'L') })
}

/// M603, M701 and M702. `M702 C`, at the end of prints for Prusa's MK3, unloads where there is a
/// multi-material unit, and nothing without one.
#[inline(never)]
fn filament<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let loads = code.number == 701;
    let words = code.words(words)?;
    if code.number == 603 {
        return Ok(Command::FilamentLengths { unload: words.value(b'U'), load: words.value(b'L') });
    }
    if !loads && words.has(b'C') {
        words.forgive();
        words.remark(Remark::NoEffect(b'C'));
        return Ok(Command::Accepted);
    }
    let length = words.value(if loads { b'L' } else { b'U' });
    Ok(Command::LoadFilament { loads, tool: words.tool(b'T'), length, rise: words.value(b'Z') })
}

/// Words of M106 with which no firmware sets a power.
const FAN_WORDS: &[u8] = b"ABCFHKLRX";

/// M106 and M107. Slicers write powers such as 252.45, which are rounded. Other words without an S
/// set up the fan elsewhere, and not its power.
#[inline(never)]
fn fan<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    let number = words.whole_to(b'P', u8::MAX)?.unwrap_or(0);
    if code.number == 107 {
        return Ok(Command::Fan { number, power: 0 });
    }
    words.remark_small_power(b'S');
    // T chooses a power for later, whatever S says.
    let is_set_up = !words.is_present(b'S') && FAN_WORDS.iter().any(|&letter| words.is_present(letter));
    if is_set_up || words.is_present(b'I') || words.is_present(b'T') {
        words.remark(Remark::NoFanPower);
        return Ok(Command::Accepted);
    }
    let power = words.nearest_byte(b'S')?.unwrap_or(u8::MAX);
    Ok(Command::Fan { number, power })
}

/// M200: E becomes a length of filament or a volume.
fn volumetric<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
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
    // The words of M149 are letters without numbers.
    let mut remarks = Remarks::default();
    let mut words = code.peek(&mut remarks)?;
    if words.has(b'F') || words.has(b'K') {
        let why = "temperatures would be read as degrees Celsius; use M149 C";
        return Err(ParseError::NotSupported { command: "M149 F and K", why });
    }
    Ok(Command::Accepted)
}

/// M862.3: the text of P, with or without quotes; empty for a query.
fn model(text: &str) -> &str {
    let named = text.strip_prefix(['P', 'p']).unwrap_or_default();
    named.trim_matches([' ', '\t']).trim_matches('"')
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
            // The only port is the one that the command came by.
            [b'P', digits @ ..] if Decimal::parse(digits).is_ok_and(|port| !port.is_negative()) => {}
            _ => return Command::Echo { echo_prefix, action_prefix, text },
        }
        text = rest.trim_start_matches([' ', '\t']);
    }
}
