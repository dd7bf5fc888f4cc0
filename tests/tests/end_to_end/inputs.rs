//! The kinds of jobs: text and binary G-code and prepared jobs, plain or gzip, from files and
//! standard input; and the refusal of all other files.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::end_to_end::command::{Outcome, directory, ferrostep, file, gzip, program, repository};

/// Runs the command with these bytes at its standard input.
fn fed(arguments: &[&str], input: &[u8]) -> Outcome {
    let mut command = Command::new(program());
    command.current_dir(repository()).args(arguments);
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut pipe = child.stdin.take().unwrap();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            // Piece by piece, the first ones small; a command that refuses its input
            // leaves the rest.
            let (first, rest) = input.split_at(input.len().min(3));
            let _ = pipe.write_all(first).and_then(|()| pipe.flush()).and_then(|()| pipe.write_all(rest));
        });
        child.wait_with_output().unwrap().into()
    })
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(repository().join("examples").join(name)).unwrap()
}

/// The summary without the run's own time, and without the file's name.
#[track_caller]
fn summary(outcome: &Outcome) -> Value {
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let mut summary = outcome.json();
    for key in ["file", "out", "wall_s", "realtime_factor", "slicer", "lines"] {
        summary.as_object_mut().unwrap().remove(key);
    }
    // Binary G-code has the commands, not all comments: its lines differ, and so does
    // the slicer's time.
    summary.as_object_mut().unwrap().remove("slicer_time_s");
    for layer in summary.get_mut("layer_list").and_then(Value::as_array_mut).into_iter().flatten() {
        layer.as_object_mut().unwrap().remove("line");
    }
    for remark in summary["remarks"].as_array_mut().unwrap() {
        remark.as_object_mut().unwrap().remove("lines");
    }
    summary
}

#[test]
fn binary_gcode_prints_as_its_text() {
    let text = ferrostep(["print", "examples/cube.gcode", "--json"]);
    let binary = ferrostep(["print", "examples/cube.bgcode", "--json"]);
    assert_eq!(summary(&binary), summary(&text));
    assert_eq!(
        binary.json()["slicer"],
        json!({"producer": "PrusaSlicer 2.5.0", "time_s": 1287, "filament_mm": 1236.53})
    );
    assert_eq!(text.json().get("slicer"), None);
    let estimated = ferrostep(["estimate", "examples/cube.bgcode"]);
    assert!(estimated.stdout.contains("  slicer says  21 min 27 s, 1.237 m, PrusaSlicer 2.5.0\n"), "{estimated:#?}");
}

#[test]
fn standard_input_is_a_job_like_any_other() {
    let [text, binary] = ["cube.gcode", "cube.bgcode"].map(bytes);
    let expected = summary(&ferrostep(["estimate", "examples/cube.gcode", "--json"]));
    for input in [&text, &gzip(&text), &binary, &gzip(&binary)] {
        assert_eq!(summary(&fed(&["estimate", "-", "--json"], input)), expected);
    }
    assert_eq!(
        summary(&fed(&["print", "-", "--json"], &binary)),
        summary(&ferrostep(["print", "examples/cube.gcode", "--json"]))
    );
    for input in [&b""[..], &gzip(b"")] {
        let empty = fed(&["print", "-"], input);
        assert_eq!(empty.status, Some(2));
        assert_eq!(empty.stderr, "error: standard input: the file is empty: expected G-code or a prepared job\n");
    }
    let table = fed(&["papers", "--compare", "-", "--json"], b"G28\nG1 X50 F6000\nG1 X60 Y20\n");
    assert_eq!(table.json()["choices"]["rows"].as_array().unwrap().len(), 20, "{table:#?}");
}

#[test]
fn a_job_is_prepared_from_standard_input_and_from_binary_gcode() {
    let directory = directory();
    let [of_text, of_binary] = ["text.gpre", "binary.gpre"].map(|name| directory.path().join(name));
    let prepare = |input: &[u8], out: &Path| {
        let outcome = fed(&["preprocess", "-", "-o", out.to_str().unwrap()], input);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        std::fs::read(out).unwrap()
    };
    let [text, binary] = [bytes("cube.gcode"), bytes("cube.bgcode")];
    let job = prepare(&text, &of_text);
    prepare(&binary, &of_binary);
    let printed = |path: &Path| summary(&ferrostep(["print", path.to_str().unwrap(), "--json"]));
    assert_eq!(printed(&of_text), printed(&of_binary));
    assert_eq!(summary(&fed(&["print", "-", "--json"], &job)), printed(&of_text));
    assert!(fed(&["inspect", "-"], &job).stdout.starts_with("encoding     Compact\n"));
    let again = fed(&["papers", "--compare", "-"], &job);
    assert_eq!(again.status, Some(2));
    assert!(again.stderr.contains("error: standard input: this is a prepared job, with its methods fixed"));
}

/// The picture of binary G-code, which is in a separate block, goes into the prepared job.
#[test]
fn a_prepared_job_keeps_the_picture_of_binary_gcode() {
    let directory = directory();
    let out = directory.path().join("ring.gpre");
    let ring = repository().join("desk/binary-gcode/tests/data/ring-32.bgcode");
    let outcome = ferrostep(["preprocess".as_ref(), ring.as_os_str(), "-o".as_ref(), out.as_os_str()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let inspected = ferrostep(["inspect".as_ref(), out.as_os_str()]);
    assert!(inspected.stdout.contains("thumbnail    Png, 16 x 16, 86 bytes"), "{inspected:#?}");
}

#[test]
fn inspect_shows_what_the_slicer_says_in_binary_gcode() {
    let ring = repository().join("desk/binary-gcode/tests/data/ring-32.bgcode");
    let inspected = ferrostep(["inspect".as_ref(), ring.as_os_str()]);
    assert_eq!((inspected.status, inspected.stderr.as_str()), (Some(0), ""), "{inspected:#?}");
    assert!(
        inspected.stdout.starts_with("encoding     binary G-code, all checksums right\nslicer       "),
        "{inspected:#?}"
    );
    assert!(inspected.stdout.ends_with("thumbnail    Png, 16 x 16, 86 bytes\n"), "{inspected:#?}");
    let of_cube = fed(&["inspect", "-"], &bytes("cube.bgcode")).stdout;
    let printed = fed(&["print", "-", "--json"], &bytes("cube.bgcode")).json()["slicer"].clone();
    assert!(of_cube.contains(printed["producer"].as_str().unwrap()), "{of_cube}");
    let items = ferrostep(["inspect".as_ref(), ring.as_os_str(), "--items".as_ref()]);
    assert_eq!(items.status, Some(2), "{items:#?}");
    assert!(items.stderr.contains("inspect reads prepared jobs"), "{items:#?}");
}

#[test]
fn damaged_binary_gcode_is_refused_before_anything_moves() {
    let directory = directory();
    let mut damaged = bytes("cube.bgcode");
    let place = damaged.len() - 100;
    damaged[place] ^= 4;
    let cases: [(&str, &[u8], &str); 4] = [
        ("damaged", &damaged, ": damaged: its checksum is "),
        ("short", &damaged[..20_000], "the file ends before its end: copy or export it again"),
        ("head", b"GCDE\x01\0\0\0", "the file ends before its end: copy or export it again"),
        ("new", b"GCDE\x02\0\0\0\x01\0", "binary G-code of version 2, expected version 1: export the file as text"),
    ];
    for (name, content, says) in cases {
        let path = file(&directory, name, content);
        for command in ["print", "estimate"] {
            let outcome = ferrostep([command.as_ref(), path.as_os_str()]);
            assert_eq!((outcome.status, outcome.stdout.as_str()), (Some(2), ""), "{outcome:#?}");
            assert!(outcome.stderr.contains(says), "{outcome:#?}");
        }
    }
}
