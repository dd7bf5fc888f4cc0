//! Random commands, printed as programs print them, read back as the same commands.

use proptest::option::of;
use proptest::prelude::*;

use crate::{
    AdvanceWords, ArcForm, AxisFlags, AxisWords, Command, Decimal, DriverWords, FeedWords, FilamentSensorWords,
    GainWords, LineReader, PrintClockCommand, RetractionWords, ShaperWords, SkewCommand, TunedHeater, Units,
    WaitTarget, parse,
};
use crate::{PinCommand, SettingsCommand, SupplyCommand};

/// A command's words: letter and number.
type Words = Vec<(char, Option<Decimal>)>;

const TEXTS: [&str; 5] = ["", "Hello", "Layer 3/100 (50 %)", "20*3", "Gr\u{fc}n \u{2014} fertig"];

fn whole(value: i64) -> Decimal {
    Decimal::from_nanos(value * 1_000_000_000)
}

/// `name` and `words` in one of the ways a program may write them.
#[derive(Clone, Copy, Debug)]
struct Style {
    spaces: bool,
    lower_case: bool,
    leading_zero: bool,
    rotate: usize,
    comment: bool,
}

fn style() -> impl Strategy<Value = Style> {
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
        Command::Home(which) => (28, flags(which)),
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
        // Their commands have names: `named_tests.rs` reads them.
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
        Command::Stop { longest_ms } => (0, given([('P', longest_ms.map(|milliseconds| whole(milliseconds as i64)))])),
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
        Command::DriverCurrent(words) => (906, drivers(words)),
        Command::StallThreshold(words) => (914, drivers(words)),
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

fn print(command: Command<'_>, style: Style) -> String {
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

fn any_number() -> impl Strategy<Value = Decimal> {
    prop_oneof![
        (-300_000_000i64..300_000_000).prop_map(|micro| Decimal::from_nanos(micro * 1000)),
        (-i64::MAX..=i64::MAX).prop_map(Decimal::from_nanos),
    ]
}

fn above_zero() -> impl Strategy<Value = Decimal> {
    (1..=i64::MAX).prop_map(Decimal::from_nanos)
}

fn not_negative() -> impl Strategy<Value = Decimal> {
    (0..=i64::MAX).prop_map(Decimal::from_nanos)
}

fn percent() -> impl Strategy<Value = Decimal> {
    (1i64..=999_000_000_000).prop_map(Decimal::from_nanos)
}

fn any_axes() -> impl Strategy<Value = AxisWords> {
    (of(any_number()), of(any_number()), of(any_number()), of(any_number())).prop_map(|(x, y, z, e)| AxisWords {
        x,
        y,
        z,
        e,
    })
}

fn any_limits() -> impl Strategy<Value = AxisWords> {
    (of(above_zero()), of(above_zero()), of(above_zero()), of(above_zero())).prop_map(|(x, y, z, e)| AxisWords {
        x,
        y,
        z,
        e,
    })
}

fn any_flags() -> impl Strategy<Value = AxisFlags> {
    any::<[bool; 4]>().prop_map(|[x, y, z, e]| AxisFlags { x, y, z, e })
}

fn any_drivers(high: u16) -> impl Strategy<Value = DriverWords> {
    ([of(0..=high), of(0..=high), of(0..=high), of(0..=high)], of(any_tool()))
        .prop_map(|([x, y, z, e], tool)| DriverWords { x, y, z, e, tool })
}

fn any_stealth_chop() -> impl Strategy<Value = Command<'static>> {
    (any_flags(), of(any_tool()), of(any::<bool>()))
        .prop_filter("S needs a motor", |(motors, _, on)| on.is_none() || !motors.is_empty())
        .prop_map(|(motors, tool, on)| Command::StealthChop { motors, tool, on })
}

fn any_gains() -> impl Strategy<Value = Command<'static>> {
    (of(any_number()), of(any_number()), of(any_number()), of(any_number()), 0..3_u8).prop_map(
        |(proportional, integral, derivative, fan, heater)| {
            let words = GainWords { proportional, integral, derivative, fan };
            let unfanned = GainWords { fan: None, ..words };
            match heater {
                0 => Command::NozzleGains(None, words),
                1 => Command::BedGains(unfanned),
                _ => Command::ChamberGains(unfanned),
            }
        },
    )
}

fn any_tuned_heater() -> impl Strategy<Value = TunedHeater> {
    prop_oneof![of(any_tool()).prop_map(TunedHeater::Nozzle), Just(TunedHeater::Bed), Just(TunedHeater::Chamber)]
}

fn any_autotune() -> impl Strategy<Value = Command<'static>> {
    (any_tuned_heater(), of(not_negative()), of(0..=20_u8), any::<bool>())
        .prop_map(|(of, target, cycles, uses)| Command::Autotune { of, target, cycles, uses })
}

/// As M593 sets it: of one axis, or of both alike.
fn any_shaper() -> impl Strategy<Value = Command<'static>> {
    let kind = of(proptest::sample::select(&["none", "zv", "mzv", "ei2", "zvddd", ""][..]));
    (kind, of(any_number()), of(any_number()), 1..=3_u8).prop_map(|(kind, frequency, damping, axes)| {
        let words = ShaperWords { kind, frequency, damping };
        let axes = [1, 2].map(|axis| if axes & axis == 0 { ShaperWords::default() } else { words });
        Command::InputShaper { axes, usual: "zv" }
    })
}

fn any_advance() -> impl Strategy<Value = Command<'static>> {
    (any_number(), of((any_number(), any_number())), of(any_number()), any::<bool>()).prop_map(
        |(slow, above, smooth_time, asks)| {
            let (fast, speed) = above.unzip();
            let words = AdvanceWords { slow: Some(slow), fast, speed, smooth_time };
            Command::PressureAdvance(None, if asks { AdvanceWords::default() } else { words })
        },
    )
}

fn any_tool() -> impl Strategy<Value = u8> {
    0..=254_u8
}

fn number_of(tool: Option<u8>) -> Option<Decimal> {
    tool.map(|tool| whole(tool.into()))
}

fn any_wait() -> impl Strategy<Value = WaitTarget> {
    prop_oneof![
        not_negative().prop_map(WaitTarget::Heating),
        not_negative().prop_map(WaitTarget::HeatingOrCooling),
        Just(WaitTarget::Current),
    ]
}

fn any_form() -> impl Strategy<Value = ArcForm> {
    prop_oneof![
        (any_number(), any_number()).prop_map(|(i, j)| ArcForm::Centre { i, j }),
        any_number().prop_map(ArcForm::Radius),
    ]
}

fn motion() -> impl Strategy<Value = Command<'static>> {
    prop_oneof![
        (any::<bool>(), any_axes(), of(above_zero())).prop_map(|(rapid, axes, feed)| Command::Linear {
            rapid,
            axes,
            feed
        }),
        (any::<bool>(), any_axes(), any_form(), of(above_zero()))
            .prop_map(|(clockwise, axes, form, feed)| Command::Arc { clockwise, axes, form, feed }),
        (0u64..9_000_000_000).prop_map(|milliseconds| Command::Dwell { milliseconds }),
        any_flags().prop_map(Command::Home),
        any_axes()
            .prop_filter("without words all axes are set", |words| *words != AxisWords::default())
            .prop_map(Command::SetPosition),
        (0u32..u32::MAX, any::<bool>()).prop_map(|(tool, stays)| Command::SelectTool { tool: Some(tool), stays }),
        proptest::sample::select(vec![
            Command::Retract,
            Command::Recover,
            Command::SetUnits(Units::Inches),
            Command::SetUnits(Units::Millimetres),
            Command::AbsolutePositioning,
            Command::RelativePositioning,
        ]),
    ]
}

fn settings() -> impl Strategy<Value = Command<'static>> {
    prop_oneof![
        any_limits().prop_map(Command::MaxAcceleration),
        (of(any_tool()), any_limits()).prop_map(|(tool, steps)| Command::StepsPerMm(tool, steps)),
        any_limits().prop_map(Command::MaxFeed),
        (of(above_zero()), of(above_zero()), of(above_zero()), of(above_zero()))
            .prop_map(|(print, retract, travel, both)| Command::Acceleration { print, retract, travel, both }),
        (of(above_zero()), any_limits())
            .prop_map(|(deviation, corner_velocity)| Command::Junction { deviation, corner_velocity }),
        (of(not_negative()), of(above_zero()), of(not_negative()))
            .prop_map(|(length, feed, lift)| { Command::RetractSettings(RetractionWords { length, feed, lift }) }),
        (of(any_number()), of(above_zero()))
            .prop_map(|(length, feed)| { Command::RecoverSettings(RetractionWords { length, feed, lift: None }) }),
        (any_axes(), any::<bool>()).prop_map(|(words, keeps_offset)| Command::ShiftZ { words, keeps_offset }),
        any_axes().prop_map(|words| Command::ProbeOffset(AxisWords { e: None, ..words })),
        any::<bool>().prop_map(|headings| Command::Settings(SettingsCommand::Report { headings })),
        of(any::<bool>()).prop_map(Command::SoftLimits),
        (of(percent()), any::<bool>(), any::<bool>())
            .prop_map(|(percent, keeps, restores)| Command::FeedPercent(FeedWords { percent, keeps, restores })),
        prop_oneof![
            Just(PrintClockCommand::Start),
            Just(PrintClockCommand::Pause),
            Just(PrintClockCommand::Stop),
            Just(PrintClockCommand::Report),
            Just(PrintClockCommand::Clear),
        ]
        .prop_map(Command::PrintClock),
        any_axes().prop_map(|words| Command::HomeOffset(AxisWords { e: None, ..words })),
        [of(any_number()), of(any_number()), of(any_number())]
            .prop_map(|factors| Command::Skew(SkewCommand::Factors(factors))),
        (of(any_tool()), of(percent())).prop_map(|(tool, percent)| Command::FlowPercent(tool, percent)),
        (of(not_negative()), of(any::<bool>())).prop_map(|(minimum, allow)| Command::ColdExtrusion { minimum, allow }),
    ]
}

fn any_park() -> impl Strategy<Value = AxisWords> {
    (of(not_negative()), of(not_negative()), of(not_negative())).prop_map(|(x, y, z)| AxisWords { x, y, z, e: None })
}

fn machine() -> impl Strategy<Value = Command<'static>> {
    prop_oneof![
        any_flags().prop_map(Command::EnableMotors),
        any_flags().prop_map(Command::DisableMotors),
        (0u64..9_000_000_000).prop_map(|seconds| Command::IdleTimeout { seconds }),
        of(any::<u16>()).prop_map(Command::HeaterTimeout),
        (of(any_tool()), of(not_negative())).prop_map(|(tool, target)| Command::SetNozzle(tool, target)),
        (of(any_tool()), of(any_number()), of(any_number()), of(any_number()))
            .prop_map(|(tool, x, y, z)| { Command::ToolOffset { tool, offset: AxisWords { x, y, z, e: None } } }),
        of(not_negative()).prop_map(Command::SetBed),
        (of(any_tool()), any_wait()).prop_map(|(tool, wait)| Command::WaitNozzle(tool, wait)),
        any_wait().prop_map(Command::WaitBed),
        of(not_negative()).prop_map(Command::SetChamber),
        any_wait().prop_map(Command::WaitChamber),
        (0u32..1_000_000_000, 0u16..=3600).prop_map(|(size, silence_s)| Command::ReceiveJob { size, silence_s }),
        (0u8..=60).prop_map(|seconds| Command::AutoReportTemperatures { seconds }),
        of(0u8..=60).prop_map(Command::KeepAlive),
        (of(any::<bool>()), of(above_zero()), of(above_zero()), of(above_zero())).prop_map(
            |(on, layer_height, line_width, filament_diameter)| Command::AdaptiveExtrusion {
                on,
                layer_height,
                line_width,
                filament_diameter,
            }
        ),
        (of(0u8..=100), of(any::<u16>()))
            .prop_map(|(percent, minutes_left)| Command::Progress { percent, minutes_left }),
        of(0u64..1_000_000_000).prop_map(|longest_ms| Command::Stop { longest_ms }),
        any_park().prop_map(Command::Pause),
        (any_park(), of(any_number()), of(any_number())).prop_map(|(park, unload, load)| Command::ChangeFilament {
            tool: None,
            park,
            unload,
            load
        }),
        (of(any_number()), of(any_number())).prop_map(|(unload, load)| Command::FilamentLengths { unload, load }),
        (any::<bool>(), of(any_tool()), of(any_number()), of(any_number()))
            .prop_map(|(loads, tool, length, rise)| Command::LoadFilament { loads, tool, length, rise }),
        Just(Command::ReportFans),
        Just(Command::ResumePrint),
        any::<u8>().prop_map(Command::PromptAnswer),
        (544u16..=2_400).prop_map(|width_us| Command::ProbePin(PinCommand::Pulses { width_us })),
        any_stealth_chop(),
        any_drivers(3000).prop_map(Command::DriverCurrent),
        any_drivers(255).prop_map(Command::StallThreshold),
        (of(0u8..=4), of(0u8..=3))
            .prop_map(|(interpolation, acceleration)| Command::MotionChoice { interpolation, acceleration }),
        any_shaper(),
        any_advance(),
        any_gains(),
        (of(any::<bool>()), of(not_negative()), any::<bool>()).prop_map(|(on, distance, resets)| {
            Command::FilamentSensor(FilamentSensorWords { on, distance, resets })
        }),
        any_autotune(),
        any::<bool>().prop_map(|clear| Command::BlackBox { clear }),
        (of(any::<bool>()), any::<bool>()).prop_map(|(on, clear)| Command::Timing { on, clear }),
        any::<(u8, u8)>().prop_map(|(number, power)| Command::Fan { number, power }),
        (of(any::<u8>()), any::<u8>()).prop_map(|(number, power)| Command::SetOutput { number, power }),
        any::<[u8; 4]>().prop_map(|colors| Command::SetLight { colors }),
        of(-9_000_000_000i64..9_000_000_000).prop_map(Command::SetLineNumber),
        proptest::sample::select(&TEXTS[..]).prop_map(Command::Display),
        (any::<bool>(), any::<bool>(), proptest::sample::select(&TEXTS[..]))
            .prop_map(|(echo_prefix, action_prefix, text)| Command::Echo { echo_prefix, action_prefix, text }),
        proptest::sample::select(vec![
            Command::Supply(SupplyCommand::On),
            Command::Supply(SupplyCommand::Report),
            Command::Supply(SupplyCommand::Off { when_cool: false }),
            Command::Supply(SupplyCommand::Off { when_cool: true }),
            Command::ProbePin(PinCommand::Out),
            Command::ProbePin(PinCommand::In),
            Command::AbsoluteExtrusion,
            Command::RelativeExtrusion,
            Command::ReportTemperatures,
            Command::EndWait,
            Command::EmergencyStop,
            Command::ReportPosition,
            Command::ReportFirmware,
            Command::ReportEndStops,
            Command::ReportDrivers,
            Command::ReportMotion,
            Command::Settings(SettingsCommand::Store),
            Command::Settings(SettingsCommand::Load),
            Command::Settings(SettingsCommand::Reset),
            Command::Settings(SettingsCommand::Validate),
            Command::Finish,
            Command::QuickStop,
            Command::Restart,
            Command::Accepted,
            Command::Unknown("M428 S3"),
            Command::HeaterModel { text: "M306 E0 P40", words: " E0 P40" },
        ]),
    ]
}

proptest! {
    #[test]
    fn a_printed_program_reads_back(
        program in proptest::collection::vec((prop_oneof![motion(), settings(), machine()], style()), 1..30),
        numbered: bool,
    ) {
        let mut text = String::new();
        for (index, (command, style)) in program.iter().enumerate() {
            let line = print(*command, *style);
            if numbered {
                let line = format!("N{index} {line}");
                let checksum = line.bytes().fold(0, |sum, byte| sum ^ byte);
                text += &format!("{line}*{checksum}\n");
            } else {
                text += &format!("{line}\n");
            }
        }
        let mut reader = LineReader::new();
        let mut rest = text.as_bytes();
        for (index, (command, _)) in program.iter().enumerate() {
            let (consumed, line) = reader.feed(rest);
            rest = &rest[consumed..];
            let Some(Ok(line)) = line else { panic!("{line:?} in {text}") };
            prop_assert_eq!(line.line_number, index as u32 + 1);
            prop_assert_eq!(line.number, numbered.then_some(index as i64));
            if numbered {
                prop_assert_eq!(line.checksum, crate::Checksum::Right);
            }
            prop_assert_eq!(parse(line.text), Ok(*command), "{}", line.text);
        }
        prop_assert!(rest.is_empty());
    }

    #[test]
    fn any_text_is_answered(text in "\\PC{0,60}", words in "[ GMTXYZEFIJPRSN0-9.*(;-]{0,60}") {
        let in_quotes = format!("M593 P{text}");
        let named = format!("SET_INPUT_SHAPER SHAPER_TYPE_X={text}");
        for text in [&text, &words, &format!("G1 {words}"), &format!("M204{text}"), &in_quotes, &named] {
            match parse(text) {
                Ok(Command::Unknown(unknown)) => prop_assert!(text.contains(unknown)),
                Ok(_) => {}
                Err(error) => prop_assert!(!error.to_string().is_empty()),
            }
        }
    }
}
