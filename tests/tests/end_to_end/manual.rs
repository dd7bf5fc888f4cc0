//! Completions and manual pages.

use std::fs;
use std::io::Write;
use std::process::{Command, Stdio};

use crate::command::{directory, ferrostep};

/// The subcommands that `--help` lists.
fn subcommands() -> Vec<String> {
    let help = ferrostep(["--help"]).stdout;
    let listed = help.split_once("Commands:\n").unwrap().1.split("\n\n").next().unwrap();
    let names = listed.lines().filter_map(|line| line.strip_prefix("  ")).filter(|line| !line.starts_with(' '));
    names.filter_map(|line| line.split(' ').next()).filter(|name| *name != "help").map(str::to_owned).collect()
}

#[test]
fn every_shell_completes_every_subcommand() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let outcome = ferrostep(["completions", shell]);
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{shell}");
        let names = subcommands();
        assert!(names.len() > 10, "{names:?}");
        for name in names {
            assert!(outcome.stdout.contains(&name), "{shell} does not know {name}");
        }
    }
}

/// bash reads its script, and completes a word by it.
#[test]
fn bash_completes_by_its_script() {
    let script = ferrostep(["completions", "bash"]).stdout;
    let Ok(mut bash) = Command::new("bash").args(["-n"]).stdin(Stdio::piped()).spawn() else { return };
    bash.stdin.take().unwrap().write_all(script.as_bytes()).unwrap();
    assert!(bash.wait().unwrap().success());
    let asked = format!(
        "{script}\nCOMP_WORDS=(ferrostep pri); COMP_CWORD=1; _ferrostep ferrostep pri ferrostep; echo \"${{COMPREPLY[*]}}\"\n\
         COMP_WORDS=(ferrostep print --pro); COMP_CWORD=2; _ferrostep ferrostep --pro print; echo \"${{COMPREPLY[*]}}\"\n"
    );
    let output = Command::new("bash").args(["--norc", "-c", &asked]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), "print\n--profile\n", "{output:?}");
}

#[test]
fn every_subcommand_has_a_manual_page() {
    let directory = directory();
    let outcome = ferrostep(["man".as_ref(), "-o".as_ref(), directory.path().as_os_str()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let mut pages = vec!["ferrostep".to_owned()];
    pages.extend(subcommands().into_iter().map(|name| format!("ferrostep-{name}")));
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), pages.len());
    for page in pages {
        let path = directory.path().join(format!("{page}.1"));
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(".SH NAME") && text.contains(".SH SYNOPSIS"), "{page}");
        assert!(text.replace("\\-", "-").contains(&page), "{page}: {text}");
        // Where there is groff, it has nothing to complain of.
        if let Ok(output) = Command::new("groff").args(["-man", "-Tutf8", "-ww", "-z"]).arg(&path).output() {
            assert_eq!(
                (output.status.success(), String::from_utf8_lossy(&output.stderr).as_ref()),
                (true, ""),
                "{page}"
            );
        }
    }
    let whole = ferrostep(["man"]);
    assert_eq!(
        (whole.status, whole.stdout),
        (Some(0), fs::read_to_string(directory.path().join("ferrostep.1")).unwrap())
    );
    let missing = ferrostep(["man".as_ref(), "-o".as_ref(), directory.path().join("none").as_os_str()]);
    assert_eq!(missing.status, Some(2), "{missing:#?}");
    assert!(missing.stderr.contains("no such folder: create it"), "{missing:#?}");
}
