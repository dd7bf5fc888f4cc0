//! MeatPack: two characters of G-code in a byte, on a line or in a file.
//!
//! While packing is on, each half of a byte is one of fifteen common characters, the lower half
//! first; the half 15 announces a character that follows whole. Two bytes FF and a third are a
//! command to the unpacker. Source of codes and commands:
//! <https://github.com/scottmudge/OctoPrint-MeatPack>; of the reports, Marlin's `feature/meatpack`.

use core::fmt;

/// Two of them announce a command.
const SIGNAL: u8 = 0xff;

/// Half of a byte that announces a character that follows whole.
const WHOLE: u8 = 15;

/// Place of the space among [`CHARACTERS`]; without spaces an E.
const SPACE: u8 = 11;

/// Characters that half a byte encodes.
const CHARACTERS: [u8; 15] = *b"0123456789. \nGX";

/// Bytes that a host sends before it packs, whatever the printer's state: everything off, spaces as
/// they are, packing on. The printer reports each; the last report is `[MP] PV01 ON ESP`.
pub const BEGIN: [u8; 9] = [
    SIGNAL,
    SIGNAL,
    Command::Reset as u8,
    SIGNAL,
    SIGNAL,
    Command::DisableNoSpaces as u8,
    SIGNAL,
    SIGNAL,
    Command::Enable as u8,
];

/// Bytes that a host sends when it has packed its last line.
pub const END: [u8; 3] = [SIGNAL, SIGNAL, Command::Reset as u8];

/// Command in the byte after two [`SIGNAL`]s.
#[derive(Clone, Copy)]
enum Command {
    Enable = 251,
    Disable = 250,
    Reset = 249,
    Query = 248,
    EnableNoSpaces = 247,
    DisableNoSpaces = 246,
}

impl Command {
    fn of(byte: u8) -> Option<Self> {
        let all = [Self::Enable, Self::Disable, Self::Reset, Self::Query, Self::EnableNoSpaces, Self::DisableNoSpaces];
        all.into_iter().find(|command| *command as u8 == byte)
    }
}

/// The state of an unpacker that its host may know. Prints as Marlin's report, `[MP] PV01 ON ESP`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// Bytes are packed.
    pub packing: bool,
    /// The packed space means an E.
    pub no_spaces: bool,
}

impl fmt::Display for Settings {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let packing = if self.packing { "ON" } else { "OFF" };
        let spaces = if self.no_spaces { "NSP" } else { "ESP" };
        write!(formatter, "[MP] PV01 {packing} {spaces}")
    }
}

/// Bytes unpacked from one byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unpacked {
    bytes: [u8; Self::MAX_BYTES],
    length: usize,
    /// A command has been obeyed, or could not be understood: the host expects this report.
    pub report: Option<Settings>,
}

impl Unpacked {
    /// Maximum number of bytes that one byte gives: a whole character with the half that waited for
    /// it, then two halves.
    pub const MAX_BYTES: usize = 4;

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.length) {
            *place = byte;
            self.length += 1;
        }
    }
}

/// Unpacks a stream of bytes. Off at first: then all bytes pass unchanged but commands, which are
/// taken out. A single FF waits for the byte after it.
///
/// ```
/// use ferrostep_gcode::meatpack::{BEGIN, Unpacker};
///
/// let mut unpacker = Unpacker::new();
/// let mut text = Vec::new();
/// for byte in BEGIN.into_iter().chain([0x1d, 0xeb, 0x5a, 0xcc]) {
///     text.extend_from_slice(unpacker.feed(byte).bytes());
/// }
/// assert_eq!(text, b"G1 X.5\n");
/// ```
#[derive(Clone, Debug, Default)]
pub struct Unpacker {
    settings: Settings,
    /// FF bytes in a row, 2 at most.
    signals: u8,
    /// Whole characters that are still to come.
    whole: u8,
    /// The second half of a byte whose first character is still to come.
    held: Option<u8>,
}

impl Unpacker {
    /// Off.
    pub const fn new() -> Self {
        Self { settings: Settings { packing: false, no_spaces: false }, signals: 0, whole: 0, held: None }
    }

    /// The settings.
    pub const fn settings(&self) -> Settings {
        self.settings
    }

    /// Takes the next byte.
    pub fn feed(&mut self, byte: u8) -> Unpacked {
        let mut unpacked = Unpacked::default();
        match (byte, self.signals) {
            (SIGNAL, signals) => {
                self.signals = (signals + 1).min(2);
                return unpacked;
            }
            (command, 2) => {
                self.obey(Command::of(command));
                unpacked.report = Some(self.settings);
            }
            (byte, signals) => {
                if signals == 1 {
                    self.unpack(SIGNAL, &mut unpacked);
                }
                self.unpack(byte, &mut unpacked);
            }
        }
        self.signals = 0;
        unpacked
    }

    fn obey(&mut self, command: Option<Command>) {
        let settings = match command {
            Some(Command::Enable) => Settings { packing: true, ..self.settings },
            Some(Command::Disable) => Settings { packing: false, ..self.settings },
            Some(Command::Reset) => Settings::default(),
            Some(Command::EnableNoSpaces) => Settings { no_spaces: true, ..self.settings },
            Some(Command::DisableNoSpaces) => Settings { no_spaces: false, ..self.settings },
            Some(Command::Query) | None => return,
        };
        // A half-unpacked byte has lost its other half.
        *self = Self { settings, ..Self::new() };
    }

    fn unpack(&mut self, byte: u8, unpacked: &mut Unpacked) {
        if !self.settings.packing {
            unpacked.push(byte);
            return;
        }
        if let Some(left) = self.whole.checked_sub(1) {
            self.whole = left;
            unpacked.push(byte);
            if let Some(held) = self.held.take() {
                unpacked.push(held);
            }
            return;
        }
        match (self.character(byte & 15), self.character(byte >> 4)) {
            (None, second) => {
                self.whole = if second.is_none() { 2 } else { 1 };
                self.held = second;
            }
            // The other half fills the byte at the end of a line.
            (Some(b'\n'), _) => unpacked.push(b'\n'),
            (Some(first), second) => {
                unpacked.push(first);
                match second {
                    Some(second) => unpacked.push(second),
                    None => self.whole = 1,
                }
            }
        }
    }

    /// The character of half a byte; `None` if it follows whole.
    fn character(&self, half: u8) -> Option<u8> {
        match half {
            SPACE if self.settings.no_spaces => Some(b'E'),
            half => CHARACTERS.get(usize::from(half)).copied(),
        }
    }
}

/// Packs text, with the spaces as they are; each line begins with a new byte. To be sent between
/// [`BEGIN`] and [`END`].
///
/// No UTF-8 has the byte FF, so packed text is never taken for a command.
pub fn pack(text: &str, mut put: impl FnMut(u8)) {
    let half = |byte: u8| CHARACTERS.iter().position(|&character| character == byte).map_or(WHOLE, |half| half as u8);
    let mut bytes = text.bytes().peekable();
    while let Some(first) = bytes.next() {
        // The unpacker drops what shares a byte with a line end before it.
        let second = if first == b'\n' { None } else { bytes.next() };
        let (lower, upper) = (half(first), half(second.unwrap_or(b'\n')));
        put(upper << 4 | lower);
        if lower == WHOLE {
            put(first);
        }
        if let Some(second) = second.filter(|_| upper == WHOLE) {
            put(second);
        }
    }
}

#[cfg(test)]
mod tests;
