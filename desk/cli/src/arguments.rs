//! The command line.

mod calibrate;
mod simulate;

#[cfg(unix)]
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Parser, Subcommand};
use ferrostep_analysis::sweep::Values;
use ferrostep_host::printer_line::Address;
use ferrostep_import::Url;
use ferrostep_papers::tables::Paper;
#[cfg(unix)]
use ferrostep_session::serve::{Fault, Speed};

use crate::comparing::key_and_value;
use crate::sweeping::key_and_values;
use crate::waveform::{Edge, edge};

pub use calibrate::{
    CalibrateAdvanceArguments, CalibrateFlowArguments, CalibrateShaperArguments, CalibrateSpeedArguments, Calibration,
    HeatArguments, TriedArgument,
};
pub use simulate::{Rules, SimulateArguments};

/// Rehearses 3D prints on the desk, with the motion code that runs on the board.
#[derive(Parser)]
#[command(version = ferrostep_session::VERSION, about = "Rehearses 3D prints on the desk, with the motion code that runs on the board")]
pub struct Arguments {
    /// The subcommand.
    #[command(subcommand)]
    pub command: Command,
}

impl Command {
    /// The plate that it names.
    pub fn plate(&self) -> Option<u32> {
        let argument = match self {
            Self::Print { job, .. } | Self::Preprocess { job, .. } | Self::Estimate { job, .. } => &job.plate,
            Self::Send(arguments) => &arguments.plate,
            Self::Sweep(arguments) => &arguments.plate,
            Self::Show(arguments) => &arguments.plate,
            Self::Compare(arguments) => &arguments.plate,
            Self::Simulate(arguments) => &arguments.plate,
            _ => return None,
        };
        argument.plate
    }
}

/// The subcommands.
#[derive(Subcommand)]
pub enum Command {
    /// Prints a file on the virtual board: executes the whole job, makes every step, and stops at a line the printer would refuse.
    Print {
        #[command(flatten)]
        job: JobArguments,
        /// How many blocks the planner sees ahead [default: 128, as on the board; 65536 for a prepared job].
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_048_576))]
        look_ahead: Option<u32>,
        /// Starts a prepared job in its middle, at frame N, as after a power cut: heats, assumes that the nozzle is at the height of
        /// the frame, homes X and Y only, moves to the start of the frame, and prints from there. `inspect --entries` lists the
        /// possible frames.
        #[arg(long, value_name = "N")]
        from_frame: Option<u32>,
        /// Writes every step with its time to a file (format: the book, "The trace").
        #[arg(long, value_name = "OUT")]
        trace: Option<PathBuf>,
        /// Writes the step and direction signals as a waveform, for GTKWave or PulseView. A whole print is large.
        #[arg(long, value_name = "OUT")]
        vcd: Option<PathBuf>,
        /// Begins the waveform here: seconds of motion (12.5; waits for heat left out), a line (line:120) or a layer (layer:3).
        #[arg(long, value_name = "SECONDS|line:N|layer:N", requires = "vcd", value_parser = edge)]
        from: Option<Edge>,
        /// Ends the waveform here, after the motion of the line or the layer.
        #[arg(long, value_name = "SECONDS|line:N|layer:N", requires = "vcd", value_parser = edge)]
        to: Option<Edge>,
    },
    /// Plans the speeds of a file on this computer and writes a prepared job (.gpre), which a board only has to execute.
    Preprocess {
        #[command(flatten)]
        job: JobArguments,
        /// The file to write.
        #[arg(short, value_name = "OUT.gpre")]
        out: PathBuf,
        /// How the job is encoded.
        #[arg(long, value_enum, default_value_t = Format::Compact)]
        format: Format,
    },
    /// Shows what is in a prepared job: its header and where its frames begin.
    Inspect {
        /// The prepared job.
        file: PathBuf,
        /// Lists every move and command, not only the frames.
        #[arg(long)]
        items: bool,
        /// Lists only the frames at which `print --from-frame` can start.
        #[arg(long, conflicts_with = "items")]
        entries: bool,
    },
    /// Sends a file to a printer: G-code line by line, a prepared job as it is, which the board executes while it arrives.
    Send(SendArguments),
    /// Fetches a printer's black box (M791), or reads a saved one: the last commands, temperatures, driver events and halts before a stop
    /// or a reset, and the last steps, played again.
    Blackbox(BlackBoxArguments),
    /// Lists the serial ports of this computer, with the numbers and names of what is on USB.
    Ports,
    /// Serves a virtual printer that hosts such as OctoPrint connect to. With --board it is the image of a board, as it would be
    /// flashed, on an emulated chip (`cargo xtask mainboard` builds it); otherwise the board's parts in this program.
    #[cfg(unix)]
    Serve(ServeArguments),
    /// Estimates the time and the material that a file takes, without making its steps.
    Estimate {
        #[command(flatten)]
        job: JobArguments,
        /// Estimates with these error budgets in place of the profile's, mm, and shows the accelerations that follow: a range, each value
        /// twice the one before (0.015..0.06), or a list.
        #[arg(long, value_name = "VALUES", conflicts_with = "strict")]
        error_budget: Option<Values>,
        /// Simulates the error with each budget, too: on the profile's frame as it was measured, and as soft and as stiff as it may be.
        #[arg(long, requires = "error_budget")]
        simulate: bool,
    },
    /// Estimates a file's time with other values of the profile's keys: what a higher acceleration would gain, for one.
    Sweep(SweepArguments),
    /// Shows a print as it is executed: prints it on the virtual board and writes one HTML page with the path in 3D, coloured by speed,
    /// flow, pressure and more, with findings and charts; opens it in the browser.
    Show(ShowArguments),
    /// Prints two files, or one with two profiles, on the virtual board and compares time, speed, flow and error, with both prints on one
    /// HTML page.
    Compare(CompareArguments),
    /// Measures what the steps of a file, or of a trace, do to a frame that rings and to a nozzle under pressure: contour error,
    /// ringing, misplaced material, true acceleration.
    Simulate(Box<SimulateArguments>),
    /// Turns measurements of a printer into keys of its profile.
    Calibrate {
        /// What is measured.
        #[command(subcommand)]
        calibration: Calibration,
    },
    /// Computes the tables and figures of the papers behind the motion code again, beside ours; of all papers if none is named.
    Papers {
        /// The paper.
        #[arg(value_enum)]
        paper: Option<PaperName>,
        /// Prints one JSON object.
        #[arg(long)]
        json: bool,
        /// Draws the figures into this folder.
        #[arg(long, value_name = "DIR")]
        svg: Option<PathBuf>,
        /// Prints this file with every combination of interpolation and acceleration instead, and compares them.
        #[arg(long, value_name = "FILE", conflicts_with_all = ["paper", "svg"])]
        compare: Option<PathBuf>,
        /// The machine to compare on: cartesian, corexy, prusa-mini, or the path of a TOML file.
        #[arg(long, value_name = "NAME|PATH", default_value = "cartesian", requires = "compare")]
        profile: String,
    },
    /// Makes a profile of another firmware's configuration (Klipper's printer.cfg, Marlin's Configuration.h) and lists what it keeps of
    /// each setting, and why not.
    Import {
        /// The configuration; files that it includes, and Configuration_adv.h, are looked for beside it.
        #[arg(required_unless_present_any = ["moonraker", "marlin"], conflicts_with = "moonraker")]
        file: Option<PathBuf>,
        /// Asks a running Klipper for its configuration, by its server Moonraker: http://HOST or http://HOST:PORT.
        #[arg(long, value_name = "URL", conflicts_with = "marlin")]
        moonraker: Option<Url>,
        /// Asks a running Marlin for its settings (M115, M503) at a serial port or tcp:HOST:PORT. They hold over those of FILE, its
        /// Configuration.h, which says what a printer does not tell.
        #[arg(long, value_name = "PATH|tcp:HOST:PORT")]
        marlin: Option<Address>,
        /// Speed of the port; without effect over USB.
        #[arg(long, value_name = "BAUD", default_value_t = 115_200, requires = "marlin")]
        baud: u32,
        /// The profile to write; without it only the list is printed.
        #[arg(short, value_name = "PROFILE.toml")]
        out: Option<PathBuf>,
        /// Prints profile, list and assumed values as one JSON object.
        #[arg(long)]
        json: bool,
        /// Lists each setting that is not kept and each value that the file does not say, instead of their numbers.
        #[arg(long)]
        all: bool,
        /// Lets the built-in profile cartesian stand in for what the machine is and the file does not say, such as steps, end stops and
        /// sensors; the exit status is then 3.
        #[arg(long)]
        assume: bool,
    },
    /// Prints the script by which a shell completes this command's words.
    Completions {
        /// The shell.
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
    /// Prints the manual page, or writes a page for each subcommand into a folder.
    Man {
        /// The folder, which must exist.
        #[arg(short, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

/// The plate of a sliced 3MF.
#[derive(clap::Args)]
pub struct PlateArgument {
    /// The plate of a sliced 3MF (.gcode.3mf) that holds several.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub plate: Option<u32>,
}

/// Arguments of `show`.
#[derive(clap::Args)]
pub struct ShowArguments {
    /// The job: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF, or a prepared job; - is standard input.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The page to write [default: the file's name with .html, in this folder].
    #[arg(short, value_name = "PAGE.html")]
    pub out: Option<PathBuf>,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// Does not open the page.
    #[arg(long)]
    pub no_open: bool,
}

/// Arguments of `compare`.
#[derive(clap::Args)]
pub struct CompareArguments {
    /// The first job, A: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF.
    #[arg(value_name = "A")]
    pub file: PathBuf,
    /// The second job, B [default: the first, with another profile or --set].
    #[arg(value_name = "B")]
    pub second: Option<PathBuf>,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// Writes a page with both prints.
    #[arg(short, value_name = "PAGE.html")]
    pub out: Option<PathBuf>,
    /// The machine of both: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// The machine of A.
    #[arg(long, value_name = "NAME|PATH")]
    pub profile_a: Option<String>,
    /// The machine of B.
    #[arg(long, value_name = "NAME|PATH")]
    pub profile_b: Option<String>,
    /// Gives a key of B's profile this value: junction_deviation_mm=0.02. The jobs' own commands that would hold over it are left out of
    /// both. Can be repeated.
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    pub set: Vec<(String, f64)>,
    /// Frequency of the frame in X, 1 to 1000 Hz: measures the contour error, too [default: that of Y].
    #[arg(long, value_name = "HZ")]
    pub frequency_x: Option<f64>,
    /// Frequency of the frame in Y [default: that of X].
    #[arg(long, value_name = "HZ")]
    pub frequency_y: Option<f64>,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Does not open the page.
    #[arg(long)]
    pub no_open: bool,
}

/// Arguments of `send`.
#[derive(clap::Args)]
pub struct SendArguments {
    /// G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF, or a prepared job in the compact encoding; - is standard input.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The printer's serial port, or tcp:HOST:PORT [default: the only one on USB].
    #[arg(long, value_name = "PATH|tcp:HOST:PORT")]
    pub port: Option<Address>,
    /// Speed of the port; without effect over USB.
    #[arg(long, value_name = "BAUD", default_value_t = 115_200)]
    pub baud: u32,
    /// G-code to send line by line instead if the board refuses the prepared job.
    #[arg(long, value_name = "FILE")]
    pub fallback: Option<PathBuf>,
    /// Writes G-code to the printer's memory card under this name, 8 characters and 3 after the dot, instead of printing it.
    #[arg(long, value_name = "NAME", conflicts_with = "fallback")]
    pub to_card: Option<String>,
    /// The printer, as its profile describes it: cartesian, corexy, prusa-mini, or the path of a TOML file. The remaining time of
    /// G-code is estimated for it, instead of being the slicer's.
    #[arg(long, value_name = "NAME|PATH", conflicts_with = "to_card")]
    pub profile: Option<String>,
    /// Packs the lines of G-code into two thirds of their bytes, if the printer says that it knows MeatPack.
    #[arg(long)]
    pub meatpack: bool,
}

/// Arguments of `blackbox`.
#[derive(clap::Args)]
pub struct BlackBoxArguments {
    /// The printer's serial port, tcp:HOST:PORT, or a file: a saved black box, or a terminal's log with the answer to M791.
    #[arg(value_name = "PORT|FILE")]
    pub source: String,
    /// Saves the black box, to be read again by this command.
    #[arg(short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Speed of the port; without effect over USB.
    #[arg(long, value_name = "BAUD", default_value_t = 115_200)]
    pub baud: u32,
    /// The machine, if the profile that the printer names is not built in: the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH")]
    pub profile: Option<String>,
    /// Prints one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Writes the steps as a trace, which `simulate` reads; ticks count from the first of them.
    #[arg(long, value_name = "OUT")]
    pub trace: Option<PathBuf>,
    /// Tells the place in the source where a panic or a fault ended the firmware: the ferrostep.elf that was flashed.
    #[arg(long, value_name = "ELF")]
    pub image: Option<PathBuf>,
}

/// Arguments of `serve`.
#[cfg(unix)]
#[derive(clap::Args)]
pub struct ServeArguments {
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian", conflicts_with = "board")]
    pub profile: String,
    /// A board whose image is to run on an emulated chip: bench, prusa-buddy, btt-octopus-1.1, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH")]
    pub board: Option<String>,
    /// Which port of the board the host connects to.
    #[arg(long, value_enum, default_value_t = Via::Usb, requires = "board")]
    pub via: Via,
    /// Serves on a pseudo-terminal with this path, which the host opens as its serial port.
    #[arg(long, value_name = "PATH", required_unless_present_any = ["tcp", "web"], conflicts_with = "tcp")]
    pub pty: Option<PathBuf>,
    /// Serves on a TCP port of this computer; 0 takes a free one.
    #[arg(long, value_name = "PORT")]
    pub tcp: Option<u16>,
    /// Serves a page that shows the printer and controls it, for this computer's browsers, or for others at another address; its
    /// address with a secret token is printed at the start.
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8790", value_parser = web_address)]
    pub web: Option<SocketAddr>,
    /// Largest file that the page uploads, MiB.
    #[arg(long, value_name = "MIB", default_value_t = 256, value_parser = clap::value_parser!(u64).range(1..=65_536), requires = "web")]
    pub web_upload: u64,
    /// Puts the page in front of a printer at this port instead of a virtual one: its serial port, or tcp:HOST:PORT.
    #[arg(
        long,
        value_name = "PATH|tcp:HOST:PORT",
        requires = "web",
        conflicts_with_all = ["pty", "tcp", "board", "fault", "card", "settings", "json"]
    )]
    pub port: Option<Address>,
    /// Speed of the port; without effect over USB.
    #[arg(long, value_name = "BAUD", default_value_t = 115_200, requires = "port")]
    pub baud: u32,
    /// How many seconds of the printer pass in one second, or max; a slow computer falls behind and does not catch up.
    #[arg(long, value_name = "FACTOR|max", default_value = "1")]
    pub speed: Speed,
    /// Makes something fail, at once or at @SECONDS of the printer: nozzle-HOW or bed-HOW with HOW open, shorted,
    /// fell-out, frozen, dead or stuck-on; drop:RATE, flip:RATE (of the bytes), drop-line:RATE or flip-line:RATE (of the lines)
    /// with RATE such as 1%; card-pull, card-back; filament-out, filament-back; x-HOW, y-HOW or z-HOW with HOW
    /// never, always or works (the sensors of G28); pin-stays-in, pin-stays-out, pin-works (a BLTouch). Can be repeated.
    #[arg(long, value_name = "KIND[@SECONDS]", conflicts_with = "board")]
    pub fault: Vec<Fault>,
    /// The memory card in the printer's slot: an image (FAT16 or FAT32), which at the end contains the files that a host has
    /// written, or a folder, whose files are copied to a card; the folder stays unchanged.
    #[arg(long, value_name = "IMAGE|FOLDER", conflicts_with = "board")]
    pub card: Option<PathBuf>,
    /// The memory for settings (M500): a file, which is made if it does not exist. Without it the printer has none.
    #[arg(long, value_name = "FILE", conflicts_with = "board")]
    pub settings: Option<PathBuf>,
    /// Prints what the printer has done as one JSON object, as `print` does, when it is switched off with Ctrl-C.
    #[arg(long, conflicts_with = "board")]
    pub json: bool,
}

/// Arguments of `sweep`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("changed").args(["acceleration", "error_budget", "set"]).required(true))]
pub struct SweepArguments {
    /// The job: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// Accelerations of printing and travel moves, and the most that X and Y may have, mm/s^2: a range, each value twice the one
    /// before (500..16000), or a list (500,1000,3000).
    #[arg(long, value_name = "VALUES")]
    pub acceleration: Option<Values>,
    /// Error budgets, mm, from which the accelerations of X and Y follow: a range or a list, as above.
    #[arg(long, value_name = "VALUES")]
    pub error_budget: Option<Values>,
    /// Any other key of the profile that is a number, with its values: junction_deviation_mm=0.005..0.08. Given more than once, the
    /// keys change together.
    #[arg(long, value_name = "KEY=VALUES", value_parser = key_and_values)]
    pub set: Vec<(String, Values)>,
    /// Simulates the error with each value, too: on the profile's frame as it was measured, and as soft and as stiff as it may be.
    #[arg(long)]
    pub simulate: bool,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Draws the time over the values.
    #[arg(long, value_name = "OUT.svg")]
    pub plot: Option<PathBuf>,
}

/// The ports of a printer.
#[cfg(unix)]
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum Via {
    /// USB.
    Usb,
    /// The serial line.
    Uart,
}

#[cfg(unix)]
impl Via {
    /// Its name on the command line of the virtual mainboard.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Usb => "usb",
            Self::Uart => "uart",
        }
    }
}

/// The encodings of a prepared job.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum Format {
    /// About five bytes a move, with checksums.
    Compact,
    /// Packets of 84 bytes, as in Yu 2019; for comparison.
    Wide,
}

/// The papers by their short names.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum PaperName {
    /// Wu 2024: step Bresenham, velocity-adaptive extrusion.
    Wu,
    /// Yu 2019: planning on the computer, look-ahead.
    Yu,
    /// Three ways to lead CoreXY motors.
    Corexy,
    /// Li 2017: S-curve acceleration.
    Li,
}

impl From<PaperName> for Paper {
    fn from(name: PaperName) -> Self {
        match name {
            PaperName::Wu => Self::Wu,
            PaperName::Yu => Self::Yu,
            PaperName::Corexy => Self::CoreXy,
            PaperName::Li => Self::Li,
        }
    }
}

/// Arguments that `print`, `preprocess` and `estimate` share.
#[derive(clap::Args)]
pub struct JobArguments {
    /// The job: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF; `print` also takes a prepared job; - is standard input.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Ends with exit status 1 if there are remarks: lines without effect, or executed differently from their text, moves before
    /// homing or outside the travel, pauses, too much flow, heaters left on.
    #[arg(long)]
    pub strict: bool,
}

/// The address of a page's server.
#[cfg(unix)]
fn web_address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| "write an address of this computer with a port, such as 127.0.0.1:8790".to_owned())
}
