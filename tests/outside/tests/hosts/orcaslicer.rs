//! The plug-in of OrcaSlicer, on a stand-in made from the pages of its interface.

use ferrostep_testkit::program::{program, repository, scratch};
use ferrostep_testkit::python;

/// An exported file has its page in the tab; of one that stops, the page up to there; an export
/// continues without the command, and without a job.
#[test]
fn an_exported_file_is_shown_in_a_tab() {
    let folder = scratch();
    let [cube, cold, rubbish] = ["cube.gcode", "cold.gcode", "rubbish.gcode"].map(|name| folder.path().join(name));
    std::fs::copy(repository().join("examples/cube.gcode"), &cube).unwrap();
    std::fs::write(&cold, "G28\nG1 X10 F6000\nG1 X20 E5\n").unwrap();
    std::fs::write(&rubbish, b"\x89PNG\r\n\x1a\n").unwrap();
    let [command, cube, cold, rubbish] = [program(), &cube, &cold, &rubbish].map(|path| path.to_str().unwrap());
    let seen = python::run("orcaslicer_plugin.py", &[command, cube, cold, rubbish]);
    assert_eq!(seen["early"][0], "success");
    for (file, (outcome, has_page, words)) in [
        ("success", true, " finding"),
        ("success", true, "cold extrusion prevented"),
        ("skipped", false, "rubbish.gcode"),
        ("skipped", false, "no-such-command"),
    ]
    .into_iter()
    .enumerate()
    {
        let seen = &seen["files"][file];
        assert_eq!((seen["result"][0].as_str(), &seen["is_clean"]), (Some(outcome), &true.into()), "{file}");
        let said = seen["result"][1].as_str().unwrap();
        assert!(said.contains(words), "{file}: {said}");
        let page = seen["told"]["page"].as_str().unwrap();
        assert_eq!(page.starts_with("<!doctype html><!-- ferrostep show -->"), has_page, "{file}");
        assert!(seen["again"].is_null(), "{file}");
    }
}
