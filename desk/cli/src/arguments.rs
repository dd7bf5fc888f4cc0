//! The command line.

mod calibrate;
mod compare;
mod job;
mod papers;
mod post_process;
mod send;
#[cfg(unix)]
mod serve;
mod simulate;
mod values;

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use ferrostep_analysis::sweep::Values;
use ferrostep_host::printer_line::Address;
use ferrostep_import::{ApiKey, Url};
use ferrostep_profiles::PlannedBy;
use ferrostep_session::took::Duration;

use values::{edge, rules};

pub use calibrate::{
    CalibrateAdvanceArguments, CalibrateFlowArguments, CalibrateShaperArguments, CalibrateSpeedArguments, Calibration,
    HeatArguments, TriedArgument,
};
pub use compare::{CompareArguments, ShowArguments, SweepArguments};
pub use job::{Format, JobArguments, MacroArgument};
pub use papers::PaperName;
pub use post_process::PostProcessArguments;
pub use send::{BlackBoxArguments, SendArguments};
#[cfg(unix)]
pub use serve::ServeArguments;
pub use simulate::{ComparedRules, SimulateArguments};
pub use values::Edge;

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

    /// True if it asks for macros as a board has them.
    pub fn has_strict_macros(&self) -> bool {
        let argument = match self {
            Self::Print { macros, .. } | Self::Estimate { macros, .. } => macros,
            Self::Sweep(arguments) => &arguments.macros,
            Self::Show(arguments) => &arguments.macros,
            Self::Compare(arguments) => &arguments.macros,
            Self::Simulate(arguments) => &arguments.macros,
            _ => return false,
        };
        argument.strict_macros
    }
}

/// The subcommands.
#[derive(Subcommand)]
pub enum Command {
    /// Prints a file on the virtual board: executes the whole job, makes every step, and stops at a
    /// line the printer would refuse.
    Print {
        #[command(flatten)]
        job: JobArguments,
        #[command(flatten)]
        macros: MacroArgument,
        /// Number of blocks that the planner sees ahead [default: 128, as on the board; 65536
        /// for a prepared job].
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_048_576))]
        look_ahead: Option<u32>,
        /// Starts a prepared job in its middle, at frame N, as after a power cut: heats, assumes
        /// that the nozzle is at the height of the frame, homes X and Y only, moves to the start of
        /// the frame, and prints from there. `inspect --entries` lists the possible frames.
        #[arg(long, value_name = "N")]
        from_frame: Option<u32>,
        /// Writes every step with its time to a file (format: the book, "The trace").
        #[arg(long, value_name = "OUT")]
        trace: Option<PathBuf>,
        /// Writes the step and direction signals as a waveform, for GTKWave or PulseView. A
        /// whole print is large.
        #[arg(long, value_name = "OUT")]
        vcd: Option<PathBuf>,
        /// Begins the waveform here: seconds of motion (12.5; waits for heat left out), a line
        /// (line:120) or a layer (layer:3).
        #[arg(long, value_name = "SECONDS|line:N|layer:N", requires = "vcd", value_parser = edge)]
        from: Option<Edge>,
        /// Ends the waveform here, after the motion of the line or the layer.
        #[arg(long, value_name = "SECONDS|line:N|layer:N", requires = "vcd", value_parser = edge)]
        to: Option<Edge>,
    },
    /// Plans the speeds of a file on this computer and writes a prepared job (.gpre), which a board
    /// only has to execute.
    Preprocess {
        #[command(flatten)]
        job: JobArguments,
        /// The file to write.
        #[arg(short, value_name = "OUT.gpre")]
        out: PathBuf,
        /// The job's encoding.
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
    /// Sends a file to a printer: G-code line by line, a prepared job as it is, which the board
    /// executes while it arrives.
    Send(SendArguments),
    /// Fetches a printer's black box (M791), or reads a saved one: the last commands, temperatures,
    /// driver events and halts before a stop or a reset, and the last steps, played again.
    Blackbox(BlackBoxArguments),
    /// Lists the serial ports of this computer, with the numbers and names of what is on USB.
    Ports,
    /// Serves a virtual printer that hosts such as OctoPrint connect to. With --board it is the
    /// image of a board, as it would be flashed, on an emulated chip (`cargo xtask mainboard`
    /// builds it); otherwise the board's parts in this program.
    #[cfg(unix)]
    Serve(ServeArguments),
    /// Estimates the time and the material that a file takes, without making its steps.
    Estimate {
        #[command(flatten)]
        job: JobArguments,
        #[command(flatten)]
        macros: MacroArgument,
        /// Estimates with these error budgets in place of the profile's, mm, and shows the
        /// accelerations that follow: a range, each value twice the one before
        /// (0.015..0.06), or a list.
        #[arg(long, value_name = "VALUES", conflicts_with = "strict")]
        error_budget: Option<Values>,
        /// Simulates the error with each budget, too: on the profile's frame as it was measured,
        /// and as soft and as stiff as it may be.
        #[arg(long, requires = "error_budget")]
        simulate: bool,
        /// The firmware by whose rules the file is planned [default: that of the profile's
        /// rules.planned_by].
        #[arg(long, value_name = "RULES", value_parser = rules())]
        rules: Option<PlannedBy>,
        /// The time that the printer took, as 5h01 or 5:01:30: finds the limits that would
        /// explain it.
        #[arg(long, value_name = "TIME", conflicts_with = "error_budget")]
        took: Option<Duration>,
    },
    /// Writes the print's time into its G-code, where slicers and hosts read it: comments, M73.
    /// Exit status 0 and one line, as slicers expect of a post-processing script.
    PostProcess(PostProcessArguments),
    /// Estimates a file's time with other values of the profile's keys: what a higher acceleration
    /// would gain, for one.
    Sweep(SweepArguments),
    /// Shows a print as it is executed: prints it on the virtual board and writes one HTML page
    /// with the path in 3D, coloured by speed, flow, pressure and more, with findings and charts;
    /// opens it in the browser.
    Show(ShowArguments),
    /// Prints two files, or one with two profiles, on the virtual board and compares time, speed,
    /// flow and error, with both prints on one HTML page.
    Compare(CompareArguments),
    /// Measures what the steps of a file, or of a trace, do to a frame that rings and to a nozzle
    /// under pressure: contour error, ringing, misplaced material, true acceleration.
    Simulate(Box<SimulateArguments>),
    /// Turns measurements of a printer into keys of its profile.
    Calibrate {
        /// The measurement.
        #[command(subcommand)]
        calibration: Calibration,
    },
    /// Computes the tables and figures of the papers behind the motion code again, beside ours; of
    /// all papers if none is named.
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
        /// Prints this file with every combination of interpolation and acceleration instead,
        /// and compares them.
        #[arg(long, value_name = "FILE", conflicts_with_all = ["paper", "svg"])]
        compare: Option<PathBuf>,
        /// The machine to compare on: cartesian, corexy, prusa-mini, or the path of a TOML file.
        #[arg(long, value_name = "NAME|PATH", default_value = "cartesian", requires = "compare")]
        profile: String,
    },
    /// Makes a profile of another firmware's configuration (Klipper's printer.cfg, Marlin's
    /// Configuration.h) and lists what it keeps of each setting, and why not.
    Import {
        /// The configuration; files that it includes, and Configuration_adv.h, are
        /// looked for beside it.
        #[arg(required_unless_present_any = ["moonraker", "marlin"], conflicts_with = "moonraker")]
        file: Option<PathBuf>,
        /// Asks a running Klipper for its configuration, by its server Moonraker: http://HOST or
        /// http://HOST:PORT.
        #[arg(long, value_name = "URL", conflicts_with = "marlin")]
        moonraker: Option<Url>,
        /// The key that Moonraker wants of computers that it does not trust (its page shows it
        /// under API key).
        #[arg(long, value_name = "KEY", requires = "moonraker")]
        api_key: Option<ApiKey>,
        /// Asks a running Marlin for its settings (M115, M503) at a serial port or
        /// tcp:HOST:PORT. They hold over those of FILE, its Configuration.h, which says what a
        /// printer does not tell.
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
        /// Lists each setting that is not kept and each value that the file does not say, instead
        /// of their numbers.
        #[arg(long)]
        all: bool,
        /// Lets the built-in profile cartesian stand in for what the machine is and the file does
        /// not say, such as steps, end stops and sensors; the exit status is then 3.
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
