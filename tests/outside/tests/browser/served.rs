//! Chromium opens the page and uses it as a person would.

use ferrostep_testkit::chromium::chromium;
use ferrostep_testkit::python;
use ferrostep_testkit::served::printer::Printer;
use serde_json::json;

#[test]
fn chromium_prints_pauses_and_cancels() {
    let mut printer = Printer::at_page(&["--speed", "max"]);
    let page = printer.page();
    let seen = python::run("web_page.py", &[chromium().to_str().unwrap(), page.url()]);
    assert_eq!(seen["errors"], json!([]), "{seen:#}");
    assert_eq!(seen["foreign"], json!([]), "the page speaks to its own server only: {seen:#}");
    assert!(seen["m115"].as_str().unwrap().contains("FIRMWARE_NAME:Ferrostep"), "{seen:#}");
    assert_eq!(seen["refused"], "the line is empty", "{seen:#}");
    assert!(seen["cold"].as_str().unwrap().contains("the nozzle is at 22 °C"), "{seen:#}");
    assert!(seen["message"].as_str().unwrap().contains("the printer has ended: waits (M108)"), "{seen:#}");
    assert!(seen["bed"].as_str().unwrap().contains("°C"), "{seen:#}");
    assert!(seen["without_token"].as_str().unwrap().contains("the token is missing or wrong"), "{seen:#}");
    assert_eq!(seen["phone_overflow"], 0, "{seen:#}");
    assert!(printer.end()["moves"].as_u64().unwrap() > 10);
}
