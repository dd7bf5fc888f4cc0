//! The command's answer to each kind of bad input, word for word, beside the tests' data: to
//! files and arguments, to lines of G-code and to profiles.
//!
//! All are compared with the present answers. `FERROSTEP_REFRESH=1` writes them anew; the
//! difference then shows whether a refusal lost its place, its figures or its cure.

use std::fmt::Write as _;
use std::fs;

use crate::end_to_end::command::{directory, ferrostep, file, repository};
use crate::end_to_end::papers::REFRESH_VARIABLE;

const PAGE: &str = "tests/data/refused-files.md";
const LINES_PAGE: &str = "tests/data/refused-lines.md";
const PROFILES_PAGE: &str = "tests/data/refused-profiles.md";

const HEAD: &str = "# Refused files and arguments

What `ferrostep` answers to files that it cannot read and to arguments that it does not take.
";

const LINES_HEAD: &str = "# Refused lines of G-code

What `ferrostep print` answers to a line; a board sends the same words over its line. A refused line has no effect: the moves before it
are finished, and the job ends there.
";

const PROFILES_HEAD: &str = "# Refused profiles

What `ferrostep print examples/cube.gcode --profile own.toml` answers to a profile with a fault.
";

/// Lines of G-code that are refused after `G28`, a line of the page each; `\\n` separates lines,
/// the last of which is refused.
const LINES: &[&str] = &[
    // The line cannot be read.
    "G1 X20 Y1.2.3",
    "G1 X20 Y--4",
    "G1 Xnan Y20",
    "G1 X20 #4",
    "G1 X99999999999",
    "X20 Y5",
    "G1 20 Y5",
    "N3 G1 X20*5",
    "N3 G1 X20*x",
    "G",
    "G1.5 X1",
    // The line can be read, but not executed.
    "G2 X20 Y20",
    "G2 X20 Y20 I1 J0",
    "G2 X20 Y20 R1",
    "G2 X10 Y20 R0",
    "G2 X10 Y20 I5 P2",
    "G18",
    "G5 X20 Y20 I1 J1 P1 Q1",
    "G5.1 X20 Y20 I1 J1",
    "G6 X1",
    "G10 L2 P1 X5",
    "G38.2 Z1",
    "G52 X5",
    "G53 G1 X5",
    "G55",
    "G68 R45",
    "G92.1",
    "M149 F",
    "M200 D1.75",
    "M200 S1",
    "T1",
    // Values out of their ranges.
    "G1 X20 F0.001",
    "G1 X20 Y5000.001",
    "G4 P-1",
    "M84 S-1",
    "M86 S-1",
    "M106 S-1",
    "M104 S500",
    "M109 S400",
    "M140 S200",
    "M190 R126",
    "M155 S-1",
    "M205 J50",
    "M207 S-1",
    "M221 S0",
    "M301 P0",
    "M301 P20 I-1",
    "M301 Pnan",
    "M303 S20",
    "M303 E-1 S125",
    "M303 E1",
    "M304 D99999",
    "M412 S2",
    "M569 S7 X",
    "M593 F700",
    "M593 D1",
    "M593 P\"ei3\" F15",
    "M593 P\"zvddd\" F40",
    "M593 Pmzv F40",
    "M593 Z F40",
    "SET_INPUT_SHAPER SHAPER_TYPE=mzv(n=6,t=0.9)",
    "SET_INPUT_SHAPER SHAPER_FREQ_X=4",
    "SET_INPUT_SHAPER SHAPER_FREQUENCY_X=40",
    "M572 S2.5",
    "M900 K",
    "M572 S0.05 T4",
    "M572 S0.05 W0.2",
    "M593 F40\\nM796 I1",
    "M796 I1\\nM593 F40",
    "M795 H0",
    "M796 I9",
    "M796 A9",
    "M851 Z100",
    "M852 I0.06",
    "SET_SKEW XY=141.4,141.4",
    "SET_SKEW XY=100,100,300",
    "M906 X5000",
    "M913 X9999",
    "M914 X999",
    // The machine is not ready for the line.
    "G1 X20 E5",
    "G1 Z1 E-1",
    "G10",
    "M112\\nG1 X5",
    "M790 S10",
    "M104 S100\\nM303 S200",
    "M84 Z\\nM290 Z0.1",
    "TUNING_TOWER COMMAND=M900 START=0 FACTOR=0.005",
    "TUNING_TOWER COMMAND=M109 PARAMETER=S START=220 FACTOR=-1",
    "TUNING_TOWER COMMAND=M900 PARAMETER=S START=0 FACTOR=0.005",
];

/// Profile and lines that are refused there.
const ON_PROFILES: &[(&str, &str)] = &[
    ("prusa-mini", "M84 X\\nG28 Z"),
    ("prusa-mini", "M913 X40\\nG28 X"),
    ("prusa-mini", "M914 X0\\nG28 X"),
    ("prusa-mini", "M906 X5000"),
    ("prusa-mini", "M569 S0 X\\nG28 X"),
];

/// Profile, its text, and the text that replaces it.
const PROFILES: &[(&str, &str, &str)] = &[
    ("cartesian", "kinematics = \"cartesian\"", "kinematics = \"scara\""),
    ("cartesian", "junction_deviation_mm = 0.1\n", ""),
    ("cartesian", "junction_deviation_mm = 0.1", "junction_deviation_mm = \"wide\""),
    ("cartesian", "jerk_mm_per_s3 = 10000", "jerk_mm_per_s3 = 10000\nwarp_factor = 9"),
    ("cartesian", "jerk_mm_per_s3 = 10000", "jerk_mm_per_s3 = 10000\nerror_budget_mm = 0.02"),
    ("cartesian", "jerk_mm_per_s3 = 10000", "jerk_mm_per_s3 = 10000\npath_tolerance_mm = 0.05"),
    ("cartesian", "steps_per_mm = { x = 80", "steps_per_mm = { x = -80"),
    ("cartesian", "y = 80, z = 400", "z = 400"),
    ("cartesian", "max_celsius = 275", "max_celsius = 1e9"),
    ("cartesian", "end = \"min\"", "end = \"max\""),
    ("cartesian", "end = \"min\"", "end = \"middle\""),
    ("cartesian", "both_edges = false", "both_edges = 0"),
    ("cartesian", "us = 1.0", "us = 1.001"),
    ("cartesian", "name = \"cartesian\"", "name = \"two\\nlines\""),
    ("cartesian", "min_extrusion_celsius = 170", "min_extrusion_celsius = 275"),
    ("cartesian", "fast_mm_per_s = 4", "fast_mm_per_s = 10.5"),
    ("cartesian", "\"end-stop\"\n", "\"stall\"\n"),
    ("cartesian", "[driver]", "[driver"),
    ("corexy", "position_mm = 300", "position_mm = 149"),
    ("corexy", "[driver]", "[input_shaper.x]\nkind = \"zvddd\"\nfrequency_hz = 50\n[driver]"),
    ("corexy", "[driver]", "[input_shaper.x]\nkind = \"3hump_ei\"\nfrequency_hz = 15\n[driver]"),
    ("corexy", "[driver]", "[pressure_advance]\nseconds = 2.5\n[driver]"),
    ("corexy", "[driver]", "[pressure_advance]\nsmooth_time_s = 0.02\n[driver]"),
    ("corexy", "[driver]", "[input_shaper.y]\nkind = \"ei\"\nfrequency_hz = 50\ndamping = 0.5\n[driver]"),
    (
        "corexy",
        "name = \"corexy\"",
        "interpolation = \"dual-rate\"\ninput_shaper.x = { kind = \"zv\", frequency_hz = 50 }\nname = \"corexy\"",
    ),
    (
        "corexy",
        "name = \"corexy\"",
        "path_tolerance_mm = 0.002\ninput_shaper.x = { kind = \"ei\", frequency_hz = 25 }\nname = \"corexy\"",
    ),
    ("corexy", "minimum_event_interval_us = 2.0", "minimum_event_interval_us = 6.26"),
    ("prusa-mini", "stall_threshold = 130", "stall_threshold = 0"),
    ("prusa-mini", "slow_mm_per_s = 50", "slow_mm_per_s = 31.9"),
    ("prusa-mini", "back_off_mm = 2.56", "back_off_mm = 1.99"),
];

/// Zip archives of empty files: `[Content_Types].xml`; `Metadata/plate_1.gcode` and
/// `plate_2.gcode`; `cube.gcode`.
const PROJECT: &[u8] = b"PK\x03\x04\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x13\0\0\0[Content_Types].xmlPK\x01\x02\x14\0\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x13\0\0\0\0\0\0\0\0\0\0\0\x80\x01\0\0\0\0[Content_Types].xmlPK\x05\x06\0\0\0\0\x01\0\x01\0A\0\0\0\x31\0\0\0\0\0";
const TWO_PLATES: &[u8] = b"PK\x03\x04\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x16\0\0\0Metadata/plate_1.gcodePK\x03\x04\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x16\0\0\0Metadata/plate_2.gcodePK\x01\x02\x14\0\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x16\0\0\0\0\0\0\0\0\0\0\0\x80\x01\0\0\0\0Metadata/plate_1.gcodePK\x01\x02\x14\0\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x16\0\0\0\0\0\0\0\0\0\0\0\x80\x014\0\0\0Metadata/plate_2.gcodePK\x05\x06\0\0\0\0\x02\0\x02\0\x88\0\0\0h\0\0\0\0\0";
const ARCHIVE: &[u8] = b"PK\x03\x04\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x0a\0\0\0cube.gcodePK\x01\x02\x14\0\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x0a\0\0\0\0\0\0\0\0\0\0\0\x80\x01\0\0\0\0cube.gcodePK\x05\x06\0\0\0\0\x01\0\x01\08\0\0\0(\0\0\0\0\0";

/// Files that are not jobs: kind, name, first bytes.
const FILES: &[(&str, &str, &[u8])] = &[
    ("an empty file", "job.gcode", b""),
    ("a 3MF project", "cube.3mf", PROJECT),
    ("a sliced 3MF with several plates", "cube.gcode.3mf", TWO_PLATES),
    ("another zip archive", "cube.zip", ARCHIVE),
    ("a damaged zip archive", "cube.gcode.3mf", b"PK\x03\x04\x14\0\0\0\x08\0[Content_Types].xml"),
    ("a model", "cube.stl", b"solid cube\n  facet normal 0 0 1\n"),
    ("text in UTF-16", "cube.gcode", b"\xff\xfeG\x002\x008\0\n\0"),
    ("a file packed by zstd", "cube.gcode.zst", b"\x28\xb5\x2f\xfd\x04\0"),
    ("a picture", "cube.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"),
];

/// Changes to binary G-code: description, place from the end, bits. The last one cuts it off there.
const BINARY: &[(&str, usize, u8)] =
    &[("a byte of its last block", 9, 1), ("its version", usize::MAX, 2), ("the rest missing", 50, 0)];

/// Arguments after `ferrostep`.
const ARGUMENTS: &[&str] = &[
    "print missing.gcode",
    "print examples",
    "print examples/cube.gcode --profile delta",
    "print examples/cube.gcode --look-ahead 1",
    "print examples/cube.gcode --look-ahead many",
    "print examples/cube.gcode --from-frame 3",
    "print examples/cube.gcode --trace examples",
    "preprocess examples/cube.gcode -o examples/cube.gcode",
    "inspect examples/cube.gcode",
    "send examples/cube.gcode --port no/such/port",
    "send examples/cube.gcode --fallback examples/cube.gcode",
];

/// The first error line, without the name of a temporary folder.
fn answer(arguments: &[&str], folder: &str) -> String {
    let outcome = ferrostep(arguments);
    assert_ne!(outcome.status, Some(0), "{arguments:?} was accepted: {outcome:#?}");
    let text = outcome.stderr.replace(&format!("{folder}/"), "");
    // A summary may come before; the last of several lines gives the reason.
    let error =
        text.lines().rev().find_map(|line| line.strip_prefix("error: ")).unwrap_or_else(|| panic!("{outcome:#?}"));
    error.replace('|', "\\|")
}

fn row(page: &mut String, input: &str, says: &str) {
    writeln!(page, "| `{}` | {says} |", input.replace('|', "\\|").trim_end()).unwrap();
}

fn table(page: &mut String, title: &str, first: &str) {
    writeln!(page, "\n## {title}\n\n| {first} | answer |\n|---|---|").unwrap();
}

fn lines(page: &mut String) {
    let temporary = directory();
    let folder = temporary.path().to_str().unwrap();
    let refused = |profile: &str, line: &str| {
        let job = file(&temporary, "job.gcode", format!("G28\n{}\n", line.replace("\\n", "\n")));
        answer(&["print", job.to_str().unwrap(), "--profile", profile], folder)
    };
    table(page, "Lines of G-code", "after `G28`, on `cartesian`");
    for line in LINES {
        row(page, &line.replace("\\n", "`, `"), &refused("cartesian", line));
    }
    table(page, "Lines on other machines", "after `G28`");
    for (profile, line) in ON_PROFILES {
        row(page, &format!("{}` on `{profile}", line.replace("\\n", "`, `")), &refused(profile, line));
    }
}

fn profiles(page: &mut String) {
    let temporary = directory();
    let folder = temporary.path().to_str().unwrap();
    table(page, "Profiles", "change of a built-in profile");
    for (profile, from, to) in PROFILES {
        let text = fs::read_to_string(repository().join("config/profiles").join(format!("{profile}.toml"))).unwrap();
        assert!(text.contains(from), "{profile} has no {from:?}");
        let changed = file(&temporary, "own.toml", text.replacen(from, to, 1));
        let says = answer(&["print", "examples/cube.gcode", "--profile", changed.to_str().unwrap()], folder);
        let [from, to] = [from, to].map(|text| text.trim_end().replace('\n', "`, `"));
        let input =
            if to.is_empty() { format!("{from}` left out of `{profile}") } else { format!("{from}` becomes `{to}") };
        row(page, &input, &says);
    }
}

fn prepared(page: &mut String) {
    let temporary = directory();
    let folder = temporary.path().to_str().unwrap();
    let gcode = file(&temporary, "job.gcode", "G28\nG1 X50 Y50 F6000\nG1 X60 Y60\nG1 X70 Y50\nM104 S0\nG1 X20\n");
    let path = temporary.path().join("job.gpre");
    let prepared = ferrostep(["preprocess", gcode.to_str().unwrap(), "-o", path.to_str().unwrap()]);
    assert_eq!(prepared.status, Some(0), "{prepared:#?}");
    let job = fs::read(&path).unwrap();
    let changed = |place: usize, bits: u8| {
        let mut changed = job.clone();
        changed[place] ^= bits;
        changed
    };
    table(page, "Prepared jobs", "change of a prepared job");
    let cases: [(&str, Vec<u8>); 7] = [
        ("the first byte", changed(0, 1)),
        ("the version in the header", changed(4, 0x40)),
        ("a byte of the header", changed(20, 1)),
        ("a byte of the last frame", changed(job.len() - 6, 1)),
        ("the last byte missing", job[..job.len() - 1].to_vec()),
        ("the second half missing", job[..job.len() / 2].to_vec()),
        ("a byte after the end", [job.as_slice(), b"x"].concat()),
    ];
    for (what, bytes) in cases {
        let broken = file(&temporary, "broken.gpre", bytes);
        let says = answer(&["print", broken.to_str().unwrap()], folder);
        writeln!(page, "| {what} | {says} |").unwrap();
    }
    let job = path.to_str().unwrap();
    for arguments in [
        &["print", job, "--profile", "corexy"][..],
        &["print", job, "--from-frame", "99"],
        &["estimate", job],
        &["preprocess", job, "-o", "other.gpre"],
        &["send", job, "--port", "no/such/port"],
        &["send", job, "--meatpack"],
        &["papers", "--compare", job],
    ] {
        let says = answer(arguments, folder);
        row(page, &arguments.join(" ").replace(&format!("{folder}/"), ""), &says);
    }
}

fn files(page: &mut String) {
    let temporary = directory();
    let folder = temporary.path().to_str().unwrap();
    table(page, "Files that are no jobs", "`print` of");
    for (what, name, bytes) in FILES {
        let says = answer(&["print", file(&temporary, name, bytes).to_str().unwrap()], folder);
        writeln!(page, "| {what} | {says} |").unwrap();
    }
    table(page, "Binary G-code", "change of `examples/cube.bgcode`");
    let job = fs::read(repository().join("examples/cube.bgcode")).unwrap();
    for (what, from_end, bits) in BINARY {
        let mut changed = job.clone();
        // The version follows the four letters.
        let place = changed.len().checked_sub(*from_end).unwrap_or(4);
        changed[place] ^= bits;
        if *bits == 0 {
            changed.truncate(place);
        }
        let says = answer(&["print", file(&temporary, "broken.bgcode", changed).to_str().unwrap()], folder);
        writeln!(page, "| {what} | {says} |").unwrap();
    }
}

fn arguments(page: &mut String) {
    table(page, "Arguments", "`ferrostep` with");
    for arguments in ARGUMENTS {
        row(page, arguments, &answer(&arguments.split(' ').collect::<Vec<_>>(), "-"));
    }
}

#[test]
fn the_page_of_refusals_is_current() {
    let mut page = HEAD.to_owned();
    prepared(&mut page);
    files(&mut page);
    arguments(&mut page);
    assert_current(PAGE, &page);
}

#[test]
fn the_refused_lines_are_current() {
    let mut page = LINES_HEAD.to_owned();
    lines(&mut page);
    assert_current(LINES_PAGE, &page);
}

#[test]
fn the_refused_profiles_are_current() {
    let mut page = PROFILES_HEAD.to_owned();
    profiles(&mut page);
    assert_current(PROFILES_PAGE, &page);
}

/// Writes the page where that is asked for, and compares the kept one with it.
fn assert_current(name: &str, page: &str) {
    let path = repository().join(name);
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        fs::write(&path, page).unwrap();
    }
    let kept = fs::read_to_string(&path).unwrap_or_default();
    for (kept, now) in kept.lines().zip(page.lines()) {
        assert_eq!(kept, now, "{name} is not current: {REFRESH_VARIABLE}=1 writes it anew");
    }
    assert_eq!(
        kept.lines().count(),
        page.lines().count(),
        "{name} is not current: {REFRESH_VARIABLE}=1 writes it anew"
    );
}
