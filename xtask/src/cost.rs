//! Processor time of the programs that a step runs.
//!
//! A step's seconds depend on the computer's other work. The seconds that its programs spend on a
//! core depend on it much less, and divided by those of a fixed loop, [`calibration_s`], they
//! hardly depend on the computer.

use std::cell::Cell;
use std::process::{Child, ExitStatus};
use std::sync::OnceLock;
use std::time::Instant;

thread_local! {
    static SPENT_S: Cell<f64> = const { Cell::new(0.0) };
}

/// Core-seconds that programs started by this thread have spent so far.
pub fn spent_s() -> f64 {
    SPENT_S.get()
}

/// Adds the time that programs of another thread, which works for this one, have spent.
pub fn add(seconds: f64) {
    SPENT_S.set(SPENT_S.get() + seconds);
}

/// Waits for a program and adds the time that it and its own programs have spent.
///
/// # Errors
/// The system cannot wait for it.
pub fn wait(mut child: Child) -> std::io::Result<ExitStatus> {
    #[cfg(target_os = "linux")]
    {
        use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};
        // The system keeps an ended program's times until its end is taken.
        if let Some(id) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
            waitid(WaitId::Pid(id), WaitIdOptions::EXITED | WaitIdOptions::NOWAIT)?;
            let times = std::fs::read_to_string(format!("/proc/{}/stat", child.id()))?;
            add(core_seconds(&times).unwrap_or_default());
        }
    }
    child.wait()
}

/// Core-seconds in a line of `/proc/PID/stat`: of the program (utime, stime) and its ended children
/// (cutime, cstime), in hundredths of a second (proc(5), fields 14 to 17).
fn core_seconds(stat: &str) -> Option<f64> {
    // Field 2 is the program's name in brackets, which may contain blanks.
    let (_, after_name) = stat.rsplit_once(')')?;
    let times: Vec<u64> =
        after_name.split_whitespace().skip(11).take(4).map_while(|field| field.parse().ok()).collect();
    (times.len() == 4).then(|| times.iter().sum::<u64>() as f64 / 100.0)
}

/// Core-seconds of a fixed piece of arithmetic on this computer: the unit in which a
/// step's cost is kept.
pub fn calibration_s() -> f64 {
    let start = own_s();
    let mut value = 1_u64;
    for step in 0..1_000_000_000_u64 {
        value = value.rotate_left(5) ^ step.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    std::hint::black_box(value);
    own_s() - start
}

/// Core-seconds of this thread; elapsed ones if the system does not report them.
fn own_s() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    let elapsed_s = || START.get_or_init(Instant::now).elapsed().as_secs_f64();
    std::fs::read_to_string("/proc/thread-self/stat")
        .ok()
        .and_then(|stat| core_seconds(&stat))
        .unwrap_or_else(elapsed_s)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn times_of_a_program_and_its_children_are_added() {
        let line = "4242 (a (strange) name) Z 1 2 3 4 5 6 7 8 9 10 150 50 1000 300 20 0 1 0 0";
        assert_eq!(core_seconds(line), Some(15.0));
        assert_eq!(core_seconds("4242 (cut) Z 1 2"), None);
        assert_eq!(core_seconds(""), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_program_that_computes_costs_time() {
        let before = spent_s();
        let mut program = std::process::Command::new("sh");
        program.args(["-c", "i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done"]);
        assert!(wait(program.spawn().unwrap()).unwrap().success());
        assert!(spent_s() > before, "{} {before}", spent_s());
    }
}
