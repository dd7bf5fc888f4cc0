//! The page's buttons: moves, heat, fan, height and filament by hand.

use ferrostep_testkit::served::printer::Printer;
use serde_json::Value;

fn said(state: &Value, text: &str) -> bool {
    state["console"].as_array().unwrap().iter().any(|line| line["text"].as_str().unwrap().contains(text))
}

/// A position of the page's state, mm.
fn position(state: &Value, axis: usize) -> f64 {
    state["position_mm"][axis].as_f64().unwrap_or(f64::NAN)
}

#[test]
fn the_buttons_move_heat_and_feed_filament() {
    let mut printer = Printer::at_page(&["--speed", "max"]);
    let page = printer.page();
    let press = |control: &str| page.ask("POST", "/control", control.as_bytes());
    let done = (200, "ok\n".to_owned());
    assert_eq!(press(r#"{"do":"home"}"#), done);
    page.look_until(|state| state["activity"] == "idle" && position(state, 2).abs() < 0.01);
    for (axis, place) in [("x", 0), ("y", 1), ("z", 2)] {
        assert_eq!(press(&format!(r#"{{"do":"jog","axis":"{axis}","mm":10}}"#)), done);
        page.look_until(|state| (position(state, place) - 10.0).abs() < 0.01 && state["activity"] == "idle");
    }
    assert_eq!(press(r#"{"do":"jog","axis":"x","mm":-0.1}"#), done);
    page.look_until(|state| (position(state, 0) - 9.9).abs() < 0.01 && state["activity"] == "idle");

    let (status, refusal) = press(r#"{"do":"filament","mm":5}"#);
    assert!(status == 409 && refusal.contains("heat it first"), "{refusal}");
    assert_eq!(press(r#"{"do":"heat","nozzle_celsius":215,"bed_celsius":60}"#), done);
    page.look_until(|state| state["heat"]["nozzle_celsius"].as_f64() > Some(200.0));
    assert_eq!(press(r#"{"do":"filament","mm":5}"#), done);
    assert_eq!(press(r#"{"do":"fan","percent":50}"#), done);
    assert_eq!(press(r#"{"do":"offset","mm":0.05}"#), done);
    assert_eq!(page.ask("POST", "/line", b"M118 all done"), done);
    page.look_until(|state| said(state, "all done") && state["activity"] == "idle");
    // Absolute again: the next line of a person means what it says.
    assert_eq!(page.ask("POST", "/line", b"G1 X20 F6000"), done);
    let state = page.look_until(|state| (position(state, 0) - 20.0).abs() < 0.01);
    assert!(!said(&state, "Error:"), "{state:#}");

    for control in ["", "G28", r#"{"do":"jog","axis":"x","mm":1000}"#, r#"{"do":"jog","axis":"x","mm":"1\nM112"}"#] {
        assert_eq!(press(control).0, 400, "{control}");
    }
    page.wish("/stop", b"");
    page.look_until(|state| state["activity"] == "halted");
    assert!(press(r#"{"do":"home"}"#).1.contains("M999"));
}

#[test]
fn in_a_print_only_fan_and_height_act() {
    let mut printer = Printer::at_page(&["--speed", "max"]);
    let page = printer.page();
    let press = |control: &str| page.ask("POST", "/control", control.as_bytes());
    let job = ["G28\n".to_owned(), "G1 X10 F6000\nG1 X90\n".repeat(100_000)].concat();
    page.wish("/job", job.as_bytes());
    page.wish("/start", b"");
    page.look_until(|state| state["job"]["line"].as_u64() > Some(20));
    for control in [
        r#"{"do":"home"}"#,
        r#"{"do":"jog","axis":"z","mm":10}"#,
        r#"{"do":"heat","nozzle_celsius":215,"bed_celsius":60}"#,
        r#"{"do":"filament","mm":5}"#,
    ] {
        let (status, refusal) = press(control);
        assert!(status == 409 && refusal.contains("a file is being printed"), "{control}: {refusal}");
    }
    let before = page.state()["position_mm"][2].as_f64().unwrap();
    for control in [r#"{"do":"fan","percent":100}"#, r#"{"do":"offset","mm":0.05}"#] {
        assert_eq!(press(control), (200, "ok\n".to_owned()), "{control}");
    }
    let state = page.look_until(|state| said(state, "M290 Z0.05") && said(state, "M106 S255"));
    assert_eq!(state["activity"], "printing");
    assert!((position(&state, 2) - before).abs() < 0.1, "{state:#}");
    page.wish("/pause", b"");
    page.look_until(|state| state["activity"] == "paused");
    assert_eq!(press(r#"{"do":"fan","percent":0}"#).0, 409);
    page.wish("/cancel", b"");
    page.look_until(|state| state["activity"] == "idle");
}
