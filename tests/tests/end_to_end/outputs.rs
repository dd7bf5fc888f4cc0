//! The command's inputs and outputs: pipes, links, devices, full disks, Ctrl-C.

use std::fs;
use std::io::Write;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ferrostep_gpre::Header;
use ferrostep_testkit::program::send_signal;
use tempfile::TempDir;

use crate::end_to_end::command::{Outcome, directory, example, ferrostep, file, gzip, start, start_with};
use crate::end_to_end::prepared::{SQUARE, says};

/// A picture and a job long enough that a pipe's reader needs many portions for it.
fn long_job() -> Vec<u8> {
    let mut job = b"; thumbnail begin 16x16 4\n; AAEC\n; thumbnail end\n".to_vec();
    job.extend(example("cube.gcode"));
    job
}

/// Runs the command with these bytes in a pipe at its standard input.
fn piped<const N: usize>(bytes: Vec<u8>, arguments: [&str; N]) -> Outcome {
    let mut child = start_with(arguments, Stdio::piped(), Stdio::piped());
    let mut pipe = child.stdin.take().unwrap();
    let feeding = std::thread::spawn(move || pipe.write_all(&bytes));
    let outcome: Outcome = child.wait_with_output().unwrap().into();
    feeding.join().unwrap().unwrap();
    outcome
}

/// Runs `preprocess`.
fn preprocess(input: &Path, out: &Path) -> Outcome {
    ferrostep(["preprocess".as_ref(), input.as_os_str(), "-o".as_ref(), out.as_os_str()])
}

/// Names of all entries of a folder, in alphabetical order.
fn names(directory: &TempDir) -> Vec<String> {
    let entries = fs::read_dir(directory.path()).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort_unstable();
    names
}

/// A named pipe.
fn fifo(directory: &TempDir, name: &str) -> PathBuf {
    let path = directory.path().join(name);
    assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
    path
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_piped_job_is_prepared_completely() {
    let directory = directory();
    let [from_file, from_pipe, from_fifo] =
        ["file.gpre", "pipe.gpre", "fifo.gpre"].map(|name| directory.path().join(name));
    let job = long_job();
    let plain = file(&directory, "job.gcode", &job);
    let outcome = preprocess(&plain, &from_file);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let expected = fs::read(&from_file).unwrap();
    assert!(Header::read(&expected).unwrap().thumbnail.is_some());

    for bytes in [job.clone(), gzip(&job)] {
        let outcome = piped(bytes, ["preprocess", "/dev/stdin", "-o", text(&from_pipe)]);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        assert!(fs::read(&from_pipe).unwrap() == expected, "{outcome:#?}");
    }

    let fifo = fifo(&directory, "job");
    let writer = fifo.clone();
    let feeding = std::thread::spawn(move || fs::write(writer, job));
    let outcome = preprocess(&fifo, &from_fifo);
    feeding.join().unwrap().unwrap();
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(fs::read(&from_fifo).unwrap() == expected, "{outcome:#?}");
}

/// The search for a picture reads comments only, and all of them are read again as G-code.
#[test]
fn comments_and_a_truncated_thumbnail_are_read_to_the_end() {
    let directory = directory();
    let out = directory.path().join("out.gpre");
    let comments = b"; nothing but this\n".repeat(200_000);
    let outcome = piped([&comments[..], b"G28\nG1 Xnan\n"].concat(), ["preprocess", "/dev/stdin", "-o", text(&out)]);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "line 200002");
    let cut = gzip(&long_job());
    let outcome = piped(cut[..40].to_vec(), ["preprocess", "/dev/stdin", "-o", text(&out)]);
    assert!(outcome.status.is_some_and(|status| status > 0), "{outcome:#?}");
    says(&outcome.stderr, "cannot be read");
    assert_eq!(names(&directory), [""; 0]);
}

#[test]
fn a_file_named_like_a_part_file_survives() {
    let directory = directory();
    let job = long_job();
    let input = file(&directory, "cube.gpre.part", &job);
    let outcome = preprocess(&input, &directory.path().join("cube.gpre"));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(fs::read(&input).unwrap() == job);
    assert_eq!(names(&directory), ["cube.gpre", "cube.gpre.part"]);
}

#[test]
fn two_runs_with_one_output_leave_one_whole_job() {
    let directory = directory();
    let inputs = [file(&directory, "a.gcode", long_job()), file(&directory, "b.gcode", SQUARE)];
    let alone = directory.path().join("alone.gpre");
    let expected = inputs.each_ref().map(|input| {
        assert_eq!(preprocess(input, &alone).status, Some(0));
        fs::read(&alone).unwrap()
    });
    let both = directory.path().join("both.gpre");
    for turn in 0..4 {
        let children =
            [0, 1].map(|which: usize| start(["preprocess", text(&inputs[(which + turn) % 2]), "-o", text(&both)]));
        for child in children {
            let outcome: Outcome = child.wait_with_output().unwrap().into();
            assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        }
        assert!(expected.contains(&fs::read(&both).unwrap()));
    }
    assert_eq!(names(&directory), ["a.gcode", "alone.gpre", "b.gcode", "both.gpre"]);
}

/// Checks that the command exits with 2 and gives this reason.
#[track_caller]
fn refuses(arguments: &[&str], reason: &str) {
    let outcome = ferrostep(arguments);
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    says(&outcome.stderr, reason);
}

#[test]
fn an_output_that_is_not_a_file_is_refused() {
    let directory = directory();
    let job = file(&directory, "job.gcode", SQUARE);
    let socket = directory.path().join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let pipe = fifo(&directory, "pipe");
    let folder = directory.path().join("folder");
    fs::create_dir(&folder).unwrap();
    let before = names(&directory);
    for option in ["--trace", "--vcd"] {
        refuses(&["print", text(&job), option, text(&socket)], "socket: cannot be written: this is a socket");
        refuses(&["print", text(&job), option, text(&folder)], "folder: cannot be written: this is a folder");
    }
    let prepare = |out: &Path, reason| refuses(&["preprocess", text(&job), "-o", text(out)], reason);
    prepare(&socket, "socket: cannot be written: this is a socket: give the name of a file");
    prepare(&folder, "folder: cannot be written: this is a folder");
    prepare(&pipe, "pipe: cannot be written: this is a pipe");
    prepare(&folder.join("missing/.."), "the path has no file name");
    prepare(&directory.path().join("missing/out.gpre"), "missing");
    assert!(fs::metadata(&socket).unwrap().file_type().is_socket());
    assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
    assert_eq!(names(&directory), before);
}

/// An output that is written in one go may be a pipe or a device.
#[test]
fn a_trace_goes_through_a_pipe() {
    let directory = directory();
    let job = file(&directory, "job.gcode", SQUARE);
    let (plain, pipe) = (directory.path().join("plain"), fifo(&directory, "pipe"));
    assert_eq!(ferrostep(["print", text(&job), "--trace", text(&plain)]).status, Some(0));
    let path = pipe.clone();
    let reading = std::thread::spawn(move || fs::read(path).unwrap());
    let outcome = ferrostep(["print", text(&job), "--trace", text(&pipe), "--vcd", "/dev/null"]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(reading.join().unwrap() == fs::read(&plain).unwrap());
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
}

#[test]
fn an_output_equal_to_the_input_is_refused_under_any_name() {
    let directory = directory();
    let job = file(&directory, "job.gcode", SQUARE);
    let machine = fs::read(crate::end_to_end::command::repository().join("config/profiles/cartesian.toml")).unwrap();
    let machine_path = file(&directory, "machine.toml", &machine);
    let hard_link = directory.path().join("hard");
    fs::hard_link(&job, &hard_link).unwrap();
    let soft_link = directory.path().join("soft");
    symlink("job.gcode", &soft_link).unwrap();
    for out in [&job, &hard_link, &soft_link] {
        for (command, option) in [("preprocess", "-o"), ("print", "--trace"), ("print", "--vcd")] {
            refuses(&[command, text(&job), option, text(out)], "this is the job to be read: choose another name");
        }
    }
    for (command, option) in [("preprocess", "-o"), ("print", "--trace")] {
        let out = text(&machine_path);
        refuses(&[command, text(&job), "--profile", out, option, out], "this is the profile: choose another name");
    }
    let out = directory.path().join("out");
    symlink("out", directory.path().join("link")).unwrap();
    let (out, link) = (text(&out), directory.path().join("link"));
    refuses(&["print", text(&job), "--trace", out, "--vcd", out], "this is the trace: choose another name");
    fs::write(out, "there").unwrap();
    refuses(&["print", text(&job), "--trace", out, "--vcd", text(&link)], "this is the trace: choose another name");
    assert_eq!((fs::read(&job).unwrap(), fs::read(machine_path).unwrap()), (SQUARE.into(), machine));
    assert_eq!(names(&directory), ["hard", "job.gcode", "link", "machine.toml", "out", "soft"]);
}

#[test]
fn a_link_is_written_through() {
    let directory = directory();
    let job = file(&directory, "job.gcode", SQUARE);
    fs::create_dir(directory.path().join("card")).unwrap();
    let target = file(&directory, "card/target.gpre", "old");
    let link = directory.path().join("link.gpre");
    symlink("card/target.gpre", &link).unwrap();
    let outcome = preprocess(&job, &link);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(Header::is_gpre(&fs::read(&target).unwrap()));
    assert_eq!(fs::read_dir(directory.path().join("card")).unwrap().count(), 1);

    let nowhere = directory.path().join("nowhere.gpre");
    symlink("missing.gpre", &nowhere).unwrap();
    refuses(&["preprocess", text(&job), "-o", text(&nowhere)], "this is a link to missing.gpre, which does not exist");
    assert_eq!(names(&directory), ["card", "job.gcode", "link.gpre", "nowhere.gpre"]);
}

#[test]
fn an_output_gets_the_permissions_of_the_file_it_replaces() {
    let directory = directory();
    let job = file(&directory, "job.gcode", SQUARE);
    let [out, usual] = ["out.gpre", "usual"].map(|name| directory.path().join(name));
    fs::write(&usual, "").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().mode() & 0o777;
    assert_eq!(preprocess(&job, &out).status, Some(0));
    assert_eq!(mode(&out), mode(&usual));
    fs::set_permissions(&out, fs::Permissions::from_mode(0o640)).unwrap();
    assert_eq!(preprocess(&job, &out).status, Some(0));
    assert_eq!(mode(&out), 0o640);
    fs::set_permissions(&out, fs::Permissions::from_mode(0o400)).unwrap();
    refuses(&["preprocess", text(&job), "-o", text(&out)], "the file is read-only");
}

/// Waits until the command has begun a file in this folder.
fn wait_for_part(directory: &TempDir, names_before: usize) {
    let start = Instant::now();
    while names(directory).len() == names_before {
        assert!(start.elapsed() < Duration::from_secs(30), "nothing is written");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Starts the command with its signals as in a terminal, also where the tests run under `nohup` or
/// in the background of a script, whose children would ignore some.
fn start_in_terminal(arguments: [&str; 4]) -> Child {
    let mut command = Command::new("env");
    command.arg("--default-signal=INT,TERM,HUP").arg(crate::end_to_end::command::program()).args(arguments);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Sends a signal to a command that has begun its output and waits for more of its input;
/// returns its end.
fn interrupted(child: Child, signal: &str, directory: &TempDir, names_before: usize) -> Option<i32> {
    wait_for_part(directory, names_before);
    send_signal(signal, child.id());
    child.wait_with_output().unwrap().status.signal()
}

#[test]
fn an_interrupted_command_leaves_the_old_file_and_no_part() {
    let directory = directory();
    let input = fifo(&directory, "job");
    let out = file(&directory, "out", "from before");
    for arguments in [["preprocess", "-o"], ["print", "--trace"], ["print", "--vcd"]] {
        for (signal, number) in [("INT", 2), ("TERM", 15), ("HUP", 1)] {
            let [command, option] = arguments;
            let child = start_in_terminal([command, text(&input), option, text(&out)]);
            let mut writer = fs::File::options().write(true).open(&input).unwrap();
            writer.write_all(b"G28\nG1 X10 F3000\n").unwrap();
            assert_eq!(interrupted(child, signal, &directory, 2), Some(number), "{command} {option} {signal}");
            assert_eq!(names(&directory), ["job", "out"]);
            assert_eq!(fs::read(&out).unwrap(), b"from before");
        }
    }
}

/// The command must survive the terminal under `nohup`. The second signal, which is not ignored,
/// ends it: an effect of the first would have come before.
#[test]
fn an_ignored_signal_stays_ignored() {
    let directory = directory();
    let input = fifo(&directory, "job");
    let out = directory.path().join("out.gpre");
    let script = "trap '' HUP; exec env --default-signal=TERM \"$0\" preprocess \"$1\" -o \"$2\"";
    for (signals, ended_by) in [(&["HUP", "TERM"][..], Some(15)), (&["HUP"], None)] {
        let child = Command::new("sh")
            .args(["-c", script, text(crate::end_to_end::command::program()), text(&input), text(&out)])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let mut writer = fs::File::options().write(true).open(&input).unwrap();
        writer.write_all(b"G28\nG1 X10 F3000\n").unwrap();
        wait_for_part(&directory, 1);
        for signal in signals {
            send_signal(signal, child.id());
        }
        if ended_by.is_none() {
            drop(writer);
        }
        let status = child.wait_with_output().unwrap().status;
        assert_eq!((status.signal(), status.success()), (ended_by, ended_by.is_none()));
    }
    assert_eq!(names(&directory), ["job", "out.gpre"]);
}

#[test]
fn an_incomplete_trace_is_an_error() {
    let outcome = ferrostep(["print", "examples/cube.gcode", "--json", "--trace", "/dev/full"]);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "/dev/full: cannot be written");
    // The part that could be printed was printed.
    assert_eq!(outcome.json()["moves"], 5289);
}

/// Runs the command with its standard output at a device.
fn into_device(device: &str, arguments: &[&str]) -> Outcome {
    let device = fs::File::options().write(true).open(device).unwrap();
    start_with(arguments, Stdio::null(), device.into()).wait_with_output().unwrap().into()
}

#[test]
fn an_unwritable_result_is_an_error() {
    let directory = directory();
    let job = file(&directory, "job.gcode", SQUARE);
    let out = directory.path().join("out.gpre");
    assert_eq!(preprocess(&job, &out).status, Some(0));
    let (job, out) = (text(&job), text(&out));
    for arguments in [
        &["print", job][..],
        &["print", job, "--json"],
        &["print", out],
        &["estimate", job],
        &["estimate", job, "--json"],
        &["preprocess", job, "-o", out],
        &["preprocess", job, "-o", out, "--json"],
        &["inspect", out],
        &["inspect", out, "--items"],
        &["inspect", out, "--entries"],
        &["papers", "wu"],
        &["papers", "wu", "--json"],
        &["--help"],
        &["--version"],
        &["print", "--help"],
    ] {
        let outcome = into_device("/dev/full", arguments);
        assert_eq!(outcome.status, Some(1), "{arguments:?}: {outcome:#?}");
        says(&outcome.stderr, "error: standard output: cannot be written: No space left on device");
        let outcome = into_device("/dev/null", arguments);
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{arguments:?}");
    }
}

/// A reader that closes the pipe has read enough.
#[test]
fn a_closed_pipe_is_not_an_error() {
    for arguments in [&["papers", "wu"][..], &["estimate", "examples/cube.gcode"]] {
        let mut child = start(arguments);
        drop(child.stdout.take());
        let outcome: Outcome = child.wait_with_output().unwrap().into();
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{arguments:?}");
    }
}

/// The name of the temporary file is of no use to a person.
#[test]
fn a_missing_folder_is_named_without_the_temporary_file() {
    let outcome = ferrostep(["preprocess", "examples/cube.gcode", "-o", "/no-such-folder/x.gpre"]);
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    let expected = "/no-such-folder/x.gpre: cannot be written: No such file or directory (os error 2)\n";
    assert!(outcome.stderr.ends_with(expected), "{}", outcome.stderr);
}

/// A file's name and its content must not control the terminal.
#[test]
fn control_characters_are_escaped() {
    let directory = directory();
    let job =
        file(&directory, "red\x1b[31m\n\u{9b}2J.gcode", "G28\nM118 A1 ring\u{9b}6n\nG1 X10 F3000\nFIRMWARE_\u{9b}1\n");
    let out = directory.path().join("out\x1b[32m.gpre");
    let missing = directory.path().join("none\x07");
    let shown = |arguments: &[&str]| {
        let outcome = ferrostep(arguments);
        let all = format!("{}{}", outcome.stdout, outcome.stderr);
        let control = |c: char| c.is_control() && c != '\n';
        assert!(!all.contains(control), "{all:?}");
        outcome
    };
    let outcome = shown(&["print", text(&job)]);
    says(&outcome.stdout, "red\\u{1b}[31m\\n\\u{9b}2J.gcode on cartesian: done\n");
    says(&outcome.stderr, "ring\\u{9b}6n");
    shown(&["estimate", text(&job)]);
    let outcome = shown(&["print", text(&job), "--json"]);
    assert_eq!(outcome.json()["file"], text(&job));
    says(&shown(&["preprocess", text(&job), "-o", text(&out)]).stdout, "out\\u{1b}[32m.gpre");
    shown(&["inspect", text(&out), "--items"]);
    says(&shown(&["print", text(&missing)]).stderr, "none\\u{7}: cannot be read");
    shown(&["print", "examples/cube.gcode", "--profile", text(&missing)]);
    shown(&["print", "examples/cube.gcode", "--trace", text(&missing.join("out"))]);
}
