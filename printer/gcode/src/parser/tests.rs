#![allow(clippy::unwrap_used)]

mod heaters;

use super::*;
use crate::{
    ArcForm, AxisFlags, AxisWords, Decimal, DriverSetting, DriverWords, FeedWords, GainWords, PinCommand,
    PrintClockCommand, Remarks, RetractionWords, SupplyCommand, TunedHeater, Units, WaitTarget,
};

pub(super) fn number(text: &str) -> Decimal {
    Decimal::parse(text.as_bytes()).unwrap()
}

pub(super) fn some(text: &str) -> Option<Decimal> {
    Some(number(text))
}

/// Error of the parser for a line it refuses.
pub(super) fn refused(text: &str) -> String {
    match parse(text) {
        Ok(command) => panic!("{text:?} is {command:?}"),
        Err(error) => error.to_string(),
    }
}

#[track_caller]
pub(super) fn reads(text: &str, expected: Command<'_>) {
    reads_with(text, expected, "");
}

/// Checks that a line is read with a remark.
#[track_caller]
pub(super) fn reads_with(text: &str, expected: Command<'_>, says: &str) {
    let mut remarks = Remarks::default();
    assert_eq!(parse_with_remarks(text, &mut remarks), Ok(expected), "{text:?}");
    assert_eq!(remarks.to_string(), says, "{text:?}");
}

#[test]
fn moves_as_slicers_write_them() {
    let axes = AxisWords { x: some("87.153"), y: some("86.702"), e: some("0.03647"), z: None };
    reads("G1 X87.153 Y86.702 E.03647", Command::Linear { rapid: false, axes, feed: None });
    for text in ["g01x87.153y86.702e.03647", "G 1 E.03647(e) Y 86.702 (y) X87.153*12", "G1 X1 X87.153Y86.702E.03647;"] {
        reads(text, Command::Linear { rapid: false, axes, feed: None });
    }
    let retract = AxisWords { e: some("-0.8"), ..AxisWords::default() };
    // Non-breaking space, as copied from a web page.
    reads("M104 S0 \u{a0} ", Command::SetNozzle(None, some("0")));
    reads("G1 E-.8 F2100", Command::Linear { rapid: false, axes: retract, feed: some("2100") });
    let lift = AxisWords { z: some("0.2"), ..AxisWords::default() };
    reads("G00 F4500 Z.2", Command::Linear { rapid: true, axes: lift, feed: some("4500") });
    // A second letter ends a number: no exponents here.
    let both = AxisWords { x: some("10"), e: some("5"), ..AxisWords::default() };
    reads("G1 X10E5", Command::Linear { rapid: false, axes: both, feed: None });
    reads("G1", Command::Linear { rapid: false, axes: AxisWords::default(), feed: None });
    // Words of no concern need no number.
    let says = "H has no effect; S has no effect";
    reads_with("G1 X10 E5 H S0", Command::Linear { rapid: false, axes: both, feed: None }, says);
}

#[test]
fn arcs() {
    let axes = AxisWords { x: some("99.983"), y: some("108.356"), e: some("0.06334"), z: None };
    let form = ArcForm::Centre { i: number("1.847"), j: number("-7.907") };
    reads("G2 X99.983 Y108.356 I1.847 J-7.907 E.06334", Command::Arc { clockwise: true, axes, form, feed: None });
    let form = ArcForm::Centre { i: Decimal::ZERO, j: number("5") };
    let none = AxisWords::default();
    reads("G03 J5 F300 P0", Command::Arc { clockwise: false, axes: none, form, feed: some("300") });
    let form = ArcForm::Radius(number("-3"));
    reads("G3 R-3 I1", Command::Arc { clockwise: false, axes: none, form, feed: None });
    assert_eq!(refused("G2 X5"), "G2: expected I and J, or R");
    // Once around, whatever the words about turns say.
    let axes = AxisWords { z: some("0.6"), ..none };
    let form = ArcForm::Centre { i: number("1.217"), j: Decimal::ZERO };
    reads("G3 Z0.6 I1.217 J0 P1 F42000", Command::Arc { clockwise: false, axes, form, feed: some("42000") });
    let form = ArcForm::Radius(number("5"));
    reads("G2 Z.6 R5 P1.0 K0", Command::Arc { clockwise: true, axes, form, feed: None });
    for text in ["G2 I5 P3", "G3 Z1 I5 P2", "G3 I5 P0.5", "G3 I5 P-1"] {
        assert!(refused(text).starts_with("G2 and G3 with P other than 0 and 1: not supported"), "{text}");
    }
    assert!(refused("G3 X5 J1 K1").starts_with("G2 and G3 with K: not supported, the arc would be missing"));
}

/// Bambu's firmware knows more numbers than it has tools.
#[test]
fn numbers_above_any_tools_are_unknown() {
    for text in ["T100", "T254", "T255", "T1000", "T1001 S1", "T1100", "T65535", "T4294967295", "T99999999999", "T-1"] {
        reads(text, Command::Unknown(text));
    }
    reads("T99", Command::SelectTool { tool: Some(99), stays: false });
    reads("T1 S1", Command::SelectTool { tool: Some(1), stays: true });
    reads_with("T0 P1", Command::SelectTool { tool: Some(0), stays: false }, "P has no effect");
}

/// M30 alone ends a program of other machines.
#[test]
fn a_program_may_end() {
    let says = "without a file's name: ends a program, which needs no command here; what follows is executed";
    for text in ["M30", "M30  ", "m30 (end)", "M30*"] {
        let text = text.trim_end_matches('*');
        reads_with(text, Command::Finish, says);
    }
}

/// Prusa's words with a text in quotes.
#[test]
fn quoted_words_are_words() {
    let change = Command::ChangeFilament { tool: None, park: AxisWords::default(), unload: some("400"), load: None };
    reads_with("M600 C\"PLA\" S\"G28 M104\" U400", change, "C has no effect; S has no effect");
    assert!(refused("M600 C\"PLA").contains("unexpected character '\"'"));
    for text in ["G1 X\"5\"", "G92 E\"0\"", "M206 Z\"1\""] {
        assert!(refused(text).contains("unexpected character '\"'"), "{text}");
    }
}

#[test]
fn other_g_codes() {
    reads("G4 P500", Command::Dwell { milliseconds: 500 });
    reads("G4 P500 S1.5", Command::Dwell { milliseconds: 1500 });
    reads("G4 S0", Command::Dwell { milliseconds: 0 });
    reads("G10", Command::Retract);
    reads_with("G10 S1", Command::Retract, "S has no effect");
    reads("G11", Command::Recover);
    reads("G10 P0 X0 Y0", Command::Unknown("G10 P0 X0 Y0"));
    reads("G10 P0 R150", Command::Unknown("G10 P0 R150"));
    reads("G20", Command::SetUnits(Units::Inches));
    reads("G21 ", Command::SetUnits(Units::Millimetres));
    let home = |axes, unless_homed| Command::Home { axes, unless_homed };
    reads("G28", home(AxisFlags::default(), false));
    reads("G28 W", home(AxisFlags::default(), false));
    reads("G28 O", home(AxisFlags::default(), true));
    reads("G28 O0", home(AxisFlags::default(), false));
    reads("G28 X0 Y", home(AxisFlags { x: true, y: true, ..AxisFlags::default() }, false));
    reads("G28 O X", home(AxisFlags { x: true, ..AxisFlags::default() }, true));
    reads_with("G28 Z U", home(AxisFlags { z: true, ..AxisFlags::default() }, false), "U has no effect");
    reads_with("G28 U", Command::Accepted, "U has no effect");
    reads_with("G28 E", Command::Accepted, "E has no effect");
    reads_with("G28 R5 L", home(AxisFlags::default(), false), "L has no effect; R has no effect");
    reads("G90", Command::AbsolutePositioning);
    reads("G91", Command::RelativePositioning);
    let e = AxisWords { e: Some(Decimal::ZERO), ..AxisWords::default() };
    reads("G92 E0", Command::SetPosition(e));
    let zero = Some(Decimal::ZERO);
    reads("G92", Command::SetPosition(AxisWords { x: zero, y: zero, z: zero, e: zero }));
    // Does not set all of them to zero, as it would without words.
    reads_with("G92 E", Command::SetPosition(e), "E without a number is read as 0");
    reads_with("G92 A0", Command::SetPosition(AxisWords::default()), "A has no effect");
    for text in ["G28.1", "G99999999999999999999"] {
        reads(text, Command::Unknown(text));
    }
}

#[test]
fn motors_and_limits() {
    reads("M17", Command::EnableMotors(AxisFlags::default()));
    let xe = AxisFlags { x: true, e: true, ..AxisFlags::default() };
    reads("M84 X E", Command::DisableMotors(xe));
    reads("M18 E0 X0", Command::DisableMotors(xe));
    reads("M84 S60", Command::IdleTimeout { seconds: 60 });
    reads("M84 S0", Command::IdleTimeout { seconds: 0 });
    let limits = AxisWords { x: some("1000"), y: some("1000"), z: some("200"), e: some("5000") };
    reads("M201 X1000 Y1000 Z200 E5000 ; sets", Command::MaxAcceleration(limits));
    let limits = AxisWords { z: some("0.5"), ..AxisWords::default() };
    reads("M203 Z.5", Command::MaxFeed(limits));
    reads(
        "M204 P1000 R1250 T900",
        Command::Acceleration { print: some("1000"), retract: some("1250"), travel: some("900"), both: None },
    );
    reads("M204 S500", Command::Acceleration { print: None, retract: None, travel: None, both: some("500") });
    let corner_velocity = AxisWords { x: some("8.00"), y: some("8.00"), z: some("0.40"), e: some("4.50") };
    let corners = Command::Junction { deviation: None, corner_velocity };
    reads_with("M205 X8.00 Y8.00 Z0.40 E4.50 S5 T0", corners, "S has no effect");
    let none = AxisWords::default();
    reads("M205 J0.013", Command::Junction { deviation: some("0.013"), corner_velocity: none });
    reads_with("M201 X0", Command::MaxAcceleration(none), "X is not above 0 and is ignored");
    reads_with("M203 E-5", Command::MaxFeed(none), "E is not above 0 and is ignored");
    let z = AxisWords { z: some("5"), ..none };
    reads_with("M203 Y Z5", Command::MaxFeed(z), "Y without a number is ignored");
    let travel = Command::Acceleration { print: some("500"), retract: None, travel: None, both: None };
    reads_with("M204 P500 T0", travel, "T is not above 0 and is ignored");
    let corners = Command::Junction { deviation: None, corner_velocity: none };
    reads_with("M205 J0 X0", corners, "J is not above 0 and is ignored; X is not above 0 and is ignored");
    assert_eq!(refused("M84 S-1"), "S: -1 is out of range, expected 0 or more");
    let words = RetractionWords { length: some("2"), feed: some("1800"), lift: some("0.4") };
    reads("M207 S2 F1800 Z.4", Command::RetractSettings(words));
    let words = RetractionWords { length: some("-0.1"), feed: None, lift: None };
    reads_with("M208 S-.1 R5", Command::RecoverSettings(words), "R has no effect");
    // RepRapFirmware's limits of an axis.
    reads_with("M208 X0 S1", Command::Accepted, "S has no effect; X has no effect");
    assert_eq!(refused("M207 S-1"), "S: -1 is out of range, expected 0 or more");
    let none = RetractionWords::default();
    reads_with("M208 F0", Command::RecoverSettings(none), "F is not above 0 and is ignored");
    let z = |text: &str| AxisWords { z: some(text), ..AxisWords::default() };
    reads("M290 Z-0.05", Command::ShiftZ { words: z("-0.05"), keeps_offset: false });
    reads("M290 S.1 P0", Command::ShiftZ { words: z(".1"), keeps_offset: true });
    let query = Command::ShiftZ { words: AxisWords::default(), keeps_offset: false };
    reads_with("M290 R", query, "R has no effect");
    reads("M851", Command::ProbeOffset(AxisWords::default()));
    reads_with("M851 Z-1.1 E5", Command::ProbeOffset(z("-1.1")), "E has no effect");
    reads("M211 S0", Command::SoftLimits(Some(false)));
    reads("M211", Command::SoftLimits(None));
    let feed = |percent| Command::FeedPercent(FeedWords { percent, ..FeedWords::default() });
    reads("M220 S80", feed(some("80")));
    reads("M220 S999", feed(some("999")));
    reads("M220", feed(None));
    reads("M220 B S50", Command::FeedPercent(FeedWords { percent: some("50"), keeps: true, restores: false }));
    reads("M220 R", Command::FeedPercent(FeedWords { percent: None, keeps: false, restores: true }));
    reads("M221 S95 T0", Command::FlowPercent(Some(0), some("95")));
    reads_with("M220 S0", feed(None), "S is not above 0 and is ignored");
    assert_eq!(refused("M220 S1000"), "S: 1000 is out of range, expected 0 to 999");
    assert_eq!(refused("M221 S0"), "S: 0 is out of range, expected more than 0");
    assert_eq!(refused("M221 S999.5"), "S: 999.5 is out of range, expected 0 to 999");
}

fn adaptive(on: Option<bool>, [layer_height, line_width, filament_diameter]: [Option<Decimal>; 3]) -> Command<'static> {
    Command::AdaptiveExtrusion { on, layer_height, line_width, filament_diameter }
}

#[test]
fn host_commands() {
    for (text, command) in [
        ("M105", Command::ReportTemperatures),
        ("M105 T0", Command::ReportTemperatures),
        ("M108", Command::EndWait),
        ("M110 N5", Command::SetLineNumber(Some(5))),
        ("M110 N-1*12", Command::SetLineNumber(Some(-1))),
        ("M110", Command::SetLineNumber(None)),
        ("M112", Command::EmergencyStop),
        ("M113 S2", Command::KeepAlive(Some(2))),
        ("M113", Command::KeepAlive(None)),
        ("M86 S1800", Command::HeaterTimeout(Some(1800))),
        ("M86 S0", Command::HeaterTimeout(Some(0))),
        ("M86", Command::HeaterTimeout(None)),
        ("M87", Command::HeaterTimeout(Some(0))),
        ("M42 P2 S255", Command::SetOutput { number: Some(2), power: 255 }),
        ("M42 S2.6 P0", Command::SetOutput { number: Some(0), power: 3 }),
        ("M150 R255 U128 B0", Command::SetLight { colors: [255, 128, 0, 0] }),
        ("M150 R255 U127.6 W9 P128", Command::SetLight { colors: [128, 64, 0, 4] }),
        ("M150", Command::SetLight { colors: [0; 4] }),
        ("M42 S5", Command::SetOutput { number: None, power: 5 }),
        ("M42 P300 S5", Command::SetOutput { number: None, power: 5 }),
        ("M42 P-1 S5", Command::SetOutput { number: None, power: 5 }),
        ("M401", Command::ProbePin(PinCommand::Out)),
        ("M402", Command::ProbePin(PinCommand::In)),
        // Marlin's angles of a BLTouch, and widths.
        ("M280 P0 S10", Command::ProbePin(PinCommand::Pulses { width_us: 647 })),
        ("M280 S60", Command::ProbePin(PinCommand::Pulses { width_us: 1_162 })),
        ("M280 P0 S90", Command::ProbePin(PinCommand::Pulses { width_us: 1_472 })),
        ("M280 P0 S120", Command::ProbePin(PinCommand::Pulses { width_us: 1_781 })),
        ("M280 P0 S160", Command::ProbePin(PinCommand::Pulses { width_us: 2_193 })),
        ("M280 P0 S1475", Command::ProbePin(PinCommand::Pulses { width_us: 1_475 })),
        ("M80", Command::Supply(SupplyCommand::On)),
        ("M80 S", Command::Supply(SupplyCommand::Report)),
        ("M81", Command::Supply(SupplyCommand::Off { when_cool: false })),
        ("M81 S0", Command::Supply(SupplyCommand::Off { when_cool: false })),
        ("M81 S", Command::Supply(SupplyCommand::Off { when_cool: true })),
        ("M81 S30", Command::Supply(SupplyCommand::Off { when_cool: true })),
        ("M75 Benchy 2", Command::PrintClock(PrintClockCommand::Start)),
        ("M76", Command::PrintClock(PrintClockCommand::Pause)),
        ("M77", Command::PrintClock(PrintClockCommand::Stop)),
        ("M78", Command::PrintClock(PrintClockCommand::Report)),
        ("M78 S78", Command::PrintClock(PrintClockCommand::Clear)),
        ("M78 S7", Command::PrintClock(PrintClockCommand::Report)),
        ("M206 X1.5 Z-0.1", Command::HomeOffset(AxisWords { x: some("1.5"), z: some("-0.1"), ..AxisWords::default() })),
        ("M115", Command::ReportFirmware),
        ("M119", Command::ReportEndStops),
        ("M790 S10241", Command::ReceiveJob { size: 10_241, silence_s: 30 }),
        ("M790 S1 T5", Command::ReceiveJob { size: 1, silence_s: 5 }),
        ("M795", adaptive(None, [None, None, None])),
        ("M795 S1 H0.2 W.45 D1.75", adaptive(Some(true), [some("0.2"), some("0.45"), some("1.75")])),
        ("M796", Command::MotionChoice { interpolation: None, acceleration: None }),
        ("M796 A3 I4", Command::MotionChoice { interpolation: Some(4), acceleration: Some(3) }),
        ("M797", Command::ReportMotion),
        ("M791", Command::BlackBox { clear: false }),
        ("M791 R", Command::BlackBox { clear: true }),
        ("M798", Command::Timing { on: None, clear: false }),
        ("M798 S1", Command::Timing { on: Some(true), clear: false }),
        ("M798 R S0", Command::Timing { on: Some(false), clear: true }),
        ("M155 S2", Command::AutoReportTemperatures { seconds: 2 }),
        ("M400", Command::Finish),
        ("M400 S2", Command::Dwell { milliseconds: 2000 }),
        ("M400 P100", Command::Dwell { milliseconds: 100 }),
        ("M400 U1", Command::Pause(AxisWords::default())),
        ("M400 U0", Command::Finish),
        ("M410", Command::QuickStop),
        ("M999 S1", Command::Restart),
        ("M82 ", Command::AbsoluteExtrusion),
        ("M83(e)", Command::RelativeExtrusion),
        ("T0", Command::SelectTool { tool: Some(0), stays: false }),
        ("t 3", Command::SelectTool { tool: Some(3), stays: false }),
        ("T1 S1", Command::SelectTool { tool: Some(1), stays: true }),
        ("T1 S", Command::SelectTool { tool: Some(1), stays: true }),
        ("T1 S0 ; back", Command::SelectTool { tool: Some(1), stays: false }),
        ("T", Command::SelectTool { tool: None, stays: false }),
        ("T ; which?", Command::SelectTool { tool: None, stays: false }),
        ("M218", Command::ToolOffset { tool: None, offset: AxisWords::default() }),
        (
            "M218 T1 X20 Z-.5",
            Command::ToolOffset {
                tool: Some(1),
                offset: AxisWords { x: some("20"), z: some("-.5"), ..AxisWords::default() },
            },
        ),
    ] {
        reads(text, command);
    }
    reads_with("M115 U3.1.0", Command::ReportFirmware, "U: the firmware's version is not checked");
    reads_with("M114 D", Command::ReportPosition, "D has no effect");
    reads_with("M155", Command::Accepted, "without S: no effect");
    assert_eq!(refused("M790"), "M790: expected S");
    assert_eq!(refused("M790 S1 T3601"), "T: 3601 is out of range, expected 0 to 3600");
    assert!(refused("M795 H0").starts_with("H: "));
    assert!(refused("M795 S2").starts_with("S: "));
    assert_eq!(refused("M796 I5"), "I: 5 is out of range, expected 0 to 4");
    let choice = Command::MotionChoice { interpolation: None, acceleration: Some(0) };
    reads_with("M796 A0.5", choice, "A must be whole, the fraction is dropped");
    assert_eq!(refused("M798 S2"), "S: 2 is out of range, expected 0 to 1");
    assert_eq!(refused("M155 S61"), "S: 61 is out of range, expected 0 to 60");
    reads_with("M110 N-1.5", Command::SetLineNumber(Some(-1)), "N must be whole, the fraction is dropped");
}

#[test]
fn text_commands_keep_their_text() {
    reads("M117 20*3 (two) % Gr\u{fc}n", Command::Display("20*3 (two) % Gr\u{fc}n"));
    reads("M117", Command::Display(""));
    reads("m117Hello", Command::Display("Hello"));
    let plain = |text| Command::Echo { echo_prefix: false, action_prefix: false, text };
    reads("M118 hello G28", plain("hello G28"));
    reads(
        "M118 E1 A1 P0  action:notification",
        Command::Echo { echo_prefix: true, action_prefix: true, text: "action:notification" },
    );
    reads("M118 A1", Command::Echo { echo_prefix: false, action_prefix: true, text: "" });
    reads("M118 E0 P2 E1a E1", plain("E1a E1"));
    reads("M118 P P1", plain("P P1"));
}

#[test]
fn accepted_and_unknown() {
    for text in ["", " ", "(nothing)", "*5", "; c"] {
        reads(text, Command::Accepted);
    }
    for text in
        ["M35", "M36 %", "M104.1 S5", "D576", "Tx", "T?", "T-1", "T0.5", "N5", "M1121", "M99999999999", "Z \u{1f600}"]
    {
        reads(text, Command::Unknown(text));
    }
}

#[test]
fn pauses() {
    for (text, longest_ms, says) in [
        ("M0", None, ""),
        ("M1 Press when ready", None, "Press when ready"),
        ("M0 Stop here", None, "Stop here"),
        ("M0 S2", Some(2000), ""),
        ("M1 P500", Some(500), ""),
        ("M1 S1 Insert the magnets", Some(1000), "Insert the magnets"),
        ("M1 P3 M4 screws, 5 G", Some(3), "M4 screws, 5 G"),
        ("M0 S3D prints", None, "S3D prints"),
        ("M0 P 10 Push", Some(10), "Push"),
    ] {
        reads(text, Command::Stop { longest_ms, text: says });
    }
    reads_with("M0 P500 S3", Command::Stop { longest_ms: Some(3000), text: "" }, "P has no effect");
    let change = |park, unload, load| Command::ChangeFilament { tool: None, park, unload, load };
    reads_with("M600 E2", change(AxisWords::default(), None, None), "E has no effect");
    reads("M600 U-400 L420.5", change(AxisWords::default(), some("-400"), some("420.5")));
    assert_eq!(refused("M0 S-1"), "S: -1 is out of range, expected 0 or more");
    for text in ["M125", "M226", "M601"] {
        reads(text, Command::Pause(AxisWords::default()));
    }
    let park = AxisWords { x: some("10"), z: some("5"), ..AxisWords::default() };
    reads("M600 X10 Z5", change(park, None, None));
    reads_with("M601 U5", Command::Pause(AxisWords::default()), "U has no effect");
    assert_eq!(refused("M601 Z-5"), "Z: -5 is out of range, expected 0 or more");
    assert_eq!(parse("M226 P2 S1"), Ok(Command::Unknown("M226 P2 S1")));
    reads("M603", Command::FilamentLengths { unload: None, load: None });
    reads("M603 U400 L50.5", Command::FilamentLengths { unload: some("400"), load: some("50.5") });
    let filament = |loads, length, rise| Command::LoadFilament { loads, tool: None, length, rise };
    reads("M701", filament(true, None, None));
    reads("M702 U-300 Z5", filament(false, some("-300"), some("5")));
    reads_with("M702 C", Command::Accepted, "C has no effect");
    reads_with("M701 U5 L6", filament(true, some("6"), None), "U has no effect");
    reads("M602", Command::ResumePrint);
    reads("M876 S0", Command::PromptAnswer(0));
    reads("M876 P1", Command::Accepted);
    assert_eq!(refused("M876 S256"), "S: 256 is out of range, expected 0 to 255");
    assert_eq!(refused("M876"), "M876: expected S");
    reads("M73 P12 R34", Command::Progress { percent: Some(12), minutes_left: Some(34) });
    reads("M73 Q12 S34", Command::Progress { percent: None, minutes_left: None });
    reads("M73", Command::Progress { percent: None, minutes_left: None });
    let full = Command::Progress { percent: Some(100), minutes_left: Some(7) };
    reads_with("M73 P101 R6.6", full, "P is too large and becomes the largest value");
    reads("M85 S600", Command::HeaterTimeout(Some(600)));
    reads("M85 S0", Command::HeaterTimeout(None));
}

#[test]
fn motor_drivers() {
    reads("M122", Command::ReportDrivers);
    let x = AxisFlags { x: true, ..AxisFlags::default() };
    reads("M569 S1 X", Command::StealthChop { motors: x, tool: None, on: Some(true) });
    reads("M569 X S0", Command::StealthChop { motors: x, tool: None, on: Some(false) });
    reads("M569", Command::StealthChop { motors: AxisFlags::default(), tool: None, on: None });
    reads("M569 X", Command::StealthChop { motors: x, tool: None, on: None });
    reads("M906", Command::Driver(DriverSetting::Current, DriverWords::default()));
    let currents = DriverWords { x: Some(800), e: Some(3000), ..DriverWords::default() };
    reads("M906 X800 E3000", Command::Driver(DriverSetting::Current, currents));
    let thresholds = DriverWords { y: Some(255), z: Some(0), ..DriverWords::default() };
    reads("M914 Y255 Z0", Command::Driver(DriverSetting::StallThreshold, thresholds));
    let speeds = DriverWords { x: Some(120), e: Some(0), tool: Some(0), ..DriverWords::default() };
    reads("M913 T0 X120 E0", Command::Driver(DriverSetting::SpreadCycleAbove, speeds));
    let of_second = DriverWords { e: Some(700), tool: Some(1), ..DriverWords::default() };
    reads("M906 T1 E700", Command::Driver(DriverSetting::Current, of_second));
    let e = AxisFlags { e: true, ..AxisFlags::default() };
    reads("M569 S0 T1 E", Command::StealthChop { motors: e, tool: Some(1), on: Some(false) });
    assert_eq!(thresholds.all(), [None, Some(255), Some(0), None]);
    assert_eq!(refused("M569 S1"), "M569: expected X, Y, Z or E");
    assert_eq!(refused("M569 S2 X"), "S: 2 is out of range, expected 0 to 1");
    assert_eq!(refused("M906 X3001"), "X: 3001 is out of range, expected 0 to 3000");
    assert_eq!(refused("M906 E-1"), "E: -1 is out of range, expected 0 to 3000");
    let z = DriverWords { z: Some(500), ..DriverWords::default() };
    reads_with("M906 Z500.5", Command::Driver(DriverSetting::Current, z), "Z must be whole, the fraction is dropped");
    assert_eq!(refused("M913 X2001"), "X: 2001 is out of range, expected 0 to 2000");
    assert_eq!(refused("M914 Y256"), "Y: 256 is out of range, expected 0 to 255");
    reads_with(
        "M914 X",
        Command::Driver(DriverSetting::StallThreshold, DriverWords::default()),
        "X without a number is ignored",
    );
}

#[test]
fn malformed_lines_name_the_field() {
    for (text, error) in [
        ("G1 X1.2.3 Y5", "X: \"1.2.3\" is not a number, expected one like 12.5 or -.8"),
        ("G1 Xnan Y5", "X: \"nan\" is not a number, expected one like 12.5 or -.8"),
        ("G1 X5 EINF", "E: \"INF\" is not a number, expected one like 12.5 or -.8"),
        ("G1 X5 Y-inf", "Y: \"-\" is not a number, expected one like 12.5 or -.8"),
        ("G1 X-", "X: \"-\" is not a number, expected one like 12.5 or -.8"),
        ("G1 X1-2", "X: \"1-2\" is not a number, expected one like 12.5 or -.8"),
        ("G1 H.", "H: \".\" is not a number, expected one like 12.5 or -.8"),
        ("G1 X99999999999", "X: 99999999999 is too large, expected at most 9 digits before the point"),
        (
            "G1 X1111111111111111111111111111111",
            "X: 111111111111111111111111... is too large, expected at most 9 digits before the point",
        ),
        ("G1 X5 %", "unexpected character '%', expected a letter and its number"),
        ("G1 X5 \u{2212}3", "unexpected character '\u{2212}', expected a letter and its number"),
        ("G1 X\u{e9}", "unexpected character '\u{e9}', expected a letter and its number"),
        ("G", "G without a number, expected a command such as G1"),
        ("M-5", "M without a number, expected a command such as M1"),
        ("GX5", "G without a number, expected a command such as G1"),
        ("GX5Y5", "G without a number, expected a command such as G1"),
        ("M XY", "M without a number, expected a command such as M1"),
        ("G4 P-5", "P: -5 is out of range, expected 0 or more"),
    ] {
        assert_eq!(refused(text), error, "{text:?}");
    }
}

#[test]
fn files_on_a_card() {
    use crate::CardCommand as Card;
    let reads = |text: &'static str, command: Card<'static>| reads(text, Command::Card(command));
    reads("M20", Card::List { long: false, time: false });
    reads("M20 L T", Card::List { long: true, time: true });
    reads("M21", Card::Mount);
    reads("M22", Card::Release);
    reads("M23 /PARTS/ONE.GCO", Card::Select("/PARTS/ONE.GCO"));
    reads("m23 A long name (2).gcode ", Card::Select("A long name (2).gcode"));
    reads("M24", Card::Start { position: None });
    reads("M24 S100", Card::Start { position: Some(100) });
    reads_with("M24 S5 T20", Command::Card(Card::Start { position: Some(5) }), "T has no effect");
    reads("M25", Card::Pause);
    reads("M26 S0", Card::SetPosition(0));
    reads("M27", Card::ReportProgress);
    reads("M27 C", Card::ReportFile);
    reads("M27 S2", Card::AutoReport { seconds: 2 });
    reads("M28 NEW.GCO", Card::Write("NEW.GCO"));
    reads("M29", Card::EndWrite);
    reads("M30 NEW.GCO", Card::Delete("NEW.GCO"));
    reads("M31", Card::ReportTime);
    reads("M32 !PARTS/ONE.GCO#", Card::SelectAndStart { path: "PARTS/ONE.GCO", position: None });
    for (text, path) in [
        ("M32 part #2 (final).gcode", "part #2 (final).gcode"),
        ("M32 !/part #2 (final).gcode#", "/part #2 (final).gcode"),
        ("M32 !/part #2 (final).gcode", "/part #2 (final).gcode"),
        ("M32 !a.g# ", "a.g"),
        ("M32 !a.g# b", "a.g"),
        ("M32 PART#2~1.GCO", "PART#2~1.GCO"),
        ("M32 wow! #1.gcode", "wow! #1.gcode"),
        ("M32 #1", "#1"),
    ] {
        reads(text, Card::SelectAndStart { path, position: None });
    }
    reads("M32 S500 !ONE.GCO#", Card::SelectAndStart { path: "ONE.GCO", position: Some(500) });
    reads("M33 PARTS/ONE.GCO", Card::ReportLongPath("PARTS/ONE.GCO"));
    reads("M34 S1", Card::Sort);
    reads("M524", Card::Abort);
    reads("M413", Card::KeepPlace(None));
    reads("M413 S0", Card::KeepPlace(Some(false)));
    reads("M413 S1", Card::KeepPlace(Some(true)));
    reads("M1000", Card::Interrupted(crate::InterruptedPrint::Resume));
    reads("M1000 S", Card::Interrupted(crate::InterruptedPrint::Report));
    reads("M1000 C", Card::Interrupted(crate::InterruptedPrint::Discard));
    reads_with("M413 S1 B50", Command::Card(Card::KeepPlace(Some(true))), "B has no effect");
    reads("M928 LOG.TXT", Card::Log("LOG.TXT"));
    for text in ["M23", "M26", "M28 ", "M32 !#", "M32 P !ONE.GCO#", "M27 S61", "M928"] {
        assert!(parse(text).is_err(), "{text}");
    }
}
