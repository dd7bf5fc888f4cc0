//! `ferrostep post-process`: the time goes into the file, the steps stay, and a file that cannot be
//! corrected is unchanged.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

use crate::end_to_end::command::{Outcome, directory, example, ferrostep, file, gzip, program, repository};

/// A print of a minute, without M73.
const JOB: &str = "; estimated printing time (normal mode) = 9s\nM302 P1\nG28\nG92 E0\nG1 X60 E1 F600\nG4 S60\nG1 X0\n";

fn post_process(path: &Path, more: &[&str]) -> Outcome {
    ferrostep([&["post-process", path.to_str().unwrap()], more].concat())
}

/// The digests of a print, and its time.
fn digests(path: &Path, profile: &str) -> [Value; 3] {
    let print = ferrostep(["print", path.to_str().unwrap(), "--profile", profile, "--json"]).json();
    ["order_digest", "step_digest", "motion_time_s"].map(|key| print[key].clone())
}

/// Corrects an example twice; returns the report of the first time.
fn corrects(name: &str, profile: &str) -> Value {
    let folder = directory();
    let text = example(name);
    let path = file(&folder, "job.gcode", &text);
    let steps = digests(&path, profile);
    let estimated = ferrostep(["estimate", path.to_str().unwrap(), "--profile", profile, "--json"]).json();
    let outcome = post_process(&path, &["--profile", profile, "--json"]);
    assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:?}");
    let report = outcome.json();
    assert_eq!(report["print_time_s"], estimated["print_time_s"], "{name}");
    let corrected = fs::read(&path).unwrap();
    assert_eq!(report["changed"], Value::Bool(true));
    assert_eq!(digests(&path, profile), steps, "{name}");

    let inode = fs::metadata(&path).unwrap().ino();
    let again = post_process(&path, &["--profile", profile]);
    assert_eq!(again.stdout.lines().count(), 1, "{again:?}");
    assert!(again.stdout.contains("already in"), "{again:?}");
    assert!(fs::read(&path).unwrap() == corrected, "{name}: the second run changes it");
    assert_eq!(fs::metadata(&path).unwrap().ino(), inode, "{name}: the second run writes it");
    report
}

#[test]
fn the_time_of_a_slicer_becomes_that_of_the_print() {
    // PrusaSlicer: two modes; Cura: a time for each layer; Slic3r: none.
    let report = corrects("cube.gcode", "cartesian");
    assert_eq!((&report["comments"], &report["added_lines"]), (&2.into(), &0.into()), "{report}");
    assert!(report["progress_lines"].as_u64().unwrap() > 40, "{report}");
    let report = corrects("cube-cura.gcode.gz", "cartesian");
    assert!(report["comments"].as_u64() > Some(100) && report["added_lines"].as_u64() > Some(20), "{report}");
    let report = corrects("cube-slic3r.gcode.gz", "cartesian");
    assert!(report["comments"] == 0 && report["added_lines"].as_u64() > Some(20), "{report}");
    let report = corrects("cube-corexy.gcode.gz", "corexy");
    assert!(report["slicer_time_s"].as_f64() > Some(300.0), "{report}");
}

/// `estimate` reads the print's own time as the slicer's in the corrected file.
#[test]
fn the_time_is_read_again() {
    let folder = directory();
    for name in ["cube.gcode", "cube-cura.gcode.gz"] {
        let path = file(&folder, "job.gcode", example(name));
        assert_eq!(post_process(&path, &[]).status, Some(0));
        let estimate = ferrostep(["estimate", path.to_str().unwrap(), "--json"]).json();
        let [ours, slicer] = ["print_time_s", "slicer_time_s"].map(|key| estimate[key].as_f64().unwrap());
        assert!((ours - slicer).abs() <= 0.5, "{name}: {ours} and {slicer}");
    }
}

#[test]
fn another_file_leaves_the_first_alone() {
    let folder = directory();
    let path = file(&folder, "job.gcode", JOB);
    let out = folder.path().join("out.gcode");
    let outcome = post_process(&path, &["-o", out.to_str().unwrap(), "--no-m73", "--mark", "a note"]);
    assert_eq!(outcome.status, Some(0), "{outcome:?}");
    assert_eq!(fs::read_to_string(&path).unwrap(), JOB);
    let text = fs::read_to_string(&out).unwrap();
    let (first, rest) = text.split_once('\n').unwrap();
    assert!(first.starts_with("; estimated printing time (normal mode) = 1m "), "{text}");
    assert_eq!(rest, format!("{}; a note\n", JOB.split_once('\n').unwrap().1));
    let outcome = post_process(&path, &["-o", path.to_str().unwrap()]);
    assert_eq!(outcome.status, Some(2), "{outcome:?}");
    let outcome = post_process(&path, &["-o", "/dev/full"]);
    assert_eq!(outcome.status, Some(1), "{outcome:?}");
    assert!(outcome.stderr.contains("/dev/full: cannot be written: No space left"), "{outcome:?}");
    // A folder without room for files, whoever writes.
    let outcome = post_process(&path, &["-o", "/proc/out.gcode"]);
    assert_eq!(outcome.status, Some(2), "{outcome:?}");
    assert!(outcome.stderr.contains("/proc/out.gcode: cannot be written"), "{outcome:?}");
    for mark in ["", "two\nlines"] {
        assert_eq!(post_process(&path, &["--mark", mark]).status, Some(2));
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), JOB);
}

#[test]
fn a_link_leads_to_the_file_and_permissions_stay() {
    let folder = directory();
    let path = file(&folder, "job.gcode", JOB);
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    let link = folder.path().join("link.gcode");
    symlink("job.gcode", &link).unwrap();
    let outcome = post_process(&link, &[]);
    assert_eq!(outcome.status, Some(0), "{outcome:?}");
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    let metadata = fs::symlink_metadata(&path).unwrap();
    assert!(metadata.is_file() && metadata.permissions().mode() & 0o777 == 0o640, "{metadata:?}");
    assert!(fs::read_to_string(&path).unwrap().contains("\nM73 P0 R1\n"));
}

/// Runs a command that must fail; the file keeps its bytes, and no other file is left beside it.
#[track_caller]
fn refuses(folder: &TempDir, path: &PathBuf, status: i32, reason: &str) {
    let before = fs::read(path).ok();
    let files = fs::read_dir(folder.path()).unwrap().count();
    let outcome = post_process(path, &[]);
    assert_eq!(outcome.status, Some(status), "{reason}: {outcome:?}");
    assert!(outcome.stderr.starts_with("error: ") && outcome.stderr.contains(reason), "{reason}: {outcome:?}");
    assert_eq!(outcome.stdout, "", "{reason}");
    assert!(fs::read(path).ok() == before, "{reason}: the file has changed");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), files, "{reason}: a file is left");
}

#[test]
fn what_cannot_be_corrected_stays_as_it_is() {
    let folder = directory();
    let cut = &example("cube.gcode")[..100_001];
    let cut_word = [cut, b"\nG1 X-"].concat();
    let cold = JOB.replace("M302 P1\n", "");
    let mut damaged = example("cube.bgcode");
    let cut_block = damaged[..20_000].to_vec();
    damaged[20_000] ^= 4;
    let cases: [(&str, Vec<u8>, i32, &str); 10] = [
        ("cold.gcode", cold.into_bytes(), 1, "line 4"),
        ("cut.gcode", cut_word, 1, "expected one like 12.5"),
        ("comments.gcode", b"; nothing\n".to_vec(), 1, "no motion"),
        ("empty.gcode", Vec::new(), 2, "the file is empty"),
        ("packed.gcode.gz", gzip(JOB.as_bytes()), 2, "packed with gzip"),
        ("plate.gcode.3mf", b"PK\x03\x04 and more".to_vec(), 2, "a zip archive"),
        ("picture.gcode", b"\x89PNG\r\n\x1a\n\0\0".to_vec(), 2, "not a text file"),
        ("cut.bgcode", cut_block, 2, "the file ends before its end: copy or export it again"),
        ("damaged.bgcode", damaged, 2, "copy or export the file again"),
        ("numbered.gcode", b"N1 G28*18\nN2 G1 X5*103\n".to_vec(), 1, "--no-m73"),
    ];
    for (name, bytes, status, reason) in cases {
        refuses(&folder, &file(&folder, name, bytes), status, reason);
    }
    refuses(&folder, &folder.path().to_path_buf(), 2, "cannot be read: Is a directory");
    refuses(&folder, &folder.path().join("none.gcode"), 2, "No such file");
    for (path, reason) in [("-", "once only"), ("/dev/null", "a device")] {
        let outcome = post_process(Path::new(path), &[]);
        assert_eq!(outcome.status, Some(2), "{outcome:?}");
        assert!(outcome.stderr.contains(reason), "{outcome:?}");
    }
    let prepared = folder.path().join("job.gpre");
    let job = file(&folder, "job.gcode", JOB);
    ferrostep([Path::new("preprocess"), &job, Path::new("-o"), &prepared]);
    refuses(&folder, &prepared, 2, "a prepared job");
}

/// A file cut between two lines is a shorter print, and gets that print's time.
#[test]
fn a_file_that_ends_early_gets_its_own_time() {
    let folder = directory();
    let text = example("cube.gcode");
    let end = text[..100_000].iter().rposition(|byte| *byte == b'\n').unwrap();
    let path = file(&folder, "job.gcode", &text[..end]);
    let outcome = post_process(&path, &["--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome:?}");
    let whole = ferrostep(["estimate", "examples/cube.gcode", "--json"]).json();
    assert!(outcome.json()["print_time_s"].as_f64() < whole["print_time_s"].as_f64());
    assert_ne!(fs::read(&path).unwrap().last(), Some(&b'\n'));
}

/// The disk is full, or a quota reached, in the middle of the copy.
#[test]
fn a_copy_that_finds_no_room_leaves_the_file() {
    for (name, example_name, blocks) in [("job.gcode", "cube.gcode", 64), ("job.bgcode", "cube.bgcode", 32)] {
        let folder = directory();
        let path = file(&folder, name, example(example_name));
        let before = fs::read(&path).unwrap();
        let limited = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" post-process \"$1\"");
        let output = Command::new("sh").args(["-c", &limited]).arg(program()).arg(&path).output().unwrap();
        let outcome = Outcome::from(output);
        assert_eq!(outcome.status, Some(1), "{outcome:?}");
        assert!(outcome.stderr.contains(&format!("{name}: cannot be written: File too large")), "{outcome:?}");
        assert!(fs::read(&path).unwrap() == before);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

/// The kind, compression and encoding of each block, by the specification's layout.
fn forms(file: &[u8]) -> Vec<[u16; 3]> {
    let has_checksums = u16_at(file, 8) == 1;
    let (mut place, mut forms) = (10, Vec::new());
    while place < file.len() {
        let [kind, compression] = [u16_at(file, place), u16_at(file, place + 2)];
        let (header, size_at) = if compression == 0 { (8, 4) } else { (12, 8) };
        let size = u32::from_le_bytes(file[place + size_at..][..4].try_into().unwrap());
        forms.push([kind, compression, u16_at(file, place + header)]);
        let data = place + header + if kind == 5 { 6 } else { 2 } + size as usize;
        if has_checksums {
            let mut crc = flate2::Crc::new();
            crc.update(&file[place..data]);
            assert_eq!(crc.sum().to_le_bytes(), file[data..data + 4], "block {}", forms.len());
        }
        place = data + if has_checksums { 4 } else { 0 };
    }
    forms
}

fn u16_at(file: &[u8], place: usize) -> u16 {
    u16::from_le_bytes(file[place..place + 2].try_into().unwrap())
}

/// Prusa's files of every compression and encoding: the time is in, the blocks keep their form and
/// order, and the steps are the same.
#[test]
fn binary_gcode_is_corrected_in_its_form() {
    let folder = repository().join("desk/binary-gcode/tests/data");
    let names = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let rings: Vec<PathBuf> = names.filter(|path| path.extension().is_some_and(|end| end == "bgcode")).collect();
    assert_eq!(rings.len(), 13);
    for source in rings.into_iter().chain([repository().join("examples/cube.bgcode")]) {
        let name = source.file_name().unwrap().to_str().unwrap().to_owned();
        let before = fs::read(&source).unwrap();
        let folder = directory();
        let path = file(&folder, "job.bgcode", &before);
        let steps = digests(&path, "prusa-mini");
        let outcome = post_process(&path, &["--profile", "prusa-mini", "--json"]);
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{name}: {outcome:?}");
        let report = outcome.json();
        assert!(report["changed"] == true && report["comments"].as_u64() >= Some(1), "{name}: {report}");
        assert!(report["slicer_time_s"].as_f64() > Some(1000.0), "{name}: {report}");
        let after = fs::read(&path).unwrap();
        let distinct = |mut forms: Vec<[u16; 3]>| {
            forms.dedup();
            forms
        };
        assert_eq!(distinct(forms(&after)), distinct(forms(&before)), "{name}");
        assert_eq!(digests(&path, "prusa-mini"), steps, "{name}");
        let estimate = ferrostep(["estimate", path.to_str().unwrap(), "--profile", "prusa-mini", "--json"]).json();
        let [ours, slicer] = ["print_time_s", "slicer_time_s"].map(|key| estimate[key].as_f64().unwrap());
        assert!((ours - slicer).abs() <= 0.5, "{name}: {ours} and {slicer}");
        assert!(after.len() < before.len() * 3 / 2, "{name}: {} bytes", after.len());
        let again = post_process(&path, &["--profile", "prusa-mini"]);
        assert!(again.stdout.contains("already in"), "{name}: {again:?}");
        assert!(fs::read(&path).unwrap() == after, "{name}: the second run changes it");
    }
}
