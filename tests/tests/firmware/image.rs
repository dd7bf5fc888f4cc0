//! The image, and one emulator at a time.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use ferrostep_tests::qemu::{EMULATOR, Host, Machine, PinLog, Pins, PortWrite, Sleep};
use object::{Object, ObjectSection, ObjectSymbol};
use tempfile::TempDir;

use crate::boards::BoardFacts;
use crate::thermistors::with_thermistors;

/// Far more than any of these conversations takes.
const LIMIT: Duration = Duration::from_secs(240);

/// While the image sleeps, its time is the wall clock's: emulators that share a processor would disturb each other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Path of the bench board's image; built when nobody has.
pub fn image() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| match std::env::var_os("FERROSTEP_FIRMWARE") {
        Some(path) => PathBuf::from(path),
        None => built_image("bench"),
    })
}

/// Path of a board's image; built when nobody has. Its other files lie next to it.
pub fn image_of(board: &str) -> PathBuf {
    static BUILT: Mutex<BTreeMap<String, PathBuf>> = Mutex::new(BTreeMap::new());
    match std::env::var_os("FERROSTEP_IMAGES") {
        Some(folder) => Path::new(&folder).join(board).join("ferrostep.elf"),
        None => {
            let mut built = BUILT.lock().unwrap_or_else(PoisonError::into_inner);
            built.entry(board.to_owned()).or_insert_with(|| built_image(board)).clone()
        }
    }
}

fn built_image(board: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo).args(["xtask", "firmware", "--board", board]).current_dir(root).output().unwrap();
    let messages = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo xtask firmware --board {board}: {messages}");
    // Its first line is the path, the size table follows.
    let text = String::from_utf8(output.stdout).unwrap();
    PathBuf::from(text.lines().next().unwrap())
}

/// The image with `FERROSTEP_DRIVERS`, the mask of the drivers that are set up, at 0 where its initial value lies.
fn without_drivers(image: &[u8]) -> Vec<u8> {
    let file = object::File::parse(image).unwrap();
    let symbol = file.symbols().find(|symbol| symbol.name() == Ok("FERROSTEP_DRIVERS")).unwrap();
    let section = file.section_by_index(symbol.section_index().unwrap()).unwrap();
    let (offset, _) = section.file_range().unwrap();
    let place = (offset + symbol.address() - section.address()) as usize;
    let mut changed = image.to_vec();
    assert_eq!(std::mem::take(&mut changed[place]), 0b1111);
    changed
}

/// A running image with a host connected to it.
pub struct Bench {
    /// The host.
    pub host: Host<Machine>,
    // Fields are dropped in their order: the emulator before its folder, the turn last.
    _folder: TempDir,
    _turn: MutexGuard<'static, ()>,
}

impl Bench {
    /// Boots the bench board's image.
    pub fn boot() -> Self {
        Self::boot_with(Sleep::RealTime)
    }

    /// Boots the bench board's image, and says what becomes of its sleep.
    pub fn boot_with(sleep: Sleep) -> Self {
        Self::start(image(), sleep)
    }

    /// Boots an image.
    pub fn boot_image(image: &Path) -> Self {
        Self::start(image, Sleep::RealTime)
    }

    /// Boots a board's image so that it heats and moves its motors: thermistors of the test's stand in for the converter, and
    /// the Buddy board's drivers are on its serial line; where they hang on pins, which the emulator does not have, the image
    /// is told that there are none.
    pub fn boot_board(board: &BoardFacts) -> Self {
        Self::start_changed(board, board.own_lines)
    }

    /// The same with drivers that do not answer where they hang on pins.
    pub fn boot_board_with_drivers(board: &BoardFacts) -> Self {
        Self::start_changed(board, false)
    }

    fn start_changed(board: &BoardFacts, is_without_drivers: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut image = image_of(board.name);
        if board.is_printer() {
            image = with_thermistors(&image, folder.path());
        }
        if is_without_drivers {
            let changed = without_drivers(&std::fs::read(&image).unwrap());
            image = folder.path().join("without-drivers.elf");
            std::fs::write(&image, changed).unwrap();
        }
        Self::boot_image(&image)
    }

    fn start(image: &Path, sleep: Sleep) -> Self {
        let mut bench = Self::switch_on(image, sleep);
        bench.host.connect().unwrap_or_else(|error| panic!("no connection to {}: {error}", image.display()));
        bench
    }

    /// An image that runs, and nobody has spoken to it.
    pub fn switch_on(image: &Path, sleep: Sleep) -> Self {
        // A test that failed while it had its turn leaves nothing behind that matters here.
        let turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().unwrap();
        let machine = Machine::start(image, folder.path(), sleep).unwrap_or_else(|error| {
            panic!("{EMULATOR} does not start ({error}): `cargo xtask test` installs it on Debian")
        });
        Self { host: Host::new(machine, LIMIT), _folder: folder, _turn: turn }
    }

    /// What the pins have done so far.
    pub fn pins(&mut self) -> PinLog {
        PinLog::read(self.host.port().pin_log(), Pins::BENCH).unwrap()
    }

    /// All that was stored to the ports so far.
    pub fn port_writes(&mut self) -> Vec<PortWrite> {
        PortWrite::read(self.host.port().pin_log()).unwrap()
    }

    /// A device's register.
    pub fn register(&mut self, address: u32) -> u32 {
        let mut debugger = self.host.port().halt().unwrap();
        let value = debugger.word(address).unwrap();
        debugger.resume().unwrap();
        value
    }

    /// How often the emulator has said this of a device that it has not.
    pub fn logged(&mut self, line: &str) -> usize {
        std::fs::read_to_string(self.host.port().pin_log()).unwrap().lines().filter(|logged| *logged == line).count()
    }

    /// Ends the emulator and returns what the pins have done.
    pub fn switch_off(mut self) -> PinLog {
        self.host.port().stop();
        self.pins()
    }
}
