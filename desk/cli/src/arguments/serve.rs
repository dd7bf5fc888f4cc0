//! The arguments of `serve`.

use std::net::SocketAddr;
use std::path::PathBuf;

use ferrostep_host::printer_line::Address;
use ferrostep_session::serve::{Fault, Speed};
use ferrostep_web::Token;

use super::values::web_address;

/// Arguments of `serve`.
#[derive(clap::Args)]
pub struct ServeArguments {
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian", conflicts_with = "board")]
    pub profile: String,
    /// A board whose image is to run on an emulated chip: bench, prusa-buddy, btt-octopus-1.1, or
    /// the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH")]
    pub board: Option<String>,
    /// The board's port that the host connects to.
    #[arg(long, value_enum, default_value_t = Via::Usb, requires = "board")]
    pub via: Via,
    /// Serves on a pseudo-terminal with this path, which the host opens as its serial port.
    #[arg(long, value_name = "PATH", required_unless_present_any = ["tcp", "web"], conflicts_with = "tcp")]
    pub pty: Option<PathBuf>,
    /// Serves on a TCP port of this computer; 0 takes a free one.
    #[arg(long, value_name = "PORT")]
    pub tcp: Option<u16>,
    /// Serves a page that shows the printer and controls it, for this computer's browsers, or for
    /// others at another address; its address with a secret token is printed at the start.
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8790", value_parser = web_address)]
    pub web: Option<SocketAddr>,
    /// The key of slicers that send files, as they send them to OctoPrint: 8 to 128 letters, digits
    /// and signs. Without it slicers on this computer need none, and others are refused.
    #[arg(long, value_name = "KEY", requires = "web", value_parser = Token::chosen)]
    pub key: Option<Token>,
    /// Largest file that the page or a slicer uploads, MiB.
    #[arg(long, value_name = "MIB", default_value_t = 256, value_parser = clap::value_parser!(u64).range(1..=65_536), requires = "web")]
    pub web_upload: u64,
    /// Puts the page in front of a printer at this port instead of a virtual one: its serial port,
    /// or tcp:HOST:PORT.
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
    /// Seconds of the printer that pass in one second, or max; a slow computer falls behind and
    /// does not catch up.
    #[arg(long, value_name = "FACTOR|max", default_value = "1")]
    pub speed: Speed,
    /// Makes something fail, at once or at @SECONDS of the printer: nozzle-HOW or bed-HOW with HOW
    /// open, shorted, fell-out, frozen, dead or stuck-on; drop:RATE, flip:RATE (of the bytes),
    /// drop-line:RATE or flip-line:RATE (of the lines) with RATE such as 1%; card-pull, card-back;
    /// filament-out, filament-back; x-HOW, y-HOW or z-HOW with HOW never, always or works (the
    /// sensors of G28); pin-stays-in, pin-stays-out, pin-works (a BLTouch). Can be repeated.
    #[arg(long, value_name = "KIND[@SECONDS]", conflicts_with = "board")]
    pub fault: Vec<Fault>,
    /// The memory card in the printer's slot: an image (FAT16 or FAT32), which at the end contains
    /// the files that a host has written, or a folder, whose files are copied to a card; the folder
    /// stays unchanged.
    #[arg(long, value_name = "IMAGE|FOLDER", conflicts_with = "board")]
    pub card: Option<PathBuf>,
    /// The memory for settings (M500): a file, which is made if it does not exist. Without it the
    /// printer has none.
    #[arg(long, value_name = "FILE", conflicts_with = "board")]
    pub settings: Option<PathBuf>,
    /// Prints what the printer has done as one JSON object, as `print` does, when it is switched
    /// off with Ctrl-C.
    #[arg(long, conflicts_with = "board")]
    pub json: bool,
}

/// The ports of a printer.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum Via {
    /// USB.
    Usb,
    /// The serial line.
    Uart,
}

impl Via {
    /// Its name on the command line of the virtual mainboard.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Usb => "usb",
            Self::Uart => "uart",
        }
    }
}
