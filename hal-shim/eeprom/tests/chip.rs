//! The EEPROM driver against a transfer-level model of the chip: pages, write cycles, and power
//! cuts.
#![allow(clippy::unwrap_used)]

use std::cell::RefCell;

use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
use ferrostep_eeprom::{BUS_HZ, BYTES, Eeprom, EepromFault, PAGE_BYTES, SECTOR_BYTES};
use ferrostep_settings::{Entry, MAX_BYTES, MAX_VALUES, RecordWriter, SLOT_BYTES, Store, StoreError, next_random};

/// Longest write time of any 24C32, s.
const WRITE_S: f64 = 0.010;

/// Moment at which the power fails.
#[derive(Clone, Copy, Debug)]
struct Cut {
    /// Number of pages still written before the cut.
    pages: u32,
    /// Seed of the contents of the page during whose write the power fails; `None`: the power fails
    /// before the stop condition, which begins the write.
    within: Option<u32>,
}

/// A 24C32 as its data sheet describes it (AT24C32E: device addressing, page write, acknowledge
/// polling, sequential read).
struct Chip {
    address: u8,
    bytes: Vec<u8>,
    pointer: usize,
    /// Number of transfers left unacknowledged after a page.
    cycle: u32,
    busy: u32,
    is_protected: bool,
    refuses_data: bool,
    is_stuck: bool,
    cut: Option<Cut>,
    is_off: bool,
    pages: u32,
    clocks: u64,
    is_asked: u64,
}

impl Chip {
    fn new(bytes: Vec<u8>) -> Self {
        Self {
            address: 0x50,
            bytes,
            pointer: 0,
            cycle: 3,
            busy: 0,
            is_protected: false,
            refuses_data: false,
            is_stuck: false,
            cut: None,
            is_off: false,
            pages: 0,
            clocks: 0,
            is_asked: 0,
        }
    }

    fn erased() -> Self {
        Self::new(vec![0xff; BYTES])
    }

    fn hear(&mut self, bytes: &[u8]) -> Result<(), ErrorKind> {
        let [high, low, data @ ..] = bytes else { panic!("a write names an address: {bytes:x?}") };
        self.pointer = (usize::from(*high) << 8 | usize::from(*low)) % BYTES;
        if data.is_empty() {
            return Ok(());
        }
        if self.refuses_data {
            return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data));
        }
        if self.is_protected {
            return Ok(());
        }
        let page = self.pointer - self.pointer % PAGE_BYTES;
        let places: Vec<usize> = (0..data.len()).map(|byte| page + (self.pointer + byte) % PAGE_BYTES).collect();
        if let Some(Cut { pages, within }) = self.cut
            && pages == self.pages
        {
            self.is_off = true;
            // The chip first erases the whole page, which takes time as well.
            if let Some(mut seed) = within {
                for place in page..page + PAGE_BYTES {
                    let old = self.bytes[place];
                    let new = places.iter().position(|to| *to == place).map_or(old, |byte| data[byte]);
                    self.bytes[place] = match next_random(&mut seed) >> 8 & 7 {
                        0 => old,
                        1 => 0xff,
                        2 => 0,
                        3 => next_random(&mut seed) as u8,
                        4 => new & next_random(&mut seed) as u8,
                        _ => new,
                    };
                }
            }
            return Err(ErrorKind::Bus);
        }
        for (place, byte) in places.into_iter().zip(data) {
            self.bytes[place] = *byte;
        }
        self.pages += 1;
        self.busy = self.cycle;
        Ok(())
    }
}

struct Bus<'a>(&'a RefCell<Chip>);

impl ErrorType for Bus<'_> {
    type Error = ErrorKind;
}

impl I2c for Bus<'_> {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        let mut chip = self.0.borrow_mut();
        chip.is_asked += 1;
        // Start, address, stop.
        chip.clocks += 11;
        if chip.is_stuck || chip.is_off {
            return Err(ErrorKind::Bus);
        }
        if address != chip.address || chip.busy > 0 {
            chip.busy = chip.busy.saturating_sub(1);
            return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address));
        }
        // Consecutive writes form one run of bytes.
        let mut heard = Vec::new();
        for operation in operations.iter() {
            if let Operation::Write(bytes) = operation {
                heard.extend_from_slice(bytes);
            }
        }
        chip.clocks += 9 * heard.len() as u64;
        chip.hear(&heard)?;
        for operation in operations {
            match operation {
                Operation::Write(_) => {}
                Operation::Read(bytes) => {
                    chip.clocks += 10 + 9 * bytes.len() as u64;
                    for byte in bytes.iter_mut() {
                        *byte = chip.bytes[chip.pointer];
                        chip.pointer = (chip.pointer + 1) % BYTES;
                    }
                }
            }
        }
        Ok(())
    }
}

fn with<T>(chip: &RefCell<Chip>, act: impl FnOnce(&mut Eeprom<Bus<'_>>) -> T) -> T {
    act(&mut Eeprom::new(Bus(chip), 0x50))
}

fn save(chip: &RefCell<Chip>, record: &[u8]) -> Result<(), StoreError> {
    Store::new(Eeprom::new(Bus(chip), 0x50)).unwrap().save(record)
}

fn load(chip: &RefCell<Chip>) -> Result<Option<Vec<u8>>, StoreError> {
    let mut slot = [0; SLOT_BYTES];
    Ok(Store::new(Eeprom::new(Bus(chip), 0x50)).unwrap().load(&mut slot)?.map(<[u8]>::to_vec))
}

/// A unique record of 1 to 80 values.
fn record(number: u32) -> Vec<u8> {
    let mut record = RecordWriter::new("corexy");
    for index in 0..=(number * 7 % MAX_VALUES as u32) as u8 {
        assert!(record.add(Entry { id: 7, index, value: f64::from(number) + f64::from(index) / 16.0 }));
    }
    record.bytes().to_vec()
}

#[test]
fn bytes_come_back_wherever_they_lie() {
    let chip = RefCell::new(Chip::erased());
    let mut expected = vec![0xff; BYTES];
    for (offset, length) in [(0, 1), (31, 2), (33, 30), (100, 200), (1023, 66), (BYTES - 40, 40), (64, 32)] {
        let bytes: Vec<u8> = (0..length).map(|byte| (offset + 3 * byte) as u8).collect();
        with(&chip, |eeprom| eeprom.write(offset as u32, &bytes)).unwrap();
        expected[offset..offset + length].copy_from_slice(&bytes);
        assert_eq!(chip.borrow().bytes, expected, "{offset}, {length}");
        let mut read = vec![0; length];
        with(&chip, |eeprom| eeprom.read(offset as u32, &mut read)).unwrap();
        assert_eq!(read, bytes);
    }
    with(&chip, |eeprom| eeprom.erase(1024, 2048)).unwrap();
    expected[1024..2048].fill(0xff);
    assert_eq!(chip.borrow().bytes, expected);
    let mut all = vec![0; BYTES];
    with(&chip, |eeprom| eeprom.read(0, &mut all)).unwrap();
    assert_eq!(all, expected);
    with(&chip, |eeprom| eeprom.read(BYTES as u32, &mut [])).unwrap();
}

#[test]
fn what_it_does_not_have_is_refused() {
    let chip = RefCell::new(Chip::erased());
    for (offset, length) in [(BYTES, 1), (BYTES - 1, 2), (0, BYTES + 1), (u32::MAX as usize, 8)] {
        let mut bytes = vec![0; length];
        assert_eq!(with(&chip, |eeprom| eeprom.read(offset as u32, &mut bytes)), Err(EepromFault::Place));
        assert_eq!(with(&chip, |eeprom| eeprom.write(offset as u32, &bytes)), Err(EepromFault::Place));
    }
    for (from, to) in [(0, 5 * SECTOR_BYTES), (32, SECTOR_BYTES), (SECTOR_BYTES, 0)] {
        assert_eq!(with(&chip, |eeprom| eeprom.erase(from as u32, to as u32)), Err(EepromFault::Place));
    }
    assert_eq!((chip.borrow().is_asked, chip.borrow().bytes.clone()), (0, vec![0xff; BYTES]));
}

/// Breaks a chip.
type Break = fn(&mut Chip);

/// Every fault has its own message, and takes a bounded number of transfers.
#[test]
fn faults_are_named_and_bounded() {
    let faults: [(Break, &str); 5] = [
        (|chip| chip.address = 0x51, "the EEPROM does not answer"),
        (|chip| chip.is_stuck = true, "a line of the EEPROM (SCL or SDA) stays low"),
        (|chip| chip.refuses_data = true, "the EEPROM refuses to be written (write-protected?)"),
        (|chip| chip.is_protected = true, "the memory for settings does not work"),
        (|chip| chip.cycle = u32::MAX, "the EEPROM does not answer"),
    ];
    for (change, words) in faults {
        let chip = RefCell::new(Chip::erased());
        save(&chip, &record(1)).unwrap();
        chip.borrow_mut().busy = 0;
        chip.borrow_mut().is_asked = 0;
        change(&mut chip.borrow_mut());
        assert_eq!(save(&chip, &record(2)).unwrap_err().to_string(), words);
        assert!(chip.borrow().is_asked < 400, "{words}: {} transfers", chip.borrow().is_asked);
    }
    // The driver waits out the longest write: the permitted address polls alone take twice its
    // time.
    let chip = RefCell::new(Chip::erased());
    chip.borrow_mut().cycle = (2.0 * WRITE_S * f64::from(BUS_HZ) / 11.0) as u32;
    save(&chip, &record(2)).unwrap();
    assert_eq!(load(&chip), Ok(Some(record(2))));
}

/// Cuts the power at every page of 240 saves of 1 to 80 values, which go round the sectors 60
/// times: once before the page's write and, with six seeds, during it, which leaves anything in the
/// page. Every fifth time the next save begins with the contents left by such a cut.
#[test]
fn a_cut_leaves_the_old_record_or_the_new_one() {
    let (mut cuts, mut news, mut seed) = (0_u32, 0_u32, 1);
    // Earlier contents of the chip, such as Marlin's settings, have no influence.
    let mut bytes: Vec<u8> = (0..BYTES).map(|at| (at * at) as u8).collect();
    for number in 0..240 {
        let chip = RefCell::new(Chip::new(bytes.clone()));
        let old = load(&chip).unwrap();
        let new = record(number);
        save(&chip, &new).unwrap();
        assert_eq!(load(&chip), Ok(Some(new.clone())));
        let pages = chip.borrow().pages;
        let mut left = Vec::new();
        for page in 0..pages {
            for part in 0..7 {
                seed += 1;
                let cut = Cut { pages: page, within: (part > 0).then_some(seed) };
                let chip = RefCell::new(Chip { cut: Some(cut), ..Chip::new(bytes.clone()) });
                assert!(save(&chip, &new).is_err(), "{cut:?}: the power went");
                left = chip.into_inner().bytes;
                cuts += 1;
                let after = RefCell::new(Chip::new(left.clone()));
                let read = load(&after).unwrap();
                assert!(read == old || read.as_ref() == Some(&new), "{number}, {cut:?}: {read:?}");
                news += u32::from(read != old);
                if part == 0 {
                    let next = record(number + 1);
                    save(&after, &next).unwrap();
                    assert_eq!(load(&after), Ok(Some(next)), "{number}, {cut:?}: storing works again");
                }
            }
        }
        bytes = if number % 5 == 4 { left } else { chip.into_inner().bytes };
    }
    println!("{cuts} cuts; {news} left the new record");
    assert!(cuts >= 60_000 && news > 0, "{cuts}, {news}");
}

/// Times given in the book (docs/src/settings.md), for a 100 kHz bus and the slowest chip.
#[test]
fn the_longest_record_fits_and_takes_less_than_two_seconds() {
    let seconds = |chip: &RefCell<Chip>| {
        let mut chip = chip.borrow_mut();
        let time_s = chip.clocks as f64 / f64::from(BUS_HZ) + f64::from(chip.pages) * WRITE_S;
        (chip.clocks, chip.pages) = (0, 0);
        time_s
    };
    let longest = vec![0xa5; MAX_BYTES];
    let chip = RefCell::new(Chip { cycle: 0, ..Chip::erased() });
    // All four sectors hold a record.
    for number in 0..4 {
        save(&chip, &[&longest[1..], &[number]].concat()).unwrap();
    }
    seconds(&chip);
    save(&chip, &longest).unwrap();
    let longest_save_s = seconds(&chip);
    assert_eq!(load(&chip), Ok(Some(longest)));
    let longest_load_s = seconds(&chip);
    save(&chip, &record(0)).unwrap();
    seconds(&chip);
    save(&chip, &record(0)).unwrap();
    println!(
        "longest record: saved in {longest_save_s:.2} s, read in {longest_load_s:.2} s; one value {:.2} s",
        seconds(&chip)
    );
    assert!(longest_save_s < 2.0 && longest_load_s < 0.5, "{longest_save_s}, {longest_load_s}");
}

/// All pages wear evenly: a cell is written twice in 4 saves.
#[test]
fn sectors_wear_alike() {
    let chip = RefCell::new(Chip::erased());
    for number in 0..40 {
        save(&chip, &record(number)).unwrap();
        let sector = number as usize % 4;
        let head = &chip.borrow().bytes[sector * SECTOR_BYTES..][..4];
        assert_eq!(head, (number + 1).to_le_bytes());
    }
}

#[test]
fn an_erasure_leaves_the_bytes_beside_it() {
    let chip = RefCell::new(Chip::new(vec![0; BYTES]));
    with(&chip, |eeprom| eeprom.erase(1024, 2048)).unwrap();
    let chip = chip.borrow();
    assert!(chip.bytes[1024..2048].iter().all(|byte| *byte == 0xff));
    assert!(chip.bytes[..1024].iter().chain(&chip.bytes[2048..]).all(|byte| *byte == 0));
}
