//! The virtual mainboard: it prints with the boards' images, counts for the bench, and is
//! served to hosts.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use crate::firmware::{self, Shown, Target};
use crate::share::Share;
use crate::steps::{Failure, Run};
use crate::system::{self, cargo};

/// Arguments of `mainboard`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The board: bench, prusa-buddy, btt-octopus-1.1 or the path of a TOML file
    #[arg(long, default_value = "prusa-buddy")]
    board: String,
    /// The machine: cartesian, corexy, prusa-mini or the path of a TOML file; the
    /// board's own by default
    #[arg(long)]
    profile: Option<String>,
    /// The G-code to print; without a file the image and the program are only built
    file: Option<PathBuf>,
    /// The port that the host uses: "usb" or "uart"
    #[arg(long, default_value = "usb")]
    via: String,
    /// Prints only this many layers, as the slicer's comments count them
    #[arg(long)]
    layers: Option<usize>,
    /// Prints one JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Serves the printer's port on a pseudo-terminal with this path, for any host
    #[arg(long, value_name = "PATH", conflicts_with_all = ["file", "tcp", "json"])]
    pty: Option<PathBuf>,
    /// Serves the printer's port on a TCP port of this computer
    #[arg(long, value_name = "PORT", conflicts_with_all = ["file", "json"])]
    tcp: Option<u16>,
    /// Only builds the program, and prints its path
    #[arg(long, conflicts_with_all = ["file", "pty", "tcp", "json", "prints"])]
    program: bool,
    /// Prints the first layers of a cube by the image of every board, as
    /// `cargo xtask firmware` has left them
    #[arg(long, conflicts_with_all = ["file", "pty", "tcp", "json"])]
    prints: bool,
    /// Share of the boards for --prints: 0 to 19, or all
    #[arg(long, value_name = "K|all", default_value_t = Share::All, requires = "prints")]
    share: Share,
    /// More arguments for the program, such as --gdb 3333 or --entry-ns 173
    #[arg(last = true)]
    more: Vec<String>,
}

/// Boards whose images print in turn, with the line that each prints over: each line once at least.
/// The bench has neither sensors nor drivers.
const PRINTS: [(&str, &str); 3] = [("prusa-buddy", "usb"), ("btt-octopus-1.1", "uart"), ("bench", "uart")];
const PRINTED: &str = "examples/cube.gcode";
const LAYERS: usize = 2;

/// The package of the virtual mainboard.
pub const PACKAGE: &str = "ferrostep-mainboard";

/// Builds the program and returns its path.
pub fn build(run: &mut Run) -> Result<PathBuf, Failure> {
    run.step("virtual mainboard: build", || {
        // Built together with this program: alone it would be compiled with other features of what
        // both use, and once more.
        system::run(cargo().args(["build", "--package", PACKAGE, "--package", env!("CARGO_PKG_NAME")]))?;
        // A separate build, since this program needs other features.
        system::run(cargo().args(["build", "--package", "ferrostep-mainboard-log"]))
    })?;
    Ok(system::target_directory().join("debug").join(PACKAGE))
}

/// Instructions a second of the bench's own programs: one for every two ticks of their timers on
/// the chip's internal oscillator of 16 MHz, with which it leaves reset (RM0090, 7.2.2). An
/// instruction then takes 125 ns; at one a tick it would take 62.5, and the virtual mainboard,
/// whose time is in whole nanoseconds, would read every other count one too low.
const INSTRUCTIONS_PER_SECOND: u32 = 8_000_000;

/// Cycles a second of a core at full speed: its counter of cycles then counts instructions.
const CORE_HZ: u32 = 168_000_000;

/// The counter that a program of the bench reads.
#[derive(Clone, Copy, Debug)]
pub enum Counter {
    /// A timer, on the clock after reset.
    Timer,
    /// The core's counter of cycles, on the clock of the firmware.
    Core,
}

/// The command that runs a program of the bench, which counts instructions and reports by
/// semihosting; its files are in `folder`.
pub fn counting(
    program: &Path,
    image: &Path,
    counter: Counter,
    folder: &Path,
    arguments: &str,
) -> Result<Command, Failure> {
    let machine = Machine::new(program, ferrostep_boards::DEFAULT, None, image)?;
    let mut command = machine.command("count");
    let hz = match counter {
        Counter::Timer => INSTRUCTIONS_PER_SECOND,
        Counter::Core => CORE_HZ,
    };
    command.arg("--instructions-per-second").arg(hz.to_string());
    command.arg("--folder").arg(folder).arg("--arguments").arg(arguments);
    Ok(command)
}

/// Standard output of a program that must end by itself, successfully.
pub fn output_of(command: &mut Command) -> Result<String, Failure> {
    let output = command.output().map_err(|error| format!("cannot run {:?}: {error}", command.get_program()))?;
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    if output.status.success() {
        return Ok(said);
    }
    let why = String::from_utf8_lossy(&output.stderr);
    Err(format!("the image failed: {}; its output was:\n{said}{why}", output.status))
}

/// `cargo xtask mainboard`.
pub fn run(run: &mut Run, options: &Options) -> Result<(), Failure> {
    if options.prints {
        return prints(run, options.share);
    }
    if options.program {
        return build(run).map(|program| println!("{}", program.display()));
    }
    let target = Target::new(&options.board, options.profile.as_deref())?;
    let program = build(run)?;
    let image = firmware::build_image(run, &target, Shown::beside_json(options.json))?;
    let machine = Machine::new(&program, &options.board, options.profile.as_deref(), &image.path)?;
    if options.pty.is_some() || options.tcp.is_some() {
        return run.step("serve", || {
            let mut command = machine.command("serve");
            command.args(["--via", &options.via]).args(&options.more);
            options.pty.iter().for_each(|path| {
                command.arg("--pty").arg(path);
            });
            options.tcp.iter().for_each(|port| {
                command.args(["--tcp", &port.to_string()]);
            });
            system::run(&mut command)
        });
    }
    let Some(file) = &options.file else {
        if options.json {
            println!("{:#}", image.json());
        }
        return Ok(());
    };
    run.step("print", || {
        let job = machine.prepare(file, options.layers, &options.via)?;
        let mut command = machine.print(&job, &options.via);
        if options.json {
            command.arg("--json");
        }
        system::run(command.args(&options.more))
    })
}

/// Prints the first layers of the cube on each board of a share.
fn prints(run: &mut Run, share: Share) -> Result<(), Failure> {
    let program = build(run)?;
    run.step("virtual mainboard: the images print", || {
        let boards = PRINTS.len() as u64;
        let of_share = (0..).zip(&PRINTS).filter(|(number, _)| share.has(*number, boards)).map(|(_, print)| print);
        // Two at a time: each runs on one core, and some take twice as long as others.
        let left = Mutex::new(of_share);
        let next = || left.lock().ok()?.next();
        let prints = || -> Vec<Failure> {
            std::iter::from_fn(next).filter_map(|(board, via)| print(&program, board, via).err()).collect()
        };
        let failures: Vec<Failure> = std::thread::scope(|scope| {
            let both = [scope.spawn(prints), scope.spawn(prints)];
            let each = both.map(|prints| prints.join().unwrap_or_else(|_| vec!["a print panicked".to_owned()]));
            each.into_iter().flatten().collect()
        });
        if failures.is_empty() { Ok(()) } else { Err(failures.join("\n")) }
    })
}

fn print(program: &Path, board: &str, via: &str) -> Result<(), Failure> {
    let image = crate::image::images().join(board).join("ferrostep.elf");
    let machine = Machine::new(program, board, None, &image)?;
    let job = machine.prepare(Path::new(PRINTED), Some(LAYERS), via)?;
    let output = machine.print(&job, via).output().map_err(|error| format!("{}: {error}", program.display()))?;
    let said = String::from_utf8_lossy(&output.stdout);
    eprintln!("--- {board} over {via}\n{said}");
    if output.status.success() {
        return Ok(());
    }
    Err(format!("{board} over {via}: {}\n{said}{}", output.status, String::from_utf8_lossy(&output.stderr)))
}

/// The program with a board, a printer and an image.
struct Machine<'a> {
    program: &'a Path,
    board: PathBuf,
    profile: PathBuf,
    image: &'a Path,
}

/// Job that is printed, and the desk's trace of it.
struct Job {
    file: PathBuf,
    trace: PathBuf,
}

impl<'a> Machine<'a> {
    fn new(program: &'a Path, board: &str, profile: Option<&str>, image: &'a Path) -> Result<Self, Failure> {
        let loaded = ferrostep_boards::load(board).map_err(|error| error.to_string())?;
        let file = |folder: &str, name: &str| {
            let built_in = system::root().join(folder).join(format!("{name}.toml"));
            if built_in.exists() { built_in } else { PathBuf::from(name) }
        };
        Ok(Self {
            program,
            board: file("config/boards", board),
            profile: file("config/profiles", profile.unwrap_or(&loaded.profile)),
            image,
        })
    }

    fn command(&self, what: &str) -> Command {
        let mut command = Command::new(self.program);
        command.arg(what).arg("--board").arg(&self.board).arg("--profile").arg(&self.profile);
        command.arg("--image").arg(self.image);
        command
    }

    fn print(&self, job: &Job, via: &str) -> Command {
        let mut command = self.command("print");
        command.args(["--via", via, "--desk-trace"]).arg(&job.trace).arg(&job.file);
        command
    }

    /// The file, cut to its first layers if that is asked for, and the desk's trace. Jobs over
    /// other lines have other files.
    fn prepare(&self, file: &Path, layers: Option<usize>, via: &str) -> Result<Job, Failure> {
        let folder = system::target_directory().join("mainboard");
        std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = format!("{}-{}-{via}", stem(&self.profile), stem(file));
        let file = match layers {
            None => file.to_owned(),
            Some(layers) => {
                let text = std::fs::read_to_string(system::root().join(file))
                    .map_err(|error| format!("{}: {error}", file.display()))?;
                let cut = folder.join(format!("{name}-{layers}-layers.gcode"));
                std::fs::write(&cut, first_layers(&text, layers))
                    .map_err(|error| format!("{}: {error}", cut.display()))?;
                cut
            }
        };
        let trace = folder.join(format!("{name}.trace"));
        let mut desk = cargo();
        // The desk's program is the tests' build: no link-time optimisation.
        desk.args(["run", "--package", "ferrostep", "--profile", "test", "--quiet", "--", "print"])
            .arg(&file)
            .arg("--profile")
            .arg(&self.profile);
        desk.arg("--trace").arg(&trace).arg("--json");
        let output = desk.output().map_err(|error| format!("cannot run cargo: {error}"))?;
        if !output.status.success() {
            return Err(format!("the desk: {}", String::from_utf8_lossy(&output.stderr)));
        }
        Ok(Job { file, trace })
    }
}

/// The lines of the first layers. Slicers mark the beginning of a layer by one of two comments.
fn first_layers(text: &str, layers: usize) -> String {
    let mut begun = 0;
    let wanted = text.lines().take_while(|line| {
        begun += usize::from(line.starts_with(";LAYER_CHANGE") || line.starts_with(";LAYER:"));
        begun <= layers
    });
    wanted.flat_map(|line| [line, "\n"]).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_cut_after_its_layers() {
        let text = "G28\n;LAYER_CHANGE\nG1 X1\n;LAYER_CHANGE\nG1 X2\n;LAYER_CHANGE\nG1 X3\n";
        assert_eq!(first_layers(text, 2), "G28\n;LAYER_CHANGE\nG1 X1\n;LAYER_CHANGE\nG1 X2\n");
        assert_eq!(first_layers(text, 9), text);
    }

    #[test]
    fn a_program_must_end_in_success() {
        assert_eq!(output_of(Command::new("echo").arg("{}")).unwrap(), "{}\n");
        assert!(output_of(&mut Command::new("false")).unwrap_err().contains("failed"));
    }

    #[test]
    fn a_program_gets_its_arguments_and_its_rate() {
        let [program, image] = ["program", "image"].map(Path::new);
        let command = counting(program, image, Counter::Timer, Path::new("files"), "run_addr 134234733").unwrap();
        let words: Vec<&str> = command.get_args().map(|word| word.to_str().unwrap()).collect();
        for pair in
            [["--instructions-per-second", "8000000"], ["--arguments", "run_addr 134234733"], ["--folder", "files"]]
        {
            assert!(words.windows(2).any(|two| two == pair), "{words:?}");
        }
    }
}
