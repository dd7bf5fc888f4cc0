//! The page's server in front of a served printer: refused requests, a print, a pause, two hosts.

use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use ferrostep_testkit::program::repository;
use ferrostep_testkit::served::page::{Page, status};
use ferrostep_testkit::served::printer::Printer;
use ferrostep_testkit::served::{part, print_of_cube, print_of_lines};
use serde_json::Value;

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(120);

fn says(state: &Value, text: &str) -> bool {
    state["message"].as_str().is_some_and(|message| message.contains(text))
}

/// Requests of an attacker, and the status that answers each; 0: no answer.
fn attacks(page: &Page) -> Vec<(Vec<u8>, u16)> {
    let Page { address, token, .. } = page;
    let with =
        |first: &str, headers: &str, body: &str| format!("{first} HTTP/1.1\r\n{headers}\r\n\r\n{body}").into_bytes();
    let host = format!("Host: {address}");
    let bearer = format!("{host}\r\nAuthorization: Bearer {token}");
    let stop = "POST /stop";
    let line = "Content-Length: 4\r\n";
    let mut attacks = vec![
        // Without the token, or with another one.
        (with(stop, &host, ""), 401),
        (with(stop, &format!("{host}\r\nAuthorization: Bearer {}", "0".repeat(32)), ""), 401),
        (with(stop, &format!("{host}\r\nAuthorization: Bearer"), ""), 401),
        (with(stop, &format!("{host}\r\nAuthorization: {token}"), ""), 401),
        (with(stop, &format!("{host}\r\nCookie: token={token}"), ""), 401),
        (with(&format!("POST /stop?token={token}"), &host, ""), 401),
        (with("GET /state", &host, ""), 401),
        (with("POST /line", &format!("{line}{host}"), "M112"), 401),
        (with("POST /job", &format!("Content-Length: 999999999999\r\n{host}"), ""), 401),
        // Another name, another site.
        (with(stop, &format!("Host: evil.example\r\nAuthorization: Bearer {token}"), ""), 403),
        (with("GET /", "Host: evil.example", ""), 403),
        (with(stop, &format!("Authorization: Bearer {token}"), ""), 403),
        (with(stop, &format!("{bearer}\r\nOrigin: http://evil.example"), ""), 403),
        (with(stop, &format!("{bearer}\r\nOrigin: null"), ""), 403),
        (with(stop, &format!("{bearer}\r\nSec-Fetch-Site: cross-site"), ""), 403),
        (with("OPTIONS /stop", &format!("{host}\r\nOrigin: http://evil.example"), ""), 403),
        // No path leads to a file.
        (with("GET /../../../../etc/passwd", &bearer, ""), 404),
        (with("GET /%2e%2e/%2e%2e/etc/passwd", &bearer, ""), 404),
        (with("GET //etc/passwd", &bearer, ""), 404),
        (with("GET /state/../etc/passwd", &bearer, ""), 404),
        (with("GET /stop", &bearer, ""), 405),
        (with("DELETE /job", &bearer, ""), 405),
        // Too large, without a length, cut off, two lines in one.
        (with("POST /job", &format!("Content-Length: 99999999999\r\n{bearer}"), "G28\n"), 413),
        (with("POST /line", &format!("Content-Length: 100000\r\n{bearer}"), &"M".repeat(100_000)), 413),
        (with("POST /line", &bearer, "M112"), 411),
        (with("POST /line", &format!("Transfer-Encoding: chunked\r\n{bearer}"), "4\r\nM112\r\n0\r\n\r\n"), 411),
        (with("POST /line", &format!("Content-Length: 40\r\n{bearer}"), "M112"), 400),
        (with("POST /job", &format!("Content-Length: 40\r\n{bearer}"), "G28"), 400),
        (with("POST /line", &format!("Content-Length: 9\r\n{bearer}"), "M105\nM112"), 409),
        (with("POST /line", &format!("{line}Content-Length: 5\r\n{bearer}"), "M112"), 400),
        (with("GET /", &format!("X: {}", "a".repeat(100_000)), ""), 431),
        (b"POST /stop HTTP/1.1\r\nHost".to_vec(), 400),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".to_vec(), 400),
        (vec![0; 3000], 400),
        (b"M112\n".to_vec(), 400),
        (Vec::new(), 0),
    ];
    attacks.push(((0..=255).cycle().skip(65).take(5000).collect(), 400));
    attacks
}

#[test]
fn nothing_of_the_printer_is_reachable_without_the_token() {
    let mut printer = Printer::at_page(&["--speed", "max"]);
    let page = printer.page();
    for (bytes, expected) in attacks(&page) {
        let answer = page.raw(&bytes);
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(120)]).into_owned();
        assert_eq!(status(&answer).unwrap_or(0), expected, "{shown}: {answer}");
        assert!(!answer.contains("root:") && !answer.contains("celsius"), "{shown}: {answer}");
    }
    // The page itself contains no data of the printer, and no page of another site may have it in a
    // frame or read it.
    let (status, text) = page.ask("GET", "/", b"");
    assert!(status == 200 && text.starts_with("<!doctype html>") && !text.contains(&page.token), "{text}");
    let answer = page.raw(format!("GET / HTTP/1.1\r\nHost: {}\r\n\r\n", page.address).as_bytes());
    assert!(answer.contains("frame-ancestors 'none'") && !answer.contains("Access-Control"), "{answer}");
    let state = page.state();
    assert_eq!((&state["activity"], &state["job"]), (&"idle".into(), &Value::Null), "{state:#}");
    assert_eq!(printer.end()["lines"], 0);
}

/// Ten browsers look, one stops reading, others attack: the steps are those of `print`.
#[test]
fn a_print_from_the_page_makes_the_steps_of_print_whoever_asks_meanwhile() {
    let mut printer = Printer::at_page(&["--speed", "max"]);
    let page = printer.page();
    page.wish("/job", &std::fs::read(repository().join("examples/cube.gcode")).unwrap());
    page.look_until(|state| {
        state["job"]["remaining_s"].as_f64().is_some_and(|left_s| (1380.0..1410.0).contains(&left_s))
    });
    // Asks for the page, and reads nothing.
    let mut deaf = TcpStream::connect(&page.address).unwrap();
    write!(deaf, "GET / HTTP/1.1\r\nHost: {}\r\n\r\n", page.address).unwrap();
    let (looks, is_over) = (AtomicUsize::new(0), AtomicBool::new(false));
    thread::scope(|scope| {
        for _ in 0..10 {
            scope.spawn(|| {
                let mut left_s = f64::INFINITY;
                while !is_over.load(Ordering::Relaxed) {
                    let state = page.state();
                    // The remaining time is known from the lines, and only falls.
                    if state["activity"] == "printing" {
                        let now_s = state["job"]["remaining_s"].as_f64().unwrap();
                        assert!(now_s <= left_s, "{now_s} s left after {left_s} s");
                        left_s = now_s;
                    }
                    looks.fetch_add(usize::from(state["activity"] == "printing"), Ordering::Relaxed);
                }
            });
        }
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                for (bytes, _) in attacks(&page) {
                    assert_ne!(status(&page.raw(&bytes)), Some(200));
                }
            }
        });
        page.wish("/start", b"");
        let end = Instant::now() + PATIENCE;
        while !says(&page.state(), "printed: ") && Instant::now() < end {}
        is_over.store(true, Ordering::Relaxed);
    });
    let state = page.state();
    assert!(says(&state, "0 of them again"), "{state:#}");
    assert!(looks.into_inner() >= 10);
    drop(deaf);
    let (done, expected) = (printer.end(), print_of_cube());
    for key in ["step_digest", "order_digest", "motor_steps", "moves", "position_mm", "underruns", "starvation_flushes"]
    {
        assert_eq!(done[key], expected[key], "{key}");
    }
}

/// A machine that knows its chamber's temperature shows it.
#[test]
fn a_chamber_is_shown() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let profile = folder.path().join("chamber.toml");
    let chamber = "\n[chamber]\nthermistor = \"nozzle1\"\nheater = \"nozzle1\"\nsensor = \"epcos-100k\"\n\
                   min_celsius = 0\nmax_celsius = 80\n";
    std::fs::write(&profile, ferrostep_profiles::builtin_text("corexy").unwrap().to_owned() + chamber).unwrap();
    let mut printer = Printer::at_page(&["--speed", "max", "--profile", profile.to_str().unwrap()]);
    let page = printer.page();
    page.look_until(|state| state["heat"]["chamber_target_celsius"] == 0.0);
    page.wish("/line", b"M141 S45");
    let state = page.look_until(|state| state["heat"]["chamber_target_celsius"] == 45.0);
    assert!(state["heat"]["chamber_celsius"].as_f64().unwrap() >= 20.0, "{state:#}");
    let mut plain = Printer::at_page(&["--speed", "max"]);
    let state = plain.page().look_until(|state| state["heat"]["bed_target_celsius"] == 0.0);
    assert!(state["heat"]["chamber_celsius"].is_null(), "{state:#}");
}

/// A job that lasts longer than any test.
fn long_job() -> Vec<u8> {
    ["G28\nM140 S50\n".to_owned(), "G1 X10 F6000\nG1 X90\n".repeat(100_000)].concat().into_bytes()
}

#[test]
fn a_job_pauses_goes_on_and_is_cancelled_with_its_heaters_off() {
    let mut printer = Printer::at_page(&["--speed", "max"]);
    let page = printer.page();
    assert_eq!(page.ask("POST", "/start", b""), (409, "no file: upload one first\n".to_owned()));
    let (status, refusal) = page.ask("POST", "/job", b"\x89PNG\r\n\x1a\n");
    assert!(status == 409 && refusal.starts_with("part.gcode: "), "{refusal}");
    page.wish("/job", &long_job());
    page.wish("/start", b"");
    page.look_until(|state| state["job"]["line"].as_u64() > Some(20) && state["heat"]["bed_target_celsius"] == 50.0);
    for (path, body) in [("/start", ""), ("/job", "G28"), ("/resume", ""), ("/line", "G1 X5"), ("/line", "M410")] {
        assert_eq!(page.ask("POST", path, body.as_bytes()).0, 409, "{path} {body}");
    }
    for _ in 0..2 {
        page.wish("/pause", b"");
        let paused = page.look_until(|state| state["activity"] == "paused");
        assert_eq!(page.ask("POST", "/line", b"M105").0, 409);
        page.wish("/resume", b"");
        page.look_until(|state| {
            state["activity"] == "printing" && state["job"]["line"].as_u64() > paused["job"]["line"].as_u64()
        });
    }
    // A line of a person is executed between two of the file.
    page.wish("/line", b"M118 hello");
    let said = |state: &Value, text: &str| state["console"].as_array().unwrap().iter().any(|line| line["text"] == text);
    page.look_until(|state| said(state, "hello"));
    page.wish("/cancel", b"");
    let state = page.look_until(|state| state["activity"] == "idle");
    assert!(says(&state, "cancelled after line ") && says(&state, "the printer has ended: waits (M108)"), "{state:#}");
    page.look_until(|state| state["heat"]["bed_target_celsius"] == 0.0);
    // A cancel in a pause works as well; and the printer is free for the next print.
    page.wish("/start", b"");
    page.look_until(|state| state["job"]["line"].as_u64() > Some(20));
    page.wish("/pause", b"");
    page.look_until(|state| state["activity"] == "paused");
    page.wish("/cancel", b"");
    let state = page.look_until(|state| state["activity"] == "idle");
    assert!(says(&state, "the printer has ended"), "{state:#}");
    page.wish("/start", b"");
    page.look_until(|state| state["job"]["line"].as_u64() > Some(20));
    page.wish("/stop", b"");
    page.look_until(|state| state["activity"] == "halted");
    assert_eq!(page.ask("POST", "/start", b"").0, 409);
    page.wish("/line", b"M999");
    page.look_until(|state| state["activity"] == "idle");
}

#[test]
fn one_host_owns_the_printer_at_a_time() {
    let mut printer = Printer::at_pty(&["--web", "127.0.0.1:0", "--speed", "max"]);
    let page = printer.page();
    page.wish("/job", &long_job());
    let mut host = printer.connect();
    host.say("G28");
    for (path, body) in [("/start", ""), ("/line", "M105")] {
        let (status, refusal) = page.ask("POST", path, body.as_bytes());
        assert!(status == 409 && refusal.contains("uses this printer until it disconnects"), "{refusal}");
    }
    page.wish("/stop", b"");
    host.hear_until(|line| line == "Error:Printer halted. kill() called!");
    host.say("M999");
    drop(host);
    page.look_until(|state| state["owner"] == Value::Null && state["activity"] == "idle");
    page.wish("/start", b"");
    page.look_until(|state| state["job"]["line"].as_u64() > Some(20));
    let mut host = printer.connect();
    host.send("M105\n");
    host.hear_until(|line| line.starts_with("Error:the web page owns this printer"));
    host.send("M112\n");
    page.look_until(|state| state["activity"] == "halted");
    page.wish("/line", b"M999");
    page.look_until(|state| state["activity"] == "idle" && state["owner"] == Value::Null);
    assert!(!host.say("M105").is_empty());
}

/// A host asks without end and reads no answer: the page shows the printer meanwhile, and its
/// emergency stop acts. The printer prints as ever once the host is gone.
#[test]
fn a_host_that_stops_reading_holds_up_neither_page_nor_printer() {
    let mut printer = Printer::at_pty(&["--web", "127.0.0.1:0", "--speed", "max"]);
    let page = printer.page();
    let mut host = printer.connect();
    host.say("G28");
    // The answers are a hundred times longer than the line's buffer.
    host.send(&"M115\n".repeat(500));
    let looks: Vec<Value> = (0..50).map(|_| page.state()).collect();
    assert!(looks.iter().all(|state| state["owner"] != Value::Null), "{:#}", looks[0]);
    page.wish("/stop", b"");
    page.look_until(|state| state["activity"] == "halted");
    drop(host);
    page.look_until(|state| state["owner"] == Value::Null);
    page.wish("/line", b"M999");
    page.look_until(|state| state["activity"] == "idle");
    page.wish("/job", &part().join("\n").into_bytes());
    page.wish("/start", b"");
    page.look_until(|state| says(state, "printed: "));
}

/// `serve --web --port`, here in front of another virtual printer's port: the same steps,
/// temperatures and position by the line.
#[test]
fn a_printer_at_a_port_prints_from_the_page() {
    let printer = Printer::at_pty(&["--speed", "max"]);
    let mut front = Printer::before_port(printer.port());
    let page = front.page();
    page.look_until(|state| state["activity"] == "idle" && state["heat"]["nozzle_celsius"].as_f64() > Some(10.0));
    let lines = part();
    page.wish("/job", lines.join("\n").as_bytes());
    page.wish("/start", b"");
    page.look_until(|state| says(state, "printed: "));
    page.wish("/line", b"M797");
    let digest = format!("step_digest:{}", print_of_lines(&lines)["step_digest"].as_str().unwrap());
    page.look_until(|state| state["console"].to_string().contains(&digest));
    page.look_until(|state| state["position_mm"][2].as_f64() > Some(0.1));
    page.wish("/job", &long_job());
    page.wish("/start", b"");
    page.look_until(|state| state["job"]["line"].as_u64() > Some(20));
    // Ctrl-C ends the print as it ends that of `send`.
    let said = front.end_front();
    assert!(said.contains("cancelled after line ") && said.contains("the printer has ended: waits (M108)"), "{said}");
    let mut host = printer.connect();
    host.send("M105\n");
    let said = host.hear_until(|line| line.starts_with("ok T:"));
    assert!(said.last().unwrap().contains("/0.00 @"), "{said:?}");
    printer.end();
}
