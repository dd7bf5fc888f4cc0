//! Commands as programs print them.

use proptest::prelude::*;

use crate::{
    AdvanceWords, ArcForm, AxisFlags, AxisWords, BacklashWords, Command, Decimal, DriverWords, FeedWords,
    FilamentSensorWords, GainWords, PinCommand, PrintClockCommand, RetractionWords, SettingsCommand, ShaperWords,
    SkewCommand, SupplyCommand, TunedHeater, Units, WaitTarget,
};

/// A command's words: letter and number.
type Words = Vec<(char, Option<Decimal>)>;

fn number_of(tool: Option<u8>) -> Option<Decimal> {
    tool.map(|tool| whole(tool.into()))
}

fn whole(value: i64) -> Decimal {
    Decimal::from_nanos(value * 1_000_000_000)
}

/// `name` and `words` in one of the ways a program may write them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    spaces: bool,
    lower_case: bool,
    leading_zero: bool,
    rotate: usize,
    comment: bool,
}

pub(super) fn style() -> impl Strategy<Value = Style> {
    (any::<bool>(), any::<bool>(), any::<bool>(), 0usize..4, any::<bool>()).prop_map(
        |(spaces, lower_case, leading_zero, rotate, comment)| Style {
            spaces,
            lower_case,
            leading_zero,
            rotate,
            comment,
        },
    )
}

fn axes(axes: AxisWords) -> Words {
    [('X', axes.x), ('Y', axes.y), ('Z', axes.z), ('E', axes.e)]
        .into_iter()
        .filter(|(_, value)| value.is_some())
        .collect()
}

fn flags(flags: AxisFlags) -> Words {
    [('X', flags.x), ('Y', flags.y), ('Z', flags.z), ('E', flags.e)]
        .into_iter()
        .filter_map(|(letter, named)| named.then_some((letter, None)))
        .collect()
}

fn given<const N: usize>(words: [(char, Option<Decimal>); N]) -> Words {
    words.into_iter().filter(|(_, value)| value.is_some()).collect()
}

fn drivers(words: DriverWords) -> Words {
    let numbers = words.all().map(|number| number.map(|number| whole(number.into())));
    let tool = [('T', number_of(words.tool))];
    ['X', 'Y', 'Z', 'E'].into_iter().zip(numbers).chain(tool).filter(|(_, number)| number.is_some()).collect()
}

fn switch(value: Option<bool>) -> Option<Decimal> {
    value.map(|value| whole(i64::from(value)))
}

fn wait(target: WaitTarget) -> Words {
    match target {
        WaitTarget::Heating(value) => given([('S', Some(value))]),
        WaitTarget::HeatingOrCooling(value) => given([('R', Some(value))]),
        WaitTarget::Current => Words::new(),
        WaitTarget::AtLeast(_) => unreachable!("a word of TEMPERATURE_WAIT"),
    }
}

fn retraction(words: RetractionWords) -> Words {
    given([('S', words.length), ('F', words.feed), ('Z', words.lift)])
}

fn gains(words: GainWords) -> Words {
    given([('P', words.proportional), ('I', words.integral), ('D', words.derivative), ('F', words.fan)])
}

/// Letter and number of the command, and its words.
fn take_apart(command: Command<'_>) -> (char, u32, Words) {
    let (code, words) = match command {
        Command::Linear { rapid, axes: to, feed } => (u32::from(!rapid), [axes(to), given([('F', feed)])].concat()),
        Command::Arc { clockwise, axes: to, form, feed } => {
            let circle = match form {
                ArcForm::Centre { i, j } => given([('I', Some(i)), ('J', Some(j))]),
                ArcForm::Radius(radius) => given([('R', Some(radius))]),
            };
            (if clockwise { 2 } else { 3 }, [axes(to), circle, given([('F', feed)])].concat())
        }
        Command::Dwell { milliseconds } => (4, given([('P', Some(whole(milliseconds as i64)))])),
        Command::Retract => (10, vec![]),
        Command::Recover => (11, vec![]),
        Command::SetUnits(Units::Inches) => (20, vec![]),
        Command::SetUnits(Units::Millimetres) => (21, vec![]),
        Command::Home { axes: which, unless_homed } => {
            (28, [flags(which), given([('O', unless_homed.then_some(whole(1)))])].concat())
        }
        Command::AbsolutePositioning => (90, vec![]),
        Command::RelativePositioning => (91, vec![]),
        Command::SetPosition(to) => (92, axes(to)),
        Command::SelectTool { tool: Some(tool), stays } => {
            return ('T', tool, given([('S', stays.then_some(whole(1)))]));
        }
        other => {
            let (code, words) = take_apart_m(other);
            return ('M', code, words);
        }
    };
    ('G', code, words)
}

fn take_apart_m(command: Command<'_>) -> (u32, Words) {
    match command {
        Command::EnableMotors(which) => (17, flags(which)),
        Command::DisableMotors(which) => (84, flags(which)),
        Command::IdleTimeout { seconds } => (18, given([('S', Some(whole(seconds as i64)))])),
        Command::HeaterTimeout(seconds) => (86, given([('S', seconds.map(|value| whole(value.into())))])),
        Command::Supply(SupplyCommand::On) => (80, vec![]),
        Command::Supply(SupplyCommand::Report) => (80, vec![('S', None)]),
        Command::Supply(SupplyCommand::Off { when_cool: false }) => (81, vec![]),
        Command::Supply(SupplyCommand::Off { when_cool: true }) => (81, vec![('S', Some(whole(1)))]),
        Command::ProbePin(PinCommand::Out) => (401, vec![]),
        Command::ProbePin(PinCommand::In) => (402, vec![]),
        Command::ProbePin(PinCommand::Pulses { width_us }) => (280, given([('S', Some(whole(width_us.into())))])),
        Command::AbsoluteExtrusion => (82, vec![]),
        Command::RelativeExtrusion => (83, vec![]),
        Command::SetNozzle(tool, target) => (104, given([('T', number_of(tool)), ('S', target)])),
        Command::WaitNozzle(tool, target) => (109, [given([('T', number_of(tool))]), wait(target)].concat()),
        Command::SetBed(target) => (140, given([('S', target)])),
        Command::WaitBed(target) => (190, wait(target)),
        Command::SetChamber(target) => (141, given([('S', target)])),
        Command::WaitChamber(target) => (191, wait(target)),
        Command::AutoReportTemperatures { seconds } => (155, given([('S', Some(whole(seconds.into())))])),
        Command::Fan { number, power } => {
            (106, given([('P', Some(whole(number.into()))), ('S', Some(whole(power.into())))]))
        }
        Command::SetOutput { number, power } => {
            (42, given([('P', number.map(|number| whole(number.into()))), ('S', Some(whole(power.into())))]))
        }
        Command::SetLight { colors: [red, green, blue, white] } => (
            150,
            given(
                [('R', red), ('U', green), ('B', blue), ('W', white)]
                    .map(|(letter, power)| (letter, Some(whole(power.into())))),
            ),
        ),
        Command::SetLineNumber(number) => (110, given([('N', number.map(whole))])),
        Command::KeepAlive(seconds) => (113, given([('S', seconds.map(|value| whole(value.into())))])),
        Command::ReportSetting(code) => (code.trim_start_matches('M').parse().unwrap_or_default(), vec![]),
        Command::MaxAcceleration(limits) => (201, axes(limits)),
        Command::StepsPerMm(tool, steps) => (92, [given([('T', number_of(tool))]), axes(steps)].concat()),
        Command::ToolOffset { tool, offset } => (218, [given([('T', number_of(tool))]), axes(offset)].concat()),
        Command::MaxFeed(limits) => (203, axes(limits)),
        Command::Acceleration { print, retract, travel, both } => {
            (204, given([('P', print), ('R', retract), ('T', travel), ('S', both)]))
        }
        Command::Junction { deviation, corner_velocity } => {
            (205, [given([('J', deviation)]), axes(corner_velocity)].concat())
        }
        // These commands have names: `named_tests.rs` reads them.
        Command::VelocityLimit { .. } | Command::HeatersOff | Command::Layer { .. } => unreachable!("{command:?}"),
        Command::RetractSettings(words) => (207, retraction(words)),
        Command::RecoverSettings(words) => (208, retraction(words)),
        Command::ShiftZ { words, keeps_offset } => {
            (290, [axes(words), given([('P', keeps_offset.then_some(Decimal::ZERO))])].concat())
        }
        // Read in `bed.rs`.
        Command::Bed(_) => unreachable!("{command:?}"),
        Command::ProbeOffset(words) => (851, axes(words)),
        Command::Settings(SettingsCommand::Store) => (500, vec![]),
        Command::Settings(SettingsCommand::Load) => (501, vec![]),
        Command::Settings(SettingsCommand::Reset) => (502, vec![]),
        Command::Settings(SettingsCommand::Report { headings }) => (503, given([('S', switch(Some(headings)))])),
        Command::Settings(SettingsCommand::Validate) => (504, vec![]),
        Command::Progress { percent, minutes_left } => (
            73,
            given([
                ('P', percent.map(|percent| whole(percent.into()))),
                ('R', minutes_left.map(|minutes| whole(minutes.into()))),
            ]),
        ),
        Command::Stop { longest_ms, .. } => {
            (0, given([('P', longest_ms.map(|milliseconds| whole(milliseconds as i64)))]))
        }
        Command::Pause(park) => (601, axes(park)),
        Command::ReportFans => (123, vec![]),
        Command::FilamentLengths { unload, load } => (603, given([('U', unload), ('L', load)])),
        Command::LoadFilament { loads, tool, length, rise } => {
            let (code, letter) = if loads { (701, 'L') } else { (702, 'U') };
            (code, given([('T', number_of(tool)), (letter, length), ('Z', rise)]))
        }
        Command::ChangeFilament { tool: _, park, unload, load } => {
            (600, [axes(park), given([('U', unload), ('L', load)])].concat())
        }
        Command::ResumePrint => (602, vec![]),
        Command::FilamentSensor(FilamentSensorWords { on, distance, resets }) => {
            let mut words = given([('S', switch(on)), ('D', distance)]);
            words.extend(resets.then_some(('R', None)));
            (412, words)
        }
        Command::PromptAnswer(button) => (876, vec![('S', Some(whole(button.into())))]),
        Command::SoftLimits(on) => (211, given([('S', switch(on))])),
        Command::FeedPercent(FeedWords { percent, keeps, restores }) => {
            let mut words = given([('S', percent)]);
            words.extend(
                [('B', keeps), ('R', restores)].into_iter().filter_map(|(word, on)| on.then_some((word, None))),
            );
            (220, words)
        }
        Command::PrintClock(PrintClockCommand::Start) => (75, vec![]),
        Command::PrintClock(PrintClockCommand::Pause) => (76, vec![]),
        Command::PrintClock(PrintClockCommand::Stop) => (77, vec![]),
        Command::PrintClock(PrintClockCommand::Report) => (78, vec![]),
        Command::PrintClock(PrintClockCommand::Clear) => (78, given([('S', Some(whole(78)))])),
        Command::HomeOffset(words) => (206, axes(words)),
        Command::Backlash(BacklashWords { play: [x, y, z], correction, smoothing }) => {
            (425, given([('F', correction), ('S', smoothing), ('X', x), ('Y', y), ('Z', z)]))
        }
        Command::Skew(SkewCommand::Factors([xy, xz, yz])) => (852, given([('I', xy), ('J', xz), ('K', yz)])),
        Command::FlowPercent(tool, percent) => (221, given([('T', number_of(tool)), ('S', percent)])),
        Command::NozzleGains(tool, words) => (301, [given([('E', number_of(tool))]), gains(words)].concat()),
        Command::BedGains(words) => (304, gains(words)),
        Command::ChamberGains(words) => (309, gains(words)),
        Command::Autotune { of, target, cycles, uses } => (
            303,
            given([
                (
                    'E',
                    match of {
                        TunedHeater::Nozzle(tool) => number_of(tool),
                        TunedHeater::Bed => Some(whole(-1)),
                        TunedHeater::Chamber => Some(whole(-2)),
                    },
                ),
                ('S', target),
                ('C', cycles.map(|cycles| whole(cycles.into()))),
                ('U', uses.then_some(whole(1))),
            ]),
        ),
        // ANCHOR: m302
        Command::ColdExtrusion { minimum, allow } => (302, given([('S', minimum), ('P', switch(allow))])),
        // ANCHOR_END: m302
        Command::ReportTemperatures => (105, vec![]),
        Command::EndWait => (108, vec![]),
        Command::EmergencyStop => (112, vec![]),
        Command::ReportPosition => (114, vec![]),
        Command::ReportFirmware => (115, vec![]),
        Command::ReportEndStops => (119, vec![]),
        Command::ReportDrivers => (122, vec![]),
        Command::StealthChop { motors, tool, on } => {
            (569, [flags(motors), given([('T', number_of(tool)), ('S', switch(on))])].concat())
        }
        Command::Driver(setting, words) => (setting.code(), drivers(words)),
        Command::ReceiveJob { size, silence_s } => {
            (790, given([('S', Some(whole(size.into()))), ('T', Some(whole(silence_s.into())))]))
        }
        Command::AdaptiveExtrusion { on, layer_height, line_width, filament_diameter } => {
            (795, given([('S', switch(on)), ('H', layer_height), ('W', line_width), ('D', filament_diameter)]))
        }
        Command::MotionChoice { interpolation, acceleration } => {
            let number = |value: Option<u8>| value.map(|value| whole(value.into()));
            (796, given([('I', number(interpolation)), ('A', number(acceleration))]))
        }
        Command::InputShaper { axes: [x, y], .. } => {
            let named = |words| words != ShaperWords::default();
            let words = if named(x) { x } else { y };
            let axes = AxisFlags { x: named(x) && x != y, y: named(y) && x != y, z: false, e: false };
            (593, [flags(axes), given([('F', words.frequency), ('D', words.damping)])].concat())
        }
        Command::PressureAdvance(tool, AdvanceWords { slow, fast, speed, smooth_time }) => {
            (572, given([('D', number_of(tool)), ('S', slow), ('L', fast), ('T', speed), ('W', smooth_time)]))
        }
        Command::ReportMotion => (797, vec![]),
        Command::BlackBox { clear } => (791, if clear { vec![('R', None)] } else { vec![] }),
        Command::Timing { on, clear } => {
            (798, [given([('S', switch(on))]), if clear { vec![('R', None)] } else { vec![] }].concat())
        }
        Command::Finish => (400, vec![]),
        Command::QuickStop => (410, vec![]),
        Command::Restart => (999, vec![]),
        other => panic!("{other:?} is printed elsewhere"),
    }
}

pub(super) fn print(command: Command<'_>, style: Style) -> String {
    match command {
        Command::Display(text) => return format!("M117 {text}"),
        Command::Echo { echo_prefix, action_prefix, text } => {
            let echo = if echo_prefix { "E1 " } else { "" };
            let action = if action_prefix { "A1 " } else { "" };
            return format!("M118 {action}{echo}{text}");
        }
        Command::Accepted => return "M486 S1".to_owned(),
        Command::Unknown(text) | Command::HeaterModel { text, .. } => return text.to_owned(),
        _ => {}
    }
    let (letter, code, mut words) = take_apart(command);
    let turn = style.rotate.min(words.len());
    words.rotate_left(turn);
    let zero = if style.leading_zero { "0" } else { "" };
    let gap = if style.spaces { " " } else { "" };
    let mut line = format!("{letter}{zero}{code}");
    for (letter, value) in words {
        let value = value.map(|value| format!("{gap}{value}")).unwrap_or_default();
        line += &format!("{gap}{letter}{value}");
    }
    if let Command::InputShaper { axes: [x, y], .. } = command
        && let Some(kind) = x.kind.or(y.kind)
    {
        line += &format!("{gap}P{gap}\"{kind}\"");
    }
    if style.comment {
        line += " (G1 X1) ; G1 X2";
    }
    if style.lower_case { line.to_lowercase() } else { line }
}
