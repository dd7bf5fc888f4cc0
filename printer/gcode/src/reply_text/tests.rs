use super::*;
use crate::{ChamberTemperature, EndStopState, NozzleTemperature};

#[track_caller]
fn says(reply: Reply<'_>, text: &str) {
    assert_eq!(reply.to_string(), text);
}

#[test]
fn temperatures() {
    let temperatures = Temperatures {
        nozzle: 21.3,
        nozzle_target: 0.0,
        bed: 22.0,
        bed_target: 60.0,
        nozzle_power: 0,
        bed_power: 127,
        chamber: None,
        nozzles: None,
    };
    says(Reply::OkTemperatures(temperatures), "ok T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127");
    says(Reply::Temperatures(temperatures), " T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127");
    says(Reply::Waiting(temperatures, None), " T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127 W:?");
    says(Reply::Waiting(temperatures, Some(9)), " T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127 W:9");
    let mut chamber = ChamberTemperature { celsius: 45.0, target: 50.0, power: Some(99) };
    let with = |chamber| Reply::Temperatures(Temperatures { chamber: Some(chamber), ..temperatures });
    says(with(chamber), " T:21.30 /0.00 B:22.00 /60.00 C:45.00 /50.00 @:0 B@:127 C@:99");
    chamber.power = None;
    says(with(chamber), " T:21.30 /0.00 B:22.00 /60.00 C:45.00 /50.00 @:0 B@:127");
    // Marlin's order, with two hot ends.
    let nozzle = |celsius, power| NozzleTemperature { celsius, target: 200.0, power };
    let two =
        Temperatures { chamber: Some(chamber), nozzles: Some([nozzle(21.3, 0), nozzle(190.0, 64)]), ..temperatures };
    says(
        Reply::Temperatures(two),
        " T:21.30 /0.00 B:22.00 /60.00 C:45.00 /50.00 T0:21.30 /200.00 T1:190.00 /200.00 @:0 B@:127 @0:0 @1:64",
    );
    let odd = Temperatures {
        nozzle: f32::NAN,
        nozzle_target: f32::INFINITY,
        bed: -0.004,
        bed_target: -15.125,
        ..temperatures
    };
    says(Reply::Temperatures(odd), " T:NaN /inf B:0.00 /-15.13 @:0 B@:127");
    says(Reply::ColdExtrusion { allowed: false, minimum: 169.6 }, "echo:Cold extrudes are disabled (min temp 170C)");
    says(Reply::ColdExtrusion { allowed: true, minimum: -0.2 }, "echo:Cold extrudes are enabled (min temp 0C)");
}

#[test]
fn positions() {
    let position = Position {
        logical_10nm: [8_715_300, -499, -500, i64::MIN],
        motor_steps: [6972, -40, 0],
        motor_names: ['X', 'Y', 'Z'],
    };
    says(Reply::Position(position), "X:87.15 Y:0.00 Z:-0.01 E:-92233720368547.76 Count X:6972 Y:-40 Z:0");
    says(
        Reply::Position(Position { motor_names: ['A', 'B', 'Z'], ..Position::default() }),
        "X:0.00 Y:0.00 Z:0.00 E:0.00 Count A:0 B:0 Z:0",
    );
    says(
        Reply::SoftLimits {
            enabled: true,
            min_10nm: [-20_000, -300_000, 0],
            max_10nm: [20_000_000, 20_000_000, 18_500_500],
        },
        "echo:; Soft endstops:\necho:  M211 S1 ; ON\n\
         echo:  Min:  X-0.20 Y-3.00 Z0.00   Max:  X200.00 Y200.00 Z185.01",
    );
}

#[test]
fn motion() {
    let figures = MotionFigures {
        order_digest: 0xcbf2_9ce4_8422_2325,
        step_digest: 0x2a,
        underruns: 1,
        starvation_flushes: 2,
        idle_flushes: 7,
        issued_steps: [3, 4, 5, 6],
        slowed_moves: 8,
        merged_moves: 9,
        planning_slowdowns: 10,
        missed_updates: 11,
        refused_entries: 12,
        miscounts: 13,
    };
    says(
        Reply::Motion(figures),
        "echo:motion order_digest:cbf29ce484222325 step_digest:000000000000002a underruns:1 \
         starvation_flushes:2 steps X:3 Y:4 Z:5 E:6 idle_flushes:7 slowed_moves:8 merged_moves:9 \
         planning_slowdowns:10 missed_updates:11 refused_entries:12 miscounts:13",
    );
}

#[test]
fn timing() {
    let figures = TimingFigures {
        name: "step_latency",
        count: 12,
        p50: 31,
        p99: 47,
        p99_9: u32::MAX,
        max: u32::MAX,
        unit: "ticks",
    };
    says(
        Reply::Timing(figures),
        "echo:timing step_latency count:12 p50:31 p99:47 p99.9:4294967295 max:4294967295 unit:ticks",
    );
}

#[test]
fn resends() {
    let resend = |reason| Reply::Resend { reason, last: 11 };
    says(
        resend(ResendReason::WrongNumber),
        "Error:Line Number is not Last Line Number+1, Last Line: 11\nResend: 12\nok",
    );
    says(resend(ResendReason::WrongChecksum), "Error:checksum mismatch, Last Line: 11\nResend: 12\nok");
    says(
        Reply::Resend { reason: ResendReason::NoChecksum, last: -1 },
        "Error:No Checksum with line number, Last Line: -1\nResend: 0\nok",
    );
}

#[test]
fn other_replies() {
    says(Reply::Start, "start");
    says(Reply::Ok, "ok");
    says(Reply::UnknownCommand("M862 P"), "echo:Unknown command: \"M862 P\"");
    says(Reply::Busy, "echo:busy: processing");
    says(Reply::Progress { percent: Some(12), minutes_left: Some(34) }, "echo:M73 Progress: 12%; Time left: 34m");
    says(Reply::Progress { percent: None, minutes_left: None }, "echo:M73 Progress: ?");
    says(Reply::PausedForUser, "echo:busy: paused for user");
    says(Reply::KeepAlive(2), "echo:M113 S2");
    says(Reply::HeaterTimeout(1800), "echo:M86 S1800");
    says(Reply::LastLine(-1), "Line: -1");
    says(Reply::FeedPercent(100), "FR:100%");
    says(Reply::FlowPercent(95), "echo:E0 Flow: 95%");
    says(Reply::ActiveExtruder(0), "echo:Active Extruder: 0");
    says(Reply::Text("//action:notification hello"), "//action:notification hello");
    says(Reply::Killed, "Error:Printer halted. kill() called!");
    let states = [EndStopState { name: "x_min", triggered: true }, EndStopState { name: "z_probe", triggered: false }];
    says(Reply::EndStops(&states), "Reporting endstop status\nx_min: TRIGGERED\nz_probe: open");
}

#[test]
fn firmware() {
    let info = FirmwareInfo {
        version: "0.1.0 (commit abcdef0)",
        source_code_url: "",
        identifier: None,
        machine: "corexy",
        kinematics: "COREXY",
        extruders: 1,
        lower_end_10nm: [0, -300_000, 0],
        size_10nm: [30_000_000, 30_000_000, 29_999_900],
        emergency_parser: true,
        meatpack: false,
        thermal_protection: true,
        z_probe: false,
        card: false,
        stores_settings: false,
        filament_sensor: false,
        power_supply: false,
        chamber: false,
    };
    let warm = Reply::Firmware(FirmwareInfo { chamber: true, ..info }).to_string();
    assert_eq!(warm, Reply::Firmware(info).to_string().replace("CHAMBER_TEMPERATURE:0", "CHAMBER_TEMPERATURE:1"));
    let switched = Reply::Firmware(FirmwareInfo { power_supply: true, ..info }).to_string();
    assert_eq!(switched, Reply::Firmware(info).to_string().replace("SOFTWARE_POWER:0", "SOFTWARE_POWER:1"));
    let sensed = Reply::Firmware(FirmwareInfo { filament_sensor: true, ..info }).to_string();
    assert_eq!(sensed, Reply::Firmware(info).to_string().replace("RUNOUT:0", "RUNOUT:1"));
    let probed = Reply::Firmware(FirmwareInfo { z_probe: true, ..info }).to_string();
    assert_eq!(probed, Reply::Firmware(info).to_string().replace("Z_PROBE:0", "Z_PROBE:1"));
    let identifier = Some([0x0123_4567, 0x89ab_cdef, 0xfedc_ba98]);
    let source_code_url = "https://example.org/sources";
    let named = Reply::Firmware(FirmwareInfo { source_code_url, identifier, ..info }).to_string();
    assert_eq!(
        named.lines().next(),
        Some(
            "FIRMWARE_NAME:Ferrostep 0.1.0 (commit abcdef0) SOURCE_CODE_URL:https://example.org/sources \
             PROTOCOL_VERSION:1.0 MACHINE_TYPE:corexy KINEMATICS:COREXY EXTRUDER_COUNT:1 \
             UUID:46737001-0123-4567-89ab-cdeffedcba98"
        )
    );
    let with_card = Reply::Firmware(FirmwareInfo { card: true, ..info }).to_string();
    for name in ["SDCARD", "SD_WRITE", "AUTOREPORT_SD_STATUS", "LONG_FILENAME", "EXTENDED_M20"] {
        assert!(with_card.contains(&format!("\nCap:{name}:1\n")), "{with_card}");
    }
    assert!(with_card.contains("\nCap:LFN_WRITE:0\n"));
    let cold = Reply::Firmware(FirmwareInfo { thermal_protection: false, ..info }).to_string();
    assert_eq!(cold, Reply::Firmware(info).to_string().replace("THERMAL_PROTECTION:1", "THERMAL_PROTECTION:0"));
    let stores = Reply::Firmware(FirmwareInfo { stores_settings: true, ..info }).to_string();
    assert_eq!(stores, Reply::Firmware(info).to_string().replace("EEPROM:0", "EEPROM:1"));
    let packed = Reply::Firmware(FirmwareInfo { meatpack: true, ..info }).to_string();
    assert_eq!(packed, Reply::Firmware(info).to_string().replace("MEATPACK:0", "MEATPACK:1"));
    let text = Reply::Firmware(info).to_string();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "FIRMWARE_NAME:Ferrostep 0.1.0 (commit abcdef0) PROTOCOL_VERSION:1.0 MACHINE_TYPE:corexy KINEMATICS:COREXY \
         EXTRUDER_COUNT:1"
    );
    assert_eq!(lines.len(), 1 + 37 + 1);
    let capabilities = &lines[1..38];
    assert!(capabilities.iter().all(|line| line.starts_with("Cap:")));
    let on: Vec<_> = capabilities.iter().filter(|line| line.ends_with(":1")).copied().collect();
    let expected = [
        "PAREN_COMMENTS",
        "AUTOREPORT_TEMP",
        "EMERGENCY_PARSER",
        "HOST_ACTION_COMMANDS",
        "PROMPT_SUPPORT",
        "THERMAL_PROTECTION",
        "ARCS",
        "BABYSTEPPING",
    ];
    assert_eq!(on, expected.map(|name| format!("Cap:{name}:1")));
    assert_eq!(
        lines[38],
        "area:{full:{min:{x:0.00,y:-3.00,z:0.00},max:{x:300.00,y:300.00,z:300.00}},\
         work:{min:{x:0.00,y:-3.00,z:0.00},max:{x:300.00,y:300.00,z:300.00}}}"
    );
    // Hosts switch on quirks of other firmware at these names.
    let lower = text.to_lowercase();
    let names = ["repetier", "klipper", "prusa-firmware", "malyan", "reprapfirmware", "teacup", "ultimaker2"];
    assert!(names.iter().all(|name| !lower.contains(name)));
}
