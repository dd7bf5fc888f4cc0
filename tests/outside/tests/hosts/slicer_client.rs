//! A client that was written for OctoPrint, at the page's server.

use ferrostep_testkit::python;
use ferrostep_testkit::served::CUBE;
use ferrostep_testkit::served::printer::Printer;

#[test]
fn a_client_of_octoprint_sends_a_file() {
    let key = "correct-horse-9";
    let mut printer = Printer::at_page(&["--speed", "max", "--key", key]);
    let page = printer.page();
    let seen = python::run("slicer_client.py", &[&page.address, key, CUBE]);
    assert!(seen["version"]["text"].as_str().unwrap().starts_with("OctoPrint"), "{seen:#}");
    assert_eq!(seen["settings"]["feature"]["sdSupport"], false, "{seen:#}");
    assert_eq!(seen["uploaded"]["files"]["local"]["name"], "cube.gcode", "{seen:#}");
    assert_eq!(seen["printer"]["state"]["flags"]["operational"], true, "{seen:#}");
    assert_eq!(seen["job"]["job"]["file"]["name"], "cube.gcode", "{seen:#}");
    assert!(seen["refused"].as_str().unwrap().contains("the key is wrong"), "{seen:#}");
    assert_eq!(page.state()["job"]["name"], "cube.gcode");
}
