//! The board, image and job of a campaign.

use std::path::Path;

use super::image::Layout;
use crate::machine::Machine;
use crate::wiring::{Board, Printer};

/// The seed of the machine's own noise: all runs start with the same machine.
const MACHINE_SEED: u64 = 1;

/// A board, its printer and its image, shared by all runs.
#[derive(Debug)]
pub struct Bench {
    board: Board,
    printer: Printer,
    /// The image.
    pub images: [rigless::image::Image; 1],
    /// The address of the vector table.
    pub boot: Option<u64>,
    /// The G-code file to print.
    pub job: String,
    /// The memory layout of the image.
    pub layout: Layout,
    /// The limits of the printer.
    pub limits: Limits,
}

impl Bench {
    /// Reads files below the repository's root: `config/boards/NAME.toml`, its profile,
    /// `target/images/NAME/ferrostep.elf` and the cube.
    ///
    /// # Errors
    /// A file cannot be read or is malformed; the text names it.
    pub fn new(root: &Path, name: &str) -> Result<Self, String> {
        let board = Board::read(&root.join(format!("config/boards/{name}.toml"))).map_err(|error| error.to_string())?;
        let profile = root.join(format!("config/profiles/{}.toml", board.profile));
        let printer = Printer::read(&profile).map_err(|error| error.to_string())?;
        let elf = root.join(format!("target/images/{name}/ferrostep.elf"));
        let shown = elf.display();
        let bytes = std::fs::read(&elf)
            .map_err(|error| format!("{shown}: {error}; build it with `cargo xtask firmware --board {name}`"))?;
        let layout = Layout::read(&board, &bytes).map_err(|error| format!("{shown}: {error}"))?;
        let image = rigless::image::Image::read(&elf, None).map_err(|error| format!("{shown}: {error}"))?;
        let cube = root.join("examples/cube.gcode");
        let job = std::fs::read(&cube).map_err(|error| format!("{}: {error}", cube.display()))?;
        let limits = Limits {
            max_celsius: [printer.nozzle.max_celsius, printer.bed.as_ref().map_or(0.0, |bed| bed.max_celsius)],
            per_step_256: std::array::from_fn(|motor| {
                256 / i64::from(printer.drivers[motor].map_or(16, |driver| driver.microsteps)).max(1)
            }),
        };
        Ok(Self {
            boot: Some(0x0800_0000 + u64::from(board.boot_offset)),
            images: [image],
            job: String::from_utf8_lossy(&job).into_owned(),
            layout,
            limits,
            board,
            printer,
        })
    }

    /// The machine before power-on.
    ///
    /// # Errors
    /// The board's file and the profile contradict each other.
    pub fn machine(&self) -> Result<Machine, String> {
        Machine::new(&self.board, &self.printer, MACHINE_SEED)
    }
}

/// The limits of a printer against which a run is judged.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// The maximum temperatures of nozzle and bed, degrees Celsius.
    pub max_celsius: [f64; 2],
    /// The size of a step, in 1/256 of a full step.
    pub per_step_256: [i64; 4],
}
