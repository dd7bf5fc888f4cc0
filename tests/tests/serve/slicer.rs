//! A slicer that sends a file to the page's server, as it would to OctoPrint.

use ferrostep_testkit::program::{repository, scratch};
use ferrostep_testkit::served::page::{Page, status};
use ferrostep_testkit::served::printer::Printer;
use ferrostep_testkit::served::{CUBE, print_of_cube};
use serde_json::Value;

const KEY: &str = "correct-horse-9";

/// Sends method and path, header lines and body; returns status and body.
fn ask(page: &Page, first: &str, headers: &str, body: &[u8]) -> (u16, String) {
    let head = format!("{first} HTTP/1.1\r\nHost: {}\r\nContent-Length: {}\r\n{headers}\r\n", page.address, body.len());
    let answer = page.raw(&[head.as_bytes(), body].concat());
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{first}: {answer:?}"));
    (status(head).unwrap(), body.to_owned())
}

/// Reads an answer that is data.
fn read(page: &Page, path: &str) -> Value {
    let (status, body) = ask(page, &format!("GET /api/{path}"), &format!("X-Api-Key: {KEY}\r\n"), b"");
    assert_eq!(status, 200, "{path}: {body}");
    serde_json::from_str(&body).unwrap()
}

/// Sends a file with this name; `print`: the form's field.
fn send(page: &Page, headers: &str, name: &str, print: &str, content: &[u8]) -> (u16, String) {
    let line = "----------------------f1e2d3";
    let word = |name: &str, word: &str| {
        format!("--{line}\r\nContent-Disposition: form-data; name=\"{name}\"\r\n\r\n{word}\r\n")
    };
    let file = format!(
        "--{line}\r\nContent-Disposition: form-data; name=\"file\"; filename=\"{name}\"\r\n\
         Content-Type: application/octet-stream\r\n\r\n"
    );
    let start = word("print", print) + &word("path", "") + &file;
    let body = [start.as_bytes(), content, format!("\r\n--{line}--\r\n").as_bytes()].concat();
    let headers = format!("{headers}Content-Type: multipart/form-data; boundary={line}\r\n");
    ask(page, "POST /api/files/local", &headers, &body)
}

#[test]
fn a_slicer_sends_a_file_and_its_print_makes_the_steps_of_print() {
    let mut printer = Printer::at_page(&["--speed", "max", "--key", KEY]);
    let page = printer.page();
    // PrusaSlicer's and OrcaSlicer's question whether this is OctoPrint.
    let version = read(&page, "version");
    assert!(version["text"].as_str().unwrap().starts_with("OctoPrint") && version["api"].is_string(), "{version}");
    // Cura's: no card to write to.
    assert_eq!(read(&page, "settings")["feature"]["sdSupport"], false);
    assert!(read(&page, "server")["version"].is_string());
    assert_eq!(read(&page, "printer")["state"]["flags"]["ready"], true);
    assert!(read(&page, "job")["job"]["file"]["name"].is_null());

    let cube = std::fs::read(repository().join(CUBE)).unwrap();
    let key = format!("X-Api-Key: {KEY}\r\n");
    let (status, made) = send(&page, &key, "a cube.gcode", "true", &cube);
    assert_eq!(status, 201, "{made}");
    let made: Value = serde_json::from_str(&made).unwrap();
    assert_eq!((&made["effectivePrint"], &made["files"]["local"]["name"]), (&true.into(), &"a cube.gcode".into()));
    let state = page.look_until(|state| state["message"].as_str().is_some_and(|said| said.contains("printed: ")));
    assert_eq!(state["job"]["name"], "a cube.gcode");
    assert_eq!(read(&page, "job")["state"], "Operational");
    let (done, expected) = (printer.end(), print_of_cube());
    for key in ["step_digest", "order_digest", "motor_steps", "moves", "position_mm"] {
        assert_eq!(done[key], expected[key], "{key}");
    }
}

/// Each is refused in words, and the job stays the file that came before.
#[test]
fn a_file_that_is_refused_changes_nothing() {
    let mut printer = Printer::at_page(&["--speed", "max", "--key", KEY, "--web-upload", "1"]);
    let page = printer.page();
    let key = format!("Authorization: Bearer {KEY}\r\n");
    assert_eq!(send(&page, &key, "first.gcode", "false", b"G28\nG1 X10 F600\n").0, 201);
    let other_site = format!("{key}Origin: http://evil.example\r\n");
    let large = vec![b'\n'; 2 << 20];
    for (headers, name, content, status, words) in [
        ("", "a.gcode", &b"G28\n"[..], 403, "the key is missing"),
        ("X-Api-Key: wrong-horse-9\r\n", "a.gcode", b"G28\n", 403, "the key is wrong"),
        (&other_site, "a.gcode", b"G28\n", 403, "another site"),
        (&key, "../../a.gcode", b"G28\n", 400, "send the name alone"),
        (&key, "..\\a.gcode", b"G28\n", 400, "send the name alone"),
        (&key, "/etc/cron.d/a", b"G28\n", 400, "send the name alone"),
        (&key, "a.gcode", b"", 400, "the file is empty"),
        (&key, "a.gcode", b"\x89PNG\r\n\x1a\n\0\0\0", 409, "a.gcode: "),
        (&key, "a.gcode", &large, 413, "an upload may have 1048576 bytes"),
    ] {
        let (answered, said) = send(&page, headers, name, "true", content);
        assert!(answered == status && said.contains(words), "{name} {headers:?}: {answered} {said}");
        let state = page.state();
        assert_eq!((&state["job"]["name"], &state["activity"]), (&"first.gcode".into(), &"idle".into()), "{state:#}");
    }
    for path in ["/api/files/local/../../../etc/passwd", "/api/../state", "/api/files", "/api/"] {
        assert_eq!(ask(&page, &format!("GET {path}"), &key, b"").0, 404, "{path}");
    }
    assert_eq!(ask(&page, "GET /api/files/local", &key, b"").0, 405);
    // The key of slicers opens nothing of the page's own.
    assert_eq!(ask(&page, "GET /state", &key, b"").0, 401);
    // A halted printer keeps the file, and says that it does not print it.
    page.wish("/stop", b"");
    page.look_until(|state| state["activity"] == "halted");
    let (status, said) = send(&page, &key, "second.gcode", "true", b"G28\n");
    assert!(status == 409 && said.starts_with("second.gcode is here, and its print was not started: "), "{said}");
    assert_eq!(page.state()["job"]["name"], "second.gcode");
    assert_eq!(printer.end()["moves"], 0);
}

/// This computer's slicers need no key where none is set; one that is sent all the same is not what
/// its sender believes.
#[test]
fn without_a_key_this_computer_sends_without_one() {
    let mut printer = Printer::at_page(&["--speed", "max"]);
    let page = printer.page();
    assert_eq!(send(&page, "", "a.gcode", "false", b"G28\n").0, 201);
    assert_eq!(send(&page, "X-Api-Key: \r\n", "b.gcode", "false", b"G28\n").0, 201);
    let (status, said) = send(&page, &format!("X-Api-Key: {KEY}\r\n"), "c.gcode", "false", b"G28\n");
    assert!(status == 403 && said.starts_with("there is no such key"), "{said}");
    assert_eq!(send(&page, &format!("X-Api-Key: {}\r\n", page.token), "d.gcode", "false", b"G28\n").0, 201);
    assert_eq!(page.state()["job"]["name"], "d.gcode");
}

/// A folder for temporary files that cannot be written models a full disk.
#[test]
fn a_file_that_the_disk_does_not_take_is_an_answer() {
    let folder = scratch();
    let missing = folder.path().join("missing");
    let mut printer = Printer::with_temporary_folder(&missing, &["--speed", "max"]);
    let page = printer.page();
    let (status, said) = send(&page, "", "a.gcode", "false", b"G28\n");
    assert!(status == 507 && said.starts_with("the file cannot be kept: "), "{status} {said}");
    assert!(page.state()["job"].is_null());
}
