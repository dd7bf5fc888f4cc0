//! Random commands.

use proptest::option::of;
use proptest::prelude::*;

use crate::{
    AdvanceWords, ArcForm, AxisFlags, AxisWords, BacklashWords, Command, Decimal, DriverSetting, DriverWords,
    FeedWords, FilamentSensorWords, GainWords, PinCommand, PrintClockCommand, RetractionWords, SettingsCommand,
    ShaperWords, SkewCommand, SupplyCommand, TunedHeater, Units, WaitTarget,
};

const TEXTS: [&str; 5] = ["", "Hello", "Layer 3/100 (50 %)", "20*3", "Gr\u{fc}n \u{2014} fertig"];

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

fn any_driver_setting() -> impl Strategy<Value = Command<'static>> {
    let settings = [DriverSetting::Current, DriverSetting::SpreadCycleAbove, DriverSetting::StallThreshold];
    proptest::sample::select(settings.to_vec()).prop_flat_map(|setting| {
        let number = || of(0..=setting.max());
        ([number(), number(), number(), number()], of(any_tool()))
            .prop_map(move |([x, y, z, e], tool)| Command::Driver(setting, DriverWords { x, y, z, e, tool }))
    })
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

/// Words of M593: for one axis, or for both alike.
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

pub(super) fn motion() -> impl Strategy<Value = Command<'static>> {
    prop_oneof![
        (any::<bool>(), any_axes(), of(above_zero())).prop_map(|(rapid, axes, feed)| Command::Linear {
            rapid,
            axes,
            feed
        }),
        (any::<bool>(), any_axes(), any_form(), of(above_zero()))
            .prop_map(|(clockwise, axes, form, feed)| Command::Arc { clockwise, axes, form, feed }),
        (0u64..9_000_000_000).prop_map(|milliseconds| Command::Dwell { milliseconds }),
        (any_flags(), any::<bool>())
            .prop_map(|(axes, unless_homed)| Command::Home { axes: AxisFlags { e: false, ..axes }, unless_homed }),
        any_axes()
            .prop_filter("without words all axes are set", |words| *words != AxisWords::default())
            .prop_map(Command::SetPosition),
        (0u32..100, any::<bool>()).prop_map(|(tool, stays)| Command::SelectTool { tool: Some(tool), stays }),
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

pub(super) fn settings() -> impl Strategy<Value = Command<'static>> {
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
        ([of(any_number()), of(any_number()), of(any_number())], of(any_number()), of(any_number())).prop_map(
            |(play, correction, smoothing)| Command::Backlash(BacklashWords { play, correction, smoothing }),
        ),
        (of(any_tool()), of(percent())).prop_map(|(tool, percent)| Command::FlowPercent(tool, percent)),
        (of(not_negative()), of(any::<bool>())).prop_map(|(minimum, allow)| Command::ColdExtrusion { minimum, allow }),
    ]
    .prop_map(reported)
}

/// A setting without words is a report.
fn reported(command: Command<'static>) -> Command<'static> {
    let (none, no_words) = (AxisWords::default(), RetractionWords::default());
    Command::ReportSetting(match command {
        Command::MaxAcceleration(words) if words == none => "M201",
        Command::MaxFeed(words) if words == none => "M203",
        Command::Acceleration { print: None, retract: None, travel: None, both: None } => "M204",
        Command::Junction { deviation: None, corner_velocity } if corner_velocity == none => "M205",
        Command::RetractSettings(words) if words == no_words => "M207",
        Command::RecoverSettings(words) if words == no_words => "M208",
        command => return command,
    })
}

fn any_park() -> impl Strategy<Value = AxisWords> {
    (of(not_negative()), of(not_negative()), of(not_negative())).prop_map(|(x, y, z)| AxisWords { x, y, z, e: None })
}

pub(super) fn machine() -> impl Strategy<Value = Command<'static>> {
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
        of(0u64..1_000_000_000).prop_map(|longest_ms| Command::Stop { longest_ms, text: "" }),
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
        any_driver_setting(),
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
