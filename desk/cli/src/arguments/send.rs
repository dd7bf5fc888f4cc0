//! The arguments of `send` and `blackbox`.

use std::path::PathBuf;

use ferrostep_host::printer_line::Address;

use super::job::PlateArgument;

/// Arguments of `send`.
#[derive(clap::Args)]
pub struct SendArguments {
    /// G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF, or a prepared job in
    /// the compact encoding; - is standard input.
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
    /// Writes G-code to the printer's memory card under this name, 8 characters and 3 after the
    /// dot, instead of printing it.
    #[arg(long, value_name = "NAME", conflicts_with = "fallback")]
    pub to_card: Option<String>,
    /// The printer, as its profile describes it: cartesian, corexy, prusa-mini, or the path of a
    /// TOML file. The remaining time of G-code is estimated for it, instead of being the slicer's.
    #[arg(long, value_name = "NAME|PATH", conflicts_with = "to_card")]
    pub profile: Option<String>,
    /// Packs the lines of G-code into two thirds of their bytes, if the printer says that
    /// it knows MeatPack.
    #[arg(long)]
    pub meatpack: bool,
}

/// Arguments of `blackbox`.
#[derive(clap::Args)]
pub struct BlackBoxArguments {
    /// The printer's serial port, tcp:HOST:PORT, or a file: a saved black box, or a terminal's log
    /// with the answer to M791.
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
    /// Tells the place in the source where a panic or a fault ended the firmware: the ferrostep.elf
    /// that was flashed.
    #[arg(long, value_name = "ELF")]
    pub image: Option<PathBuf>,
}
