//! The command line.

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use ferrostep::papers::Paper;

/// The 3D-printer firmware that rehearses on the desk what it does on the board.
#[derive(Parser)]
#[command(version = ferrostep::VERSION, about)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Subcommand)]
pub enum Command {
    /// Prints a file on the virtual board: the whole machine, every step.
    Print {
        #[command(flatten)]
        job: JobArguments,
        /// Blocks in the look-ahead ring; 128 if not given, and 65536 for a prepared job.
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_048_576))]
        look_ahead: Option<u32>,
        /// Enters a prepared job at a frame, as after a power cut (`inspect --entries` lists those that can be): heats, takes the
        /// nozzle to stand at the frame's height, homes X and Y alone, goes to the frame's start, and prints on.
        #[arg(long, value_name = "N")]
        from_frame: Option<u32>,
        /// Writes every step event to a file.
        #[arg(long, value_name = "OUT")]
        trace: Option<PathBuf>,
        /// Writes step and direction signals as a waveform.
        #[arg(long, value_name = "OUT")]
        vcd: Option<PathBuf>,
    },
    /// Plans a file's speeds here, with all the look-ahead there is, for a board that only executes them.
    Preprocess {
        #[command(flatten)]
        job: JobArguments,
        /// The prepared job.
        #[arg(short, value_name = "OUT.gpre")]
        out: PathBuf,
        /// Its encoding.
        #[arg(long, value_enum, default_value_t = Format::Compact)]
        format: Format,
    },
    /// What is in a prepared job.
    Inspect {
        /// A prepared job.
        file: PathBuf,
        /// Every move and command, not only where the frames begin.
        #[arg(long)]
        items: bool,
        /// The frames at which the job can be entered, instead of where all begin.
        #[arg(long, conflicts_with = "items")]
        entries: bool,
    },
    /// Sends a prepared job to a board, which executes it as it comes.
    #[cfg(unix)]
    Send {
        /// A prepared job, in the compact encoding.
        file: PathBuf,
        /// The board's serial port.
        #[arg(long, value_name = "PATH", default_value = "/dev/ttyACM0")]
        port: PathBuf,
        /// The port's speed; over USB it does not matter.
        #[arg(long, value_name = "BAUD", default_value_t = 115_200)]
        baud: u32,
        /// G-code to send line by line instead, where the board refuses the prepared job.
        #[arg(long, value_name = "FILE")]
        fallback: Option<PathBuf>,
    },
    /// A printer for hosts to connect to: a board's image, as it would be flashed, on an emulated chip with the printer's drivers,
    /// heaters and mechanics around it (`cargo xtask mainboard` builds it).
    #[cfg(unix)]
    Serve(ServeArguments),
    /// Time and material of a file, without its steps.
    Estimate {
        #[command(flatten)]
        job: JobArguments,
    },
    /// The tables and figures of the papers that the machine works by, made anew; all papers without a name.
    Papers {
        /// Which paper.
        #[arg(value_enum)]
        paper: Option<PaperName>,
        /// Prints one JSON object.
        #[arg(long)]
        json: bool,
        /// Draws the figures into a folder.
        #[arg(long, value_name = "DIR")]
        svg: Option<PathBuf>,
        /// Instead, prints a file in every way to interpolate and to accelerate, and compares them.
        #[arg(long, value_name = "FILE", conflicts_with_all = ["paper", "svg"])]
        compare: Option<PathBuf>,
        /// The machine to compare on: cartesian, corexy, prusa-mini, or a TOML file.
        #[arg(long, value_name = "NAME|PATH", default_value = "cartesian", requires = "compare")]
        profile: String,
    },
}

/// A printer on a line of this computer.
#[cfg(unix)]
#[derive(clap::Args)]
pub struct ServeArguments {
    /// The board: its name or a TOML file.
    #[arg(long, value_name = "NAME|PATH")]
    pub board: String,
    /// The printer's line that is led out.
    #[arg(long, value_enum, default_value_t = Via::Usb)]
    pub via: Via,
    /// A pseudo-terminal, under this name: the port that a host is told.
    #[arg(long, value_name = "PATH", required_unless_present = "tcp", conflicts_with = "tcp")]
    pub pty: Option<PathBuf>,
    /// A port of this computer (0: any that is free).
    #[arg(long, value_name = "PORT")]
    pub tcp: Option<u16>,
    /// The printer's seconds for a second of this computer's; where it cannot keep up, the printer is late and stays so.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub speed: f64,
}

/// A printer's lines.
#[cfg(unix)]
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum Via {
    /// The USB plug.
    Usb,
    /// The serial line.
    Uart,
}

#[cfg(unix)]
impl Via {
    /// What the virtual mainboard calls it.
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
    /// About five bytes a move.
    Compact,
    /// The paper's packets of 84 bytes.
    Wide,
}

/// The papers by their short names.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum PaperName {
    /// Step Bresenham and velocity-adaptive extrusion (2024).
    Wu,
    /// Planning on the computer, look-ahead (2019).
    Yu,
    /// CoreXY plane control.
    Corexy,
    /// S-curve acceleration (2017).
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

/// What `print`, `preprocess` and `estimate` have in common.
#[derive(clap::Args)]
pub struct JobArguments {
    /// G-code (or, to print, a prepared job), plain or gzip.
    pub file: PathBuf,
    /// The machine: cartesian, corexy, prusa-mini, or a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
}
