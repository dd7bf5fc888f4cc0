//! The command line.

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use ferrostep_papers::tables::Paper;

/// Rehearses 3D prints on the desk, with the motion code that runs on the board.
#[derive(Parser)]
#[command(version = ferrostep::VERSION, about = "Rehearses 3D prints on the desk, with the motion code that runs on the board")]
pub struct Arguments {
    /// The subcommand.
    #[command(subcommand)]
    pub command: Command,
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
    /// Sends a prepared job to a board, which executes it while it arrives.
    #[cfg(unix)]
    Send {
        /// A prepared job, in the compact encoding.
        file: PathBuf,
        /// The serial port of the board.
        #[arg(long, value_name = "PATH", default_value = "/dev/ttyACM0")]
        port: PathBuf,
        /// Speed of the port; without meaning over USB.
        #[arg(long, value_name = "BAUD", default_value_t = 115_200)]
        baud: u32,
        /// G-code to send line by line instead if the board refuses the prepared job.
        #[arg(long, value_name = "FILE")]
        fallback: Option<PathBuf>,
    },
    /// Serves a virtual printer that hosts such as OctoPrint connect to: the image of a board, as it would be flashed, on an
    /// emulated chip with drivers, heaters and mechanics around it. `cargo xtask mainboard` builds it.
    #[cfg(unix)]
    Serve(ServeArguments),
    /// Tells the time and the material that a file takes, without making its steps.
    Estimate {
        #[command(flatten)]
        job: JobArguments,
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
}

/// Arguments of `serve`.
#[cfg(unix)]
#[derive(clap::Args)]
pub struct ServeArguments {
    /// The board: bench, prusa-buddy, btt-octopus-1.1, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH")]
    pub board: String,
    /// Which port of the printer the host connects to.
    #[arg(long, value_enum, default_value_t = Via::Usb)]
    pub via: Via,
    /// Serves on a pseudo-terminal with this path, which the host opens as its serial port.
    #[arg(long, value_name = "PATH", required_unless_present = "tcp", conflicts_with = "tcp")]
    pub pty: Option<PathBuf>,
    /// Serves on a TCP port of this computer; 0 takes a free one.
    #[arg(long, value_name = "PORT")]
    pub tcp: Option<u16>,
    /// How many seconds of the printer pass in one second; a slow computer falls behind and does not catch up.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub speed: f64,
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
    /// The job: G-code, plain or gzip; `print` also takes a prepared job.
    pub file: PathBuf,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
}
