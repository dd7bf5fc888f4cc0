//! The register table of the OTG_FS core: all of RM0090 section 34.16 in one instance, with
//! the FIFO windows.

use rigless::soc::{Access, FieldSpec, Layout, Peripheral, ReadAction, RegisterSpec, Width, WriteModify};

use super::fields;

/// Endpoints of each direction that have registers in the table: the F446's six. The F405 has four.
pub const ENDPOINTS: usize = 6;
/// Words of one FIFO window: 4 KiB, of which every word reaches the same end of the FIFO, 34.16.1.
const WINDOW_WORDS: usize = 1024;
/// Rows before the FIFO windows.
const PLAIN_ROWS: usize = 128;
/// Rows of the table.
const ROWS: usize = PLAIN_ROWS + ENDPOINTS * WINDOW_WORDS;

/// The OTG_FS core on the chip's bus, RM0090 table 1 and table 62. Interrupt 42 is the
/// wakeup, 67 the core.
pub static PERIPHERAL: Peripheral = Peripheral {
    name: "OTG_FS_GLOBAL",
    base: 0x5000_0000,
    size: 0x4_0000,
    interrupts: &[42, 67],
    registers: &REGISTERS,
};

/// A register by name; endpoints and FIFOs by number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // The names are the manual's own.
pub enum Register {
    Gotgctl,
    Gotgint,
    Gahbcfg,
    Gusbcfg,
    Grstctl,
    Gintsts,
    Gintmsk,
    Grxstsr,
    Grxstsp,
    Grxfsiz,
    Hnptxsts,
    Gccfg,
    Cid,
    Hptxfsiz,
    /// Size of the transmit FIFO of this number.
    Dieptxf(u8),
    Dcfg,
    Dctl,
    Dsts,
    Diepmsk,
    Doepmsk,
    Daint,
    Daintmsk,
    Dvbusdis,
    Dvbuspulse,
    Diepempmsk,
    Pcgcctl,
    Diepctl(u8),
    Diepint(u8),
    Dieptsiz(u8),
    Dtxfsts(u8),
    Doepctl(u8),
    Doepint(u8),
    Doeptsiz(u8),
    /// A register of host mode, which is stored only.
    Host(u8),
    /// The data FIFO of this endpoint: a read takes from the receive FIFO, a write adds to
    /// the transmit FIFO.
    Fifo(u8),
}

const SINGLE: [Register; 25] = [
    Register::Gotgctl,
    Register::Gotgint,
    Register::Gahbcfg,
    Register::Gusbcfg,
    Register::Grstctl,
    Register::Gintsts,
    Register::Gintmsk,
    Register::Grxstsr,
    Register::Grxstsp,
    Register::Grxfsiz,
    Register::Hnptxsts,
    Register::Gccfg,
    Register::Cid,
    Register::Hptxfsiz,
    Register::Dcfg,
    Register::Dctl,
    Register::Dsts,
    Register::Diepmsk,
    Register::Doepmsk,
    Register::Daint,
    Register::Daintmsk,
    Register::Dvbusdis,
    Register::Dvbuspulse,
    Register::Diepempmsk,
    Register::Pcgcctl,
];
/// First row of each group after the single registers.
const DIEPTXF: usize = SINGLE.len();
const DIEPCTL: usize = DIEPTXF + ENDPOINTS;
const DIEPINT: usize = DIEPCTL + ENDPOINTS;
const DIEPTSIZ: usize = DIEPINT + ENDPOINTS;
const DTXFSTS: usize = DIEPTSIZ + ENDPOINTS;
const DOEPCTL: usize = DTXFSTS + ENDPOINTS;
const DOEPINT: usize = DOEPCTL + ENDPOINTS;
const DOEPTSIZ: usize = DOEPINT + ENDPOINTS;
const HOST: usize = DOEPTSIZ + ENDPOINTS;
const HOST_ROWS: usize = 7 + 4 * 12;
const _: () = assert!(HOST + HOST_ROWS == PLAIN_ROWS);

impl Layout for Register {
    const REGISTERS: &'static [RegisterSpec] = &REGISTERS;

    fn from_index(index: usize) -> Option<Self> {
        if let Some(register) = SINGLE.get(index) {
            return Some(*register);
        }
        if index >= PLAIN_ROWS {
            return (index < ROWS).then(|| Self::Fifo(((index - PLAIN_ROWS) / WINDOW_WORDS) as u8));
        }
        if index >= HOST {
            return Some(Self::Host((index - HOST) as u8));
        }
        let number = ((index - DIEPTXF) % ENDPOINTS) as u8;
        Some(match (index - DIEPTXF) / ENDPOINTS {
            0 => Self::Dieptxf(number),
            1 => Self::Diepctl(number),
            2 => Self::Diepint(number),
            3 => Self::Dieptsiz(number),
            4 => Self::Dtxfsts(number),
            5 => Self::Doepctl(number),
            6 => Self::Doepint(number),
            _ => Self::Doeptsiz(number),
        })
    }

    fn index(self) -> usize {
        match self {
            Self::Gotgctl => 0,
            Self::Gotgint => 1,
            Self::Gahbcfg => 2,
            Self::Gusbcfg => 3,
            Self::Grstctl => 4,
            Self::Gintsts => 5,
            Self::Gintmsk => 6,
            Self::Grxstsr => 7,
            Self::Grxstsp => 8,
            Self::Grxfsiz => 9,
            Self::Hnptxsts => 10,
            Self::Gccfg => 11,
            Self::Cid => 12,
            Self::Hptxfsiz => 13,
            Self::Dcfg => 14,
            Self::Dctl => 15,
            Self::Dsts => 16,
            Self::Diepmsk => 17,
            Self::Doepmsk => 18,
            Self::Daint => 19,
            Self::Daintmsk => 20,
            Self::Dvbusdis => 21,
            Self::Dvbuspulse => 22,
            Self::Diepempmsk => 23,
            Self::Pcgcctl => 24,
            Self::Dieptxf(number) => DIEPTXF + usize::from(number),
            Self::Diepctl(number) => DIEPCTL + usize::from(number),
            Self::Diepint(number) => DIEPINT + usize::from(number),
            Self::Dieptsiz(number) => DIEPTSIZ + usize::from(number),
            Self::Dtxfsts(number) => DTXFSTS + usize::from(number),
            Self::Doepctl(number) => DOEPCTL + usize::from(number),
            Self::Doepint(number) => DOEPINT + usize::from(number),
            Self::Doeptsiz(number) => DOEPTSIZ + usize::from(number),
            Self::Host(number) => HOST + usize::from(number),
            Self::Fifo(number) => PLAIN_ROWS + usize::from(number) * WINDOW_WORDS,
        }
    }
}

const fn row(
    name: &'static str,
    offset: usize,
    reset: u64,
    access: Access,
    fields: &'static [FieldSpec],
) -> RegisterSpec {
    RegisterSpec {
        name,
        offset: offset as u32,
        width: Width::W32,
        reset,
        access,
        read: ReadAction::None,
        write: WriteModify::None,
        fields,
    }
}

const RW: Access = Access::ReadWrite;
const RO: Access = Access::ReadOnly;

const DIEPTXF_NAMES: [&str; ENDPOINTS] = ["DIEPTXF0", "DIEPTXF1", "DIEPTXF2", "DIEPTXF3", "DIEPTXF4", "DIEPTXF5"];
const DIEPCTL_NAMES: [&str; ENDPOINTS] = ["DIEPCTL0", "DIEPCTL1", "DIEPCTL2", "DIEPCTL3", "DIEPCTL4", "DIEPCTL5"];
const DIEPINT_NAMES: [&str; ENDPOINTS] = ["DIEPINT0", "DIEPINT1", "DIEPINT2", "DIEPINT3", "DIEPINT4", "DIEPINT5"];
const DIEPTSIZ_NAMES: [&str; ENDPOINTS] =
    ["DIEPTSIZ0", "DIEPTSIZ1", "DIEPTSIZ2", "DIEPTSIZ3", "DIEPTSIZ4", "DIEPTSIZ5"];
const DTXFSTS_NAMES: [&str; ENDPOINTS] = ["DTXFSTS0", "DTXFSTS1", "DTXFSTS2", "DTXFSTS3", "DTXFSTS4", "DTXFSTS5"];
const DOEPCTL_NAMES: [&str; ENDPOINTS] = ["DOEPCTL0", "DOEPCTL1", "DOEPCTL2", "DOEPCTL3", "DOEPCTL4", "DOEPCTL5"];
const DOEPINT_NAMES: [&str; ENDPOINTS] = ["DOEPINT0", "DOEPINT1", "DOEPINT2", "DOEPINT3", "DOEPINT4", "DOEPINT5"];
const DOEPTSIZ_NAMES: [&str; ENDPOINTS] =
    ["DOEPTSIZ0", "DOEPTSIZ1", "DOEPTSIZ2", "DOEPTSIZ3", "DOEPTSIZ4", "DOEPTSIZ5"];
const FIFO_NAMES: [&str; ENDPOINTS] = ["DFIFO0", "DFIFO1", "DFIFO2", "DFIFO3", "DFIFO4", "DFIFO5"];
const CHANNEL_NAMES: [&str; 4] = ["HCCHAR", "HCINT", "HCINTMSK", "HCTSIZ"];
const CHANNEL_OFFSETS: [usize; 4] = [0x00, 0x08, 0x0C, 0x10];

/// Builds the table. Resets as section 34.16 gives them.
const fn table() -> [RegisterSpec; ROWS] {
    let mut table = [row("", 0, 0, RW, &[]); ROWS];
    table[0] = row("GOTGCTL", 0x000, 0x0001_0000, RW, fields::gotgctl::ALL);
    table[1] = row("GOTGINT", 0x004, 0, RW, fields::gotgint::ALL);
    table[2] = row("GAHBCFG", 0x008, 0, RW, fields::gahbcfg::ALL);
    table[3] = row("GUSBCFG", 0x00C, 0x0000_0A00, RW, fields::gusbcfg::ALL);
    table[4] = row("GRSTCTL", 0x010, 0x8000_0000, RW, fields::grstctl::ALL);
    table[5] = row("GINTSTS", 0x014, 0x0400_0020, RW, fields::gintsts::ALL);
    table[6] = row("GINTMSK", 0x018, 0, RW, fields::gintmsk::ALL);
    table[7] = row("GRXSTSR", 0x01C, 0, RO, fields::grxsts::ALL);
    table[8] = row("GRXSTSP", 0x020, 0, RO, fields::grxsts::ALL);
    table[9] = row("GRXFSIZ", 0x024, 0x0000_0200, RW, fields::grxfsiz::ALL);
    table[10] = row("HNPTXSTS", 0x02C, 0x0008_0200, RO, &[]);
    table[11] = row("GCCFG", 0x038, 0, RW, fields::gccfg::ALL);
    table[12] = row("CID", 0x03C, 0x0000_1200, RO, &[]);
    table[13] = row("HPTXFSIZ", 0x100, 0x0200_0600, RW, &[]);
    table[14] = row("DCFG", 0x800, 0x0220_0000, RW, fields::dcfg::ALL);
    table[15] = row("DCTL", 0x804, 0, RW, fields::dctl::ALL);
    table[16] = row("DSTS", 0x808, 0x0000_0010, RO, fields::dsts::ALL);
    table[17] = row("DIEPMSK", 0x810, 0, RW, fields::diepmsk::ALL);
    table[18] = row("DOEPMSK", 0x814, 0, RW, fields::doepmsk::ALL);
    table[19] = row("DAINT", 0x818, 0, RO, fields::daint::ALL);
    table[20] = row("DAINTMSK", 0x81C, 0, RW, fields::daint::ALL);
    table[21] = row("DVBUSDIS", 0x828, 0x0000_17D7, RW, &[]);
    table[22] = row("DVBUSPULSE", 0x82C, 0x0000_05B8, RW, &[]);
    table[23] = row("DIEPEMPMSK", 0x834, 0, RW, fields::diepempmsk::ALL);
    table[24] = row("PCGCCTL", 0xE00, 0, RW, fields::pcgcctl::ALL);
    let mut number = 0;
    while number < ENDPOINTS {
        let size_at = if number == 0 { 0x028 } else { 0x100 + 4 * number };
        // 34.16.2 gives FIFO 0 its own reset value, and one to all others.
        let size = if number == 0 { 0x0000_0200 } else { 0x0200_0400 };
        table[DIEPTXF + number] = row(DIEPTXF_NAMES[number], size_at, size, RW, fields::dieptxf::ALL);
        let (to_host, from_host) = (0x900 + 0x20 * number, 0xB00 + 0x20 * number);
        // Endpoint 0 is always active: USBAEP reads one.
        let (active, in_control, out_control, in_size, out_size) = if number == 0 {
            (0x0000_8000, fields::diepctl0::ALL, fields::doepctl0::ALL, fields::dieptsiz0::ALL, fields::doeptsiz0::ALL)
        } else {
            (0, fields::epctl::ALL, fields::epctl::ALL, fields::eptsiz::ALL, fields::eptsiz::ALL)
        };
        table[DIEPCTL + number] = row(DIEPCTL_NAMES[number], to_host, active, RW, in_control);
        table[DIEPINT + number] = row(DIEPINT_NAMES[number], to_host + 0x08, 0, RW, fields::diepint::ALL);
        table[DIEPTSIZ + number] = row(DIEPTSIZ_NAMES[number], to_host + 0x10, 0, RW, in_size);
        table[DTXFSTS + number] = row(DTXFSTS_NAMES[number], to_host + 0x18, 0, RO, fields::dtxfsts::ALL);
        table[DOEPCTL + number] = row(DOEPCTL_NAMES[number], from_host, active, RW, out_control);
        table[DOEPINT + number] = row(DOEPINT_NAMES[number], from_host + 0x08, 0, RW, fields::doepint::ALL);
        table[DOEPTSIZ + number] = row(DOEPTSIZ_NAMES[number], from_host + 0x10, 0, RW, out_size);
        let mut word = 0;
        while word < WINDOW_WORDS {
            table[PLAIN_ROWS + number * WINDOW_WORDS + word] =
                row(FIFO_NAMES[number], 0x1000 * (number + 1) + 4 * word, 0, RW, &[]);
            word += 1;
        }
        number += 1;
    }
    table[HOST] = row("HCFG", 0x400, 0, RW, &[]);
    table[HOST + 1] = row("HFIR", 0x404, 0x0000_EA60, RW, &[]);
    table[HOST + 2] = row("HFNUM", 0x408, 0x0000_3FFF, RO, &[]);
    table[HOST + 3] = row("HPTXSTS", 0x410, 0x0008_0100, RO, &[]);
    table[HOST + 4] = row("HAINT", 0x414, 0, RO, &[]);
    table[HOST + 5] = row("HAINTMSK", 0x418, 0, RW, &[]);
    table[HOST + 6] = row("HPRT", 0x440, 0, RW, &[]);
    let mut cell = 0;
    while cell < HOST_ROWS - 7 {
        let (channel, part) = (cell / 4, cell % 4);
        table[HOST + 7 + cell] = row(CHANNEL_NAMES[part], 0x500 + 0x20 * channel + CHANNEL_OFFSETS[part], 0, RW, &[]);
        cell += 1;
    }
    table
}

/// Every register of the core. Rows that one name shares (host channels, words of a window) differ
/// in their offset.
pub static REGISTERS: [RegisterSpec; ROWS] = table();

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_register_stands_in_its_own_row() {
        for (index, row) in REGISTERS.iter().enumerate().take(PLAIN_ROWS) {
            let register = Register::from_index(index).unwrap();
            assert_eq!(register.index(), index, "{register:?}");
            assert!(!row.name.is_empty(), "row {index} is filled");
        }
        assert_eq!(Register::from_index(PLAIN_ROWS + WINDOW_WORDS - 1), Some(Register::Fifo(0)));
        assert_eq!(Register::from_index(PLAIN_ROWS + WINDOW_WORDS), Some(Register::Fifo(1)));
        assert_eq!(Register::from_index(ROWS), None);
    }

    #[test]
    fn the_offsets_are_the_manuals() {
        for (register, name, offset) in [
            (Register::Dieptxf(0), "DIEPTXF0", 0x028),
            (Register::Dieptxf(3), "DIEPTXF3", 0x10C),
            (Register::Diepctl(1), "DIEPCTL1", 0x920),
            (Register::Dtxfsts(3), "DTXFSTS3", 0x978),
            (Register::Doepctl(0), "DOEPCTL0", 0xB00),
            (Register::Doeptsiz(3), "DOEPTSIZ3", 0xB70),
            (Register::Diepempmsk, "DIEPEMPMSK", 0x834),
            (Register::Pcgcctl, "PCGCCTL", 0xE00),
            (Register::Fifo(2), "DFIFO2", 0x3000),
        ] {
            assert_eq!((register.spec().name, register.spec().offset), (name, offset));
        }
    }

    #[test]
    fn no_two_registers_share_an_address() {
        let mut offsets: Vec<u32> = REGISTERS.iter().map(|register| register.offset).collect();
        offsets.sort_unstable();
        offsets.dedup();
        assert_eq!(offsets.len(), ROWS);
    }
}
