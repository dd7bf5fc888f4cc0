//! Completions and manual pages as others read them: bash completes by its script, groff has
//! nothing to complain of.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::io::Write;
use std::process::{Command, Stdio};

use ferrostep_testkit::program::{program, scratch};

/// bash reads its script, and completes a word by it.
#[test]
fn bash_completes_by_its_script() {
    let script = Command::new(program()).args(["completions", "bash"]).output().unwrap().stdout;
    let mut bash = Command::new("bash")
        .arg("-n")
        .stdin(Stdio::piped())
        .spawn()
        .expect("bash is missing: install it (Debian: apt-get install bash)");
    bash.stdin.take().unwrap().write_all(&script).unwrap();
    assert!(bash.wait().unwrap().success());
    let script = String::from_utf8(script).unwrap();
    let asked = format!(
        "{script}\nCOMP_WORDS=(ferrostep pri); COMP_CWORD=1; _ferrostep ferrostep pri ferrostep; echo \"${{COMPREPLY[*]}}\"\n\
         COMP_WORDS=(ferrostep print --pro); COMP_CWORD=2; _ferrostep ferrostep --pro print; echo \"${{COMPREPLY[*]}}\"\n"
    );
    let output = Command::new("bash").args(["--norc", "-c", &asked]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), "print\n--profile\n", "{output:?}");
}

#[test]
fn groff_takes_every_manual_page() {
    let folder = scratch();
    assert!(Command::new(program()).args(["man", "-o"]).arg(folder.path()).status().unwrap().success());
    let pages: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(pages.len() > 10, "{pages:?}");
    for page in pages {
        let groff = Command::new("groff").args(["-man", "-Tutf8", "-ww", "-z"]).arg(&page).output();
        let output = groff.expect("groff is missing: install it (Debian: apt-get install groff)");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.success(), said.as_ref()), (true, ""), "{}", page.display());
    }
}
