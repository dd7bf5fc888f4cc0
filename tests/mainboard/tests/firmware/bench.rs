//! A board on the test's bench: switched on, with a host at its line and access to everything
//! around its chip.

use std::path::Path;

use ferrostep_mainboard::conversation::{Conversation, ConversationOperator};
use ferrostep_mainboard::machine::{Machine, Store};
use ferrostep_mainboard::plant::Plant;
use ferrostep_mainboard::run::Finished;
use ferrostep_mainboard::wiring::{Board, Printer};
use ferrostep_testkit::boards::{BOARDS, BoardFacts};
use rigless::emulator::Host as Core;
use rigless::image::Image;
use rigless::soc::Width;

use crate::firmware::foreign_code::{JUMP_TARGET, PROGRAM, PatchedImage};
use crate::firmware::host::{Host, Port};
use crate::firmware::images::{image_of, root};
use crate::firmware::pins::PinLog;
use crate::firmware::port_log::{PortState, PortWrite};

/// Virtual time after which a silent printer counts as dead, ns.
const LIMIT_NS: u64 = 40_000_000_000;

/// Maximum polls, 100 us apart: far longer than a processor is busy.
const MAX_POLLS: u32 = 10_000;

/// Seed of everything random in the printer.
const SEED: u64 = 1;

/// The host's line.
#[derive(Debug)]
pub struct Line(pub Conversation);

impl Port for Line {
    fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        self.0.send(bytes)
    }

    fn receive(&mut self, until_ns: u64) -> Result<Option<String>, String> {
        Ok(self.0.next_line(until_ns)?.map(|line| line.text))
    }

    fn now_ns(&self) -> u64 {
        self.0.now_ns()
    }
}

/// An image with [`PatchedImage`]'s changes, and the code that they lead to.
fn patched(facts: &BoardFacts, path: &Path) -> Vec<Image> {
    let PatchedImage { image, stub, stub_address } = PatchedImage::of(path, facts.flash_end);
    let image = Image::new(path, image, None).unwrap();
    vec![image, Image::new(Path::new("stub"), stub, Some(u64::from(stub_address))).unwrap()]
}

/// A running board with a host connected to it.
pub struct Bench {
    /// The host.
    pub host: Host<Line>,
    facts: &'static BoardFacts,
}

impl Bench {
    /// Boots the bench board.
    pub fn boot() -> Self {
        Self::boot_board(&BOARDS[0])
    }

    /// Boots a board and connects the host.
    pub fn boot_board(facts: &'static BoardFacts) -> Self {
        let mut bench = Self::switch_on(facts, |_| {});
        bench.host.connect().unwrap_or_else(|error| panic!("no connection to {}: {error}", facts.name));
        bench
    }

    /// Boots a board with [`PatchedImage`], for [`Self::execute`].
    pub fn boot_patched(facts: &'static BoardFacts) -> Self {
        let mut bench = Self::switch_on_patched(facts);
        bench.host.connect().unwrap_or_else(|error| panic!("no connection to {}: {error}", facts.name));
        bench
    }

    /// Switches a board on without a host; `change` may break something before.
    pub fn switch_on(facts: &'static BoardFacts, change: impl FnOnce(&mut Machine)) -> Self {
        let image = Image::read(&image_of(facts.name), None).unwrap();
        Self::switch_on_with(facts, vec![image], change)
    }

    /// Switches a board on with these bytes at the address that its boot loader jumps to.
    pub fn switch_on_from(facts: &'static BoardFacts, file: &Path) -> Self {
        let image = Image::read(file, Some(u64::from(facts.image_address))).unwrap();
        Self::switch_on_with(facts, vec![image], |_| {})
    }

    /// Switches a board on with [`PatchedImage`], for [`Self::execute`].
    pub fn switch_on_patched(facts: &'static BoardFacts) -> Self {
        Self::switch_on_with(facts, patched(facts, &image_of(facts.name)), |_| {})
    }

    /// Boots a variant of a board, by its file and its profile's, with its image patched for
    /// [`Self::execute`].
    pub fn boot_variant(facts: &'static BoardFacts, board: &Path, profile: &Path, image: &Path) -> Self {
        let (board, printer) = (Board::read(board).unwrap(), Printer::read(profile).unwrap());
        let mut bench = Self::switch_on_in(facts, &board, &printer, patched(facts, image), |_| {});
        bench.host.connect().unwrap_or_else(|error| panic!("no connection to {}: {error}", board.name));
        bench
    }

    fn switch_on_with(facts: &'static BoardFacts, images: Vec<Image>, change: impl FnOnce(&mut Machine)) -> Self {
        let board = Board::read(&root().join(format!("config/boards/{}.toml", facts.name))).unwrap();
        let printer = Printer::read(&root().join(format!("config/profiles/{}.toml", facts.profile))).unwrap();
        Self::switch_on_in(facts, &board, &printer, images, change)
    }

    fn switch_on_in(
        facts: &'static BoardFacts,
        board: &Board,
        printer: &Printer,
        images: Vec<Image>,
        change: impl FnOnce(&mut Machine),
    ) -> Self {
        let mut machine = Machine::new(board, printer, SEED).unwrap();
        machine.keep_stores();
        change(&mut machine);
        let boot = u64::from(facts.image_address);
        let conversation = Conversation::start(machine, images, boot).unwrap();
        Self { host: Host::new(Line(conversation), LIMIT_NS), facts }
    }

    /// Inspects or changes the machine while it is paused.
    pub fn with<T: Send + 'static>(
        &mut self,
        action: impl FnOnce(&mut Machine, &mut dyn Core) -> T + Send + 'static,
    ) -> T {
        self.host.port().0.with(action).unwrap()
    }

    /// Changes the parts around the chip; the chip sees it at once. The second number is the
    /// board's time, ns.
    pub fn change(&mut self, action: impl FnOnce(&mut Plant, u64) + Send + 'static) {
        let now_ns = self.now_ns();
        self.with(move |machine, _| {
            action(&mut machine.plant, now_ns);
            machine.plant.refresh_inputs();
        });
    }

    /// The board's time, ns.
    pub fn now_ns(&mut self) -> u64 {
        self.with(|_, _| ());
        self.host.port().now_ns()
    }

    /// Advances time, ms; lines that arrive meanwhile are dropped.
    pub fn pass(&mut self, time_ms: u64) {
        self.host.listen(time_ms).unwrap();
    }

    /// Presses the reset button.
    pub fn press_reset(&mut self) {
        self.host.port().0.press_reset().unwrap();
    }

    /// The log of the motors' pins so far.
    pub fn pins(&mut self) -> PinLog {
        let facts = self.facts;
        self.with(move |machine, _| PinLog::of(machine, facts))
    }

    /// All stores to peripherals so far.
    pub fn stores(&mut self) -> Vec<Store> {
        self.with(|machine, _| machine.stores().to_vec())
    }

    /// The number of stores of this value to a register so far.
    pub fn stored(&mut self, address: u32, value: u32) -> usize {
        self.with(move |machine, _| {
            let these = machine.stores().iter().filter(|store| (store.address, store.value) == (address, value));
            these.map(|store| store.times as usize).sum()
        })
    }

    /// All stores to the ports so far.
    pub fn port_writes(&mut self) -> Vec<PortWrite> {
        self.with(|machine, _| machine.stores().iter().filter_map(PortWrite::of).collect())
    }

    /// The pins after all stores so far.
    pub fn state(&mut self) -> PortState {
        let mut state = PortState::new();
        self.port_writes().into_iter().for_each(|write| state.apply(write));
        state
    }

    /// The share of full power that a heater gets.
    pub fn heater_power(&mut self, name: &str) -> f64 {
        let name = name.to_owned();
        self.with(move |machine, _| {
            machine.plant.heaters.iter().find(|heater| heater.name == name).map(|heater| heater.power).unwrap()
        })
    }

    /// Gives a heater this temperature at once, so that a test need not wait for it.
    pub fn set_celsius(&mut self, name: &str, celsius: f64) {
        let name = name.to_owned();
        self.change(move |plant, now_ns| {
            let place = plant.heaters.iter_mut().find(|heater| heater.name == name).unwrap();
            place.heater.set_temperature(now_ns, celsius);
        });
    }

    /// True if any heater gets power.
    pub fn any_heater_on(&mut self) -> bool {
        self.with(|machine, _| machine.plant.any_heater_on())
    }

    /// A word of RAM.
    pub fn word(&mut self, address: u32) -> u32 {
        self.with(move |_, core| core.read(u64::from(address), Width::W32).unwrap() as u32)
    }

    /// Makes the processor execute these instructions instead of sleeping, from the end of its next
    /// sleep on. Only for a board with [`PatchedImage`].
    pub fn execute(&mut self, code: &[u16]) {
        let code = code.to_vec();
        self.with(move |_, core| {
            for (place, half) in (u64::from(PROGRAM)..).step_by(2).zip(code) {
                core.write(place, Width::W16, u64::from(half)).unwrap();
            }
            core.write(u64::from(JUMP_TARGET), Width::W32, u64::from(PROGRAM | 1)).unwrap();
        });
        for _ in 0..MAX_POLLS {
            self.wait_us(100);
            if self.word(JUMP_TARGET) == 0 {
                return;
            }
        }
        panic!("{}: the processor never sleeps", self.facts.name);
    }

    /// Advances time, us; lines that arrive meanwhile are kept.
    pub fn wait_us(&mut self, time_us: u64) {
        let until_ns = self.now_ns() + time_us * 1000;
        self.host.port().0.wait(until_ns).unwrap();
    }

    /// Switches the machine off; returns the log of its motors' pins.
    pub fn switch_off(self) -> PinLog {
        let facts = self.facts;
        PinLog::of(self.end().machine(), facts)
    }

    /// Switches the machine off; returns its last state.
    pub fn end(self) -> Finished<ConversationOperator> {
        self.host.into_port().0.end().unwrap()
    }
}
