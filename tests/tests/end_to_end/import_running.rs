//! `ferrostep import` from running printers: imitations of Moonraker and of Marlin answer.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;

use ferrostep_import::of_text;
use serde_json::{Map, Value, json};

use crate::end_to_end::command::{Outcome, directory, ferrostep};
use crate::end_to_end::imports::{profile, says};

/// Serves one connection, and returns the address.
fn serve(answer: impl FnOnce(TcpStream) + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    thread::spawn(move || {
        if let Ok((stream, _)) = listener.accept() {
            answer(stream);
        }
    });
    address
}

/// A server of HTTP with one answer to the request that Moonraker takes.
fn moonraker(answer: Vec<u8>) -> String {
    let address = serve(move |mut stream| {
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            if stream.read(&mut byte).unwrap_or(0) == 0 {
                return;
            }
            head.push(byte[0]);
        }
        let head = String::from_utf8(head).unwrap();
        assert!(head.starts_with("GET /printer/objects/query?configfile HTTP/1.1\r\nHost: 127.0.0.1:"), "{head}");
        let _ = stream.write_all(&answer);
    });
    format!("http://{address}")
}

fn http(status: &str, body: &str) -> Vec<u8> {
    format!("HTTP/1.1 {status}\r\nServer: TornadoServer/6.4\r\nContent-Length: {}\r\n\r\n{body}", body.len())
        .into_bytes()
}

/// The same answer in parts of some bytes.
fn chunked(body: &str) -> Vec<u8> {
    let mut answer = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n".to_vec();
    for part in body.as_bytes().chunks(1000) {
        answer.extend(format!("{:x}\r\n", part.len()).into_bytes());
        answer.extend([part, b"\r\n"].concat());
    }
    answer.extend(b"0\r\n\r\n");
    answer
}

/// Klipper's object of a configuration: its settings as the file has them, and as
/// Klipper takes them.
fn configfile(text: &str) -> String {
    let mut sections: Vec<(String, Vec<(String, String)>)> = Vec::new();
    for line in text.lines().map(|line| line.split('#').next().unwrap().trim_end()).filter(|line| !line.is_empty()) {
        if line.starts_with('[') {
            sections.push((line.trim_matches(['[', ']']).to_owned(), Vec::new()));
            continue;
        }
        let settings = &mut sections.last_mut().unwrap().1;
        match line.split_once([':', '=']).filter(|_| !line.starts_with(' ')) {
            Some((key, value)) => settings.push((key.trim().to_owned(), value.trim().to_owned())),
            None => {
                let value = &mut settings.last_mut().unwrap().1;
                *value += "\n";
                *value += line.trim();
            }
        }
    }
    // The text is made by hand, so that keys keep the file's order.
    let object = |entries: Vec<String>| format!("{{{}}}", entries.join(", "));
    let of_section = |(name, settings): &(String, Vec<(String, String)>)| {
        let settings = settings.iter().map(|(key, value)| format!("{}: {}", json!(key), json!(value))).collect();
        format!("{}: {}", json!(name), object(settings))
    };
    let config = object(sections.iter().map(of_section).collect());
    let taken = json!({"stepper_x": {"microsteps": 99, "rotation_distance": 1.0}});
    format!(
        r#"{{"result": {{"eventtime": 578243.57, "status": {{"configfile": {{"config": {config}, "settings": {taken},
            "warnings": [], "save_config_pending": false, "save_config_pending_items": {{}}}}}}}}}}"#
    )
}

fn import(arguments: &[&str]) -> Outcome {
    ferrostep([&["import"], arguments].concat())
}

#[test]
fn a_running_klipper_makes_the_profile_of_its_file() {
    for name in ["bed-slinger.cfg", "corexy.cfg"] {
        let path = ferrostep_testkit::program::repository().join("tests/configurations").join(name);
        let text = std::fs::read_to_string(path).unwrap();
        // Klipper has read included files; here none was found.
        let text: String =
            text.lines().filter(|line| !line.starts_with("[include")).map(|line| format!("{line}\n")).collect();
        let saved = text.find("#*#").map_or(text.as_str(), |at| &text[..at]);
        let of_file = of_text("printer.cfg", saved, &mut |_| Err("none".to_owned())).unwrap();
        for answer in [http("200 OK", &configfile(saved)), chunked(&configfile(saved))] {
            let url = moonraker(answer);
            let outcome = import(&["--moonraker", &url, "--json"]);
            assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
            let imported = outcome.json();
            assert_eq!(profile(&imported), of_file.profile.parse().unwrap(), "{name}");
            assert_eq!(imported["rows"].as_array().unwrap().len(), of_file.rows.len());
        }
    }
}

#[test]
fn rows_of_a_running_klipper_name_section_and_key() {
    let text = std::fs::read_to_string(
        ferrostep_testkit::program::repository().join("tests/cases/import/k23-control-plain/printer.cfg"),
    )
    .unwrap();
    let url = moonraker(http("200 OK", &configfile(&text)));
    let folder = directory();
    let out = folder.path().join("out.toml");
    let outcome = import(&["--moonraker", &url, "-o", out.to_str().unwrap()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(outcome.stdout.contains(&format!("  {url}: [printer] kinematics = ")), "{outcome:#?}");
    assert!(outcome.stdout.contains(&format!("out.toml was made of {url}; try it")), "{outcome:#?}");
    assert!(ferrostep_profiles::parse(&std::fs::read_to_string(out).unwrap(), "out").is_ok());
}

#[test]
fn a_key_goes_with_the_request() {
    let (sender, receiver) = std::sync::mpsc::channel();
    let address = serve(move |stream| {
        let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
        let head: Vec<String> = lines.by_ref().take_while(|line| !line.is_empty()).collect();
        sender.send(head).unwrap();
    });
    let url = format!("http://{address}");
    assert_eq!(import(&["--moonraker", &url, "--api-key", "0a1B"]).status, Some(2));
    let head = receiver.recv().unwrap();
    assert!(head.contains(&"X-Api-Key: 0a1B".to_owned()), "{head:?}");
    for key in ["", "two words", "a\r\nHost: b"] {
        let outcome = import(&["--moonraker", &url, "--api-key", key]);
        assert!(outcome.status == Some(2) && outcome.stderr.contains("expected letters and digits"), "{outcome:#?}");
    }
    assert_eq!(import(&["printer.cfg", "--api-key", "0a1B"]).status, Some(2));
}

#[test]
fn a_klipper_that_says_no_configuration_is_refused_with_the_cure() {
    let delta = configfile("[printer]\nkinematics: delta\n");
    for (answer, expected) in [
        (http("404 Not Found", "<html>nginx</html>"), "no Moonraker answers there (status 404)"),
        (
            http("401 Unauthorized", r#"{"error": {"code": 401, "message": "Unauthorized"}}"#),
            "(status 401: Unauthorized): add this computer to trusted_clients",
        ),
        (
            http("503 Service Unavailable", r#"{"error": {"code": 503, "message": "Klippy Host not connected"}}"#),
            "Klipper is not running (status 503: Klippy Host not connected): start it",
        ),
        (http("200 OK", "<!doctype html>"), "the answer is no JSON"),
        (http("200 OK", &configfile("")), "Klipper has no configuration: it is not ready"),
        (http("200 OK", &configfile("[mcu]\nserial: x\n")), "Klipper has no section [printer]"),
        (http("200 OK", &delta), ": kinematics: delta: profiles know cartesian"),
        (http("200 OK", &configfile("[printer]\nkinematics: corexy\n")), "no profile can be made of it"),
        (b"ok\n".to_vec(), "the connection ends before the answer does"),
        (http("200 OK", &configfile("[printer]\n"))[..90].to_vec(), "the connection ends before the answer does"),
        (b"220 mail server ready\r\n".to_vec(), "the answer is not HTTP"),
    ] {
        let url = moonraker(answer);
        let folder = directory();
        let out = folder.path().join("out.toml");
        let outcome = import(&["--moonraker", &url, "-o", out.to_str().unwrap()]);
        assert_eq!((outcome.status, out.exists()), (Some(2), false), "{outcome:#?}");
        assert!(outcome.stderr.contains(expected) && outcome.stderr.contains(&url), "{expected}: {outcome:#?}");
    }
    // A port that nothing listens at any more.
    let gone = format!("http://{}", TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap());
    let outcome = import(&["--moonraker", &gone]);
    assert_eq!(outcome.status, Some(2));
    assert!(outcome.stderr.contains("nothing answers at 127.0.0.1:"), "{outcome:#?}");
    for (url, expected) in [
        ("https://printer.local", "https is not supported"),
        ("printer.local", "expected http://HOST"),
        ("http://printer.local/printer", "expected http://HOST"),
    ] {
        let outcome = import(&["--moonraker", url]);
        assert_eq!(outcome.status, Some(2));
        assert!(outcome.stderr.contains(expected), "{outcome:#?}");
    }
    assert_eq!(import(&["printer.cfg", "--moonraker", "http://x"]).status, Some(2));
    assert_eq!(import(&[]).status, Some(2));
}

/// A printer at a TCP port that answers M115 and M503 with these lines, and all else with ok.
fn marlin(about: &'static [&'static str], settings: &'static [&'static str]) -> String {
    let address = serve(move |stream| {
        let mut output = stream.try_clone().unwrap();
        let mut say = |lines: &[&str]| {
            let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
            let _ = output.write_all(text.as_bytes());
        };
        say(&["start", "echo: External Reset", "echo:Marlin 2.1.2"]);
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            let text = line.split_once("M118 ").map(|(_, rest)| rest.split('*').next().unwrap().to_owned());
            match (line.as_str(), text) {
                ("M115", _) => say(about),
                ("M503", _) => say(settings),
                (_, Some(text)) => say(&[&text, "ok"]),
                ("", None) => {}
                _ => say(&["ok"]),
            }
        }
    });
    format!("tcp:{address}")
}

const ABOUT: [&str; 6] = [
    "FIRMWARE_NAME:Marlin 2.1.2.5 (Sep  1 2024 12:00:00) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0 \
     MACHINE_TYPE:Bed slinger EXTRUDER_COUNT:1 UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff",
    "Cap:SERIAL_XON_XOFF:0",
    "Cap:EEPROM:1",
    "Cap:Z_PROBE:1",
    "area:{full:{min:{x:-2.0000,y:0.0000,z:0.0000},max:{x:235.0000,y:230.0000,z:250.0000}},work:{min:{x:0.0000,y:0.0000,\
     z:0.0000},max:{x:220.0000,y:220.0000,z:250.0000}}}",
    "ok",
];

const SETTINGS: [&str; 44] = [
    "echo:busy: processing",
    "echo:; Linear Units:",
    "echo:  G21 ; (mm)",
    "echo:; Temperature Units:",
    "echo:  M149 C ; Units in Celsius",
    "echo:; Filament settings (Disabled):",
    "echo:  M200 S0 D1.75",
    "echo:; Steps per unit:",
    "echo:  M92 X81.00 Y82.00 Z401.50 E97.25",
    "echo:; Max feedrates (units/s):",
    "echo:  M203 X210.00 Y215.00 Z6.00 E55.00",
    " T:24.80 /0.00 B:24.60 /0.00 @:0 B@:0",
    "echo:; Max Acceleration (units/s2):",
    "echo:  M201 X900.00 Y910.00 Z110.00 E4000.00",
    "echo:; Acceleration (units/s2) (P<print-accel> R<retract-accel> T<travel-accel>):",
    "echo:  M204 P650.00 R1100.00 T800.00",
    "echo:; Advanced (B<min_segment_time_us> S<min_feedrate> T<min_travel_feedrate> J<junc_dev>):",
    "echo:  M205 B20000.00 S0.00 T0.00 J0.03",
    "echo:; Home offset:",
    "echo:  M206 X0.00 Y0.00 Z0.00",
    "echo:; Auto Bed Leveling:",
    "echo:  M420 S0 Z10.00 ; Leveling OFF",
    "echo:; Material heatup parameters:",
    "echo:  M145 S0 H200.00 B60.00 F0",
    "echo:  M145 S1 H240.00 B80.00 F0",
    "echo:; Hotend PID:",
    "echo:  M301 P25.50 I2.55 D102.00",
    "echo:; Bed PID:",
    "echo:  M304 P51.00 I5.10 D204.00",
    "echo:; Z-Probe Offset:",
    "echo:  M851 X-44.00 Y-6.00 Z-2.15 ; (mm)",
    "echo:; Input Shaping:",
    "echo:  M593 X F41.00 D0.12",
    "echo:  M593 Y F36.00 D0.10",
    "echo:; Stepper driver current:",
    "echo:  M906 X600 Y610 Z620",
    "echo:  M906 T0 E630",
    "echo:; Retract (S<length> F<feedrate> Z<lift>):",
    "echo:  M207 S2.50 W13.00 F2400.00 Z0.00",
    "echo:; Linear Advance:",
    "echo:  M900 K0.0700",
    "echo:; Filament load/unload:",
    "echo:  M603 L0.00 U100.00 ; (mm)",
    "ok",
];

/// The profile's values that a report says.
const NUMBERS: &str = r#"
    name = "Bed slinger"
    [steps_per_mm]
    x = 81.0
    y = 82.0
    z = 401.5
    e = 97.25
    [max_feed_mm_per_s]
    x = 210.0
    z = 6.0
    e = 55.0
    [max_acceleration_mm_per_s2]
    y = 910.0
    e = 4000.0
    [acceleration_mm_per_s2]
    print = 650.0
    retract = 1100.0
    travel = 800.0
    [size_mm]
    x = 235.0
    y = 230.0
    z = 250.0
    [lower_end_mm]
    x = -2.0
    [nozzle]
    proportional = 0.1
    integral = 0.01
    derivative = 0.4
    [bed]
    proportional = 0.2
    derivative = 0.8
    [input_shaper.x]
    kind = "zv"
    frequency_hz = 41.0
    damping = 0.12
    [input_shaper.y]
    frequency_hz = 36.0
    [pressure_advance]
    seconds = 0.07
    [firmware_retraction]
    length_mm = 2.5
    retract_mm_per_s = 40.0
"#;

#[test]
fn a_running_marlin_says_its_numbers_and_not_what_it_is() {
    let port = marlin(&ABOUT, &SETTINGS);
    let outcome = import(&["--marlin", &port]);
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    for part in [
        "kinematics: a running Marlin does not tell it; COREXY or COREXZ in its Configuration.h says it",
        "homing.x.end: a running Marlin does not tell it; X_HOME_DIR",
        "homing.y.triggers_low: ",
        "homing.z.sensor: it has a probe (Cap:Z_PROBE:1)",
        "driver.inverted: ",
        "nozzle.sensor: a running Marlin does not tell it; TEMP_SENSOR_0",
        "bed.sensor: ",
        "--assume",
    ] {
        assert!(outcome.stderr.contains(part), "{part}: {outcome:#?}");
    }
    assert!(!outcome.stderr.contains("size_mm") && !outcome.stderr.contains("steps_per_mm"), "{outcome:#?}");
    let port = marlin(&ABOUT, &SETTINGS);
    let outcome = import(&["--marlin", &port, "--assume", "--json"]);
    assert_eq!(outcome.status, Some(3), "{outcome:#?}");
    let imported = outcome.json();
    says(&imported, NUMBERS);
    says(&imported, "junction_deviation_mm = 0.03");
    let by_permission = imported["by_permission"].as_array().unwrap();
    assert!(by_permission.iter().any(|part| part.as_str().unwrap().starts_with("kinematics: ")), "{by_permission:#?}");
    // Each command of the report has a row.
    let rows = imported["rows"].as_array().unwrap();
    for key in ["M851 (NOZZLE_TO_PROBE_OFFSET)", "M906 (E0_CURRENT)", "M420 (DEFAULT_LEVELING_FADE_HEIGHT)"] {
        let row = rows.iter().find(|row| row["key"] == key).unwrap();
        assert!(row["kept"].is_null() && row["why"].as_str().unwrap().contains("not told"), "{row}");
    }
    for (index, line) in SETTINGS.iter().enumerate() {
        let command = line.strip_prefix("echo:  ").and_then(|line| line.split(' ').next());
        let Some(command) = command else { continue };
        let row = rows.iter().find(|row| row["line"] == index + 1 && row["file"] == "M503");
        let key = row.unwrap_or_else(|| panic!("no row for {line}"))["key"].as_str().unwrap();
        // The lists have one row for the whole of them.
        assert!(key.starts_with(command), "{line}: {key}");
    }
}

#[test]
fn a_running_marlins_numbers_hold_over_its_file() {
    let port = marlin(&ABOUT, &SETTINGS);
    let file = "tests/cases/import/m24-control-plain/Configuration.h";
    let outcome = import(&[file, "--marlin", &port, "--json"]);
    assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
    let imported = outcome.json();
    says(&imported, NUMBERS);
    let of_file = import(&[file, "--json"]).json();
    // The keys that define the machine come from the file.
    for key in ["kinematics", "homing", "driver"] {
        let (both, alone) = (profile(&imported), profile(&of_file));
        let directions = |table: &toml::Table| table.get(key).cloned();
        if key == "homing" {
            assert_eq!(both["homing"]["x"]["end"], alone["homing"]["x"]["end"]);
        } else {
            assert_eq!(directions(&both), directions(&alone), "{key}");
        }
    }
    let rows = imported["rows"].as_array().unwrap();
    let replaced = rows.iter().find(|row| row["key"] == "DEFAULT_AXIS_STEPS_PER_UNIT").unwrap();
    assert_eq!(replaced["why"], "the running printer says otherwise");
    let klipper = import(&["tests/configurations/corexy.cfg", "--marlin", &marlin(&ABOUT, &SETTINGS)]);
    assert_eq!(klipper.status, Some(2));
    assert!(klipper.stderr.contains("its Configuration.h is expected"), "{klipper:#?}");
}

#[test]
fn a_marlin_that_says_no_settings_is_refused_with_the_cure() {
    const OTHER: [&str; 1] = ["ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.12"];
    const INCHES: [&str; 3] = ["echo:  G20 ; (in)", "echo:  M92 X2032.0 Y2032.0 Z10160.0 E2362.2", "ok"];
    const BUSY: [&str; 40] = ["echo:busy: processing"; 40];
    for (about, settings, expected) in [
        (&ABOUT[..], &["echo:Unknown command: \"M503\"", "ok"][..], "built without M503 (DISABLE_M503)"),
        (&ABOUT[..], &["ok"], "no steps per millimetre (M92)"),
        (&OTHER[..], &["ok"], "not Marlin: import it by --moonraker"),
        (&ABOUT[..], &INCHES, "send it G21"),
        (&ABOUT[..], &BUSY, "the printer is busy (processing): ask again"),
        (&ABOUT[..], &["Error:Printer halted. kill() called!"], "the board has halted"),
    ] {
        let port = marlin(about, settings);
        let folder = directory();
        let out = folder.path().join("out.toml");
        let outcome = import(&["--marlin", &port, "--assume", "-o", out.to_str().unwrap()]);
        assert_eq!((outcome.status, out.exists()), (Some(2), false), "{outcome:#?}");
        assert!(outcome.stderr.contains(expected) && outcome.stderr.contains(&port), "{expected}: {outcome:#?}");
    }
    for (port, expected) in [
        ("/dev/no-such-port", "/dev/no-such-port: "),
        ("tcp:host", "expected tcp:HOST:PORT"),
        ("Cargo.toml", "this is an ordinary file, not a serial port"),
    ] {
        let outcome = import(&["--marlin", port]);
        assert_eq!(outcome.status, Some(2));
        assert!(outcome.stderr.contains(expected), "{outcome:#?}");
    }
    let outcome = import(&["--marlin", &format!("tcp:{}", serve(drop))]);
    assert!(outcome.stderr.contains("the connection to the board is lost"), "{outcome:#?}");
    assert_eq!(import(&["x.cfg", "--baud", "9600"]).status, Some(2), "a speed of no port");
}

/// A hostile server's configuration of Klipper.
#[test]
fn a_servers_settings_include_no_files() {
    let config = json!({"printer": {"kinematics": "corexy"}, "include /etc/hostname": {}});
    let status = Map::from_iter([("configfile".to_owned(), json!({"config": config}))]);
    let body = json!({"result": {"status": Value::Object(status)}}).to_string();
    let outcome = import(&["--moonraker", &moonraker(http("200 OK", &body)), "--assume"]);
    assert_eq!(outcome.status, Some(2));
    assert!(outcome.stderr.contains("cannot name a section of Klipper's"), "{outcome:#?}");
}
