//! Counts the instructions of the image's critical sections in a short print: the
//! longest of each place.
//!
//! The emulator logs every instruction that it executes. A section begins where the priority is
//! raised to RTIC's 15, and ends where it is restored. Only the step interrupt can come in between;
//! its instructions are not counted. Takes some minutes.
//!
//! ```text
//! cargo xtask critical-sections IMAGE
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::thread;

use ferrostep_image_code::code::{Code, Instruction, constant};

/// The emulator, to be installed by hand. Version 7.2 is known to work.
const EMULATOR: &str = "qemu-system-arm";

/// TIM2's number (RM0090, table 61).
const STEP_TIMER: u32 = 28;

/// The step interrupt's handler while M798 measures.
const MEASURED: &str = "step_interrupt_measured";

/// BASEPRI in a critical section.
const SECTION: u32 = 0x10;

/// Waits, moves, reports of all lengths, and a log line each second, which M798 switches on.
const CONVERSATION: [&str; 16] = [
    "M798 S1",
    "M155 S1",
    "M302 P1",
    "G28",
    "G1 X20 Y10 F6000",
    "G1 X40 Y30 E1",
    "G1 X10 Y30 E2",
    "G3 X30 Y30 I10 J0",
    "G1 E1 F1800",
    "M400",
    "M797",
    "M798",
    "M115",
    "M119",
    "M105",
    "G4 S2",
];

/// The arguments, but for the image: one instruction a log line, on the standard error output.
const ARGUMENTS: &str = "-machine netduinoplus2 -icount shift=6 -global stm32f2xx-timer.clock-frequency=16000000 \
                         -display none -monitor none -serial stdio -singlestep -d exec,nochain -kernel";

/// The meaning of instructions for the count.
struct Places {
    /// Addresses at which critical sections begin.
    sections: BTreeSet<u32>,
    /// Addresses at which the priority is raised, for a section or a lock.
    raised: BTreeSet<u32>,
    /// Addresses at which the priority is restored.
    restored: BTreeSet<u32>,
    /// The step interrupt's first instructions, and each one's last.
    step_interrupt: BTreeMap<u32, BTreeSet<u32>>,
    /// First instructions of all other handlers.
    handlers: BTreeSet<u32>,
}

impl Places {
    fn of(code: &Code) -> Result<Self, String> {
        let all = code.instructions()?;
        let function = |address: u32| {
            let start = code.function_start(address);
            let (first, end) = (
                all.partition_point(|instruction| Some(instruction.address) < start),
                all.partition_point(|instruction| code.function_start(instruction.address) <= start),
            );
            all.get(first..end).unwrap_or_default()
        };
        let written = |register: &str| -> Vec<&Instruction> {
            all.iter().filter(|instruction| instruction.written_register() == Some(register)).collect()
        };
        let is_section = |raised: &&Instruction| {
            let before = function(raised.address);
            let before = before.iter().take_while(|instruction| instruction.address < raised.address).cloned();
            let register = raised.operands.rsplit(' ').next().unwrap_or_default();
            constant(&before.collect::<Vec<_>>(), register) == Some(SECTION)
        };
        let raised = written("basepri_max");
        let entries = [vec![code.handler(STEP_TIMER)?], code.functions_named(MEASURED)].concat();
        let returns = |entry: u32| {
            let pops = |instruction: &&Instruction| instruction.name == "pop" && instruction.operands.contains("pc");
            function(entry).iter().filter(pops).map(|instruction| instruction.address).collect()
        };
        Ok(Self {
            sections: raised.iter().filter(|raised| is_section(raised)).map(|raised| raised.address).collect(),
            raised: raised.iter().map(|raised| raised.address).collect(),
            restored: written("basepri").iter().map(|restored| restored.address).collect(),
            handlers: code.handlers(),
            step_interrupt: entries.into_iter().map(|entry| (entry, returns(entry))).collect(),
        })
    }
}

/// A critical section's place.
#[derive(Clone, Copy, Debug, Default)]
struct Site {
    times: u64,
    longest: u64,
}

/// Counts along the instructions that are executed.
struct Counter {
    places: Places,
    sites: BTreeMap<u32, Site>,
    /// Returns of the step interrupt that is being executed.
    interrupted_until: Option<BTreeSet<u32>>,
    previous: u32,
    executed: u64,
    /// Start of the present section, instructions before it, and depth to which locks and
    /// sections are nested.
    section: Option<(u32, u64, u32)>,
}

impl Counter {
    fn execute(&mut self, address: u32) {
        if let Some(returns) = &self.interrupted_until {
            if returns.contains(&address) {
                self.interrupted_until = None;
            }
            return;
        }
        if let Some(returns) = self.places.step_interrupt.get(&address) {
            self.interrupted_until = Some(returns.clone());
            return;
        }
        if address == self.previous {
            // The step interrupt came before it was executed; the log repeats it.
            return;
        }
        if self.section.is_some() && self.places.handlers.contains(&address) {
            // Another interrupt can only have come before the priority was raised; the log
            // repeats that as well.
            self.section = None;
        }
        self.previous = address;
        self.executed += 1;
        let Some((begin, before, depth)) = &mut self.section else {
            if self.places.sections.contains(&address) {
                self.section = Some((address, self.executed, 1));
            }
            return;
        };
        if self.places.raised.contains(&address) {
            *depth += 1;
        } else if self.places.restored.contains(&address) {
            *depth -= 1;
            if *depth == 0 {
                let site = self.sites.entry(*begin).or_default();
                site.times += 1;
                site.longest = site.longest.max(self.executed - *before);
                self.section = None;
            }
        }
    }
}

/// Sends the conversation's lines, one after each `ok`, then ends the emulator.
fn converse(mut input: ChildStdin, output: ChildStdout) {
    let mut lines = CONVERSATION.iter();
    for reply in BufReader::new(output).lines().map_while(Result::ok) {
        if reply.trim_end() == "start" || reply.starts_with("ok") {
            let Some(line) = lines.next() else { return };
            if writeln!(input, "{line}").and_then(|()| input.flush()).is_err() {
                return;
            }
        }
    }
}

fn emulate(image: &Path) -> std::io::Result<Child> {
    let mut emulator = Command::new(EMULATOR);
    emulator.args(ARGUMENTS.split_whitespace()).arg(image);
    emulator.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()
}

/// Arguments of `critical-sections`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The image, whose path `cargo xtask firmware` prints
    image: PathBuf,
}

/// Prints the longest of each section.
///
/// # Errors
/// The image cannot be read, or the emulator does not run.
pub fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    let code = Code::of(&options.image)?;
    let mut counter = Counter {
        places: Places::of(&code)?,
        sites: BTreeMap::new(),
        interrupted_until: None,
        previous: 0,
        executed: 0,
        section: None,
    };
    let mut emulator = emulate(&options.image).map_err(|error| format!("{EMULATOR}: {error}"))?;
    let (Some(input), Some(output), Some(trace)) =
        (emulator.stdin.take(), emulator.stdout.take(), emulator.stderr.take())
    else {
        return Err("the emulator has no pipes".into());
    };
    let conversation = thread::spawn(move || converse(input, output));
    let mut line = Vec::new();
    let mut trace = BufReader::with_capacity(1 << 20, trace);
    while !conversation.is_finished() && trace.read_until(b'\n', &mut line)? > 0 {
        // `Trace 0: 0x7f... [00000000/08000e0c/...] name`
        let fields = String::from_utf8_lossy(&line);
        let address = fields.strip_prefix("Trace").and_then(|rest| rest.split('/').nth(1));
        if let Some(address) = address.and_then(|digits| u32::from_str_radix(digits, 16).ok()) {
            counter.execute(address);
        }
        line.clear();
    }
    emulator.kill()?;
    emulator.wait()?;
    let mut sites: Vec<_> = counter.sites.into_iter().collect();
    sites.sort_by_key(|(_, site)| std::cmp::Reverse(site.longest));
    println!("{} instructions; longest of each critical section, how often, where:", counter.executed);
    for (address, Site { times, longest }) in sites {
        println!("{longest:8} {times:8} {address:#010x} {}", code.function(address));
    }
    Ok(())
}
