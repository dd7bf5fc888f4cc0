//! The power fails at every word and every erasure: afterwards the old record or the new one is
//! read.
#![allow(clippy::unwrap_used)]

use ferrostep_settings::{
    Cut, Entry, MAX_BYTES, MemoryFlash, NOT_WORKING, RecordWriter, SLOT_BYTES, Store, StoreError,
};

const SECTOR: usize = 4 * SLOT_BYTES;
const SECTORS: usize = 2;
type Flash = MemoryFlash<Vec<u8>, SECTOR>;

fn store(flash: Flash) -> Store<Flash> {
    Store::new(flash).unwrap()
}

fn load(store: &mut Store<Flash>) -> Option<Vec<u8>> {
    store.load(&mut [0; SLOT_BYTES]).unwrap().map(<[u8]>::to_vec)
}

/// A record that differs from all others, of 1 to 12 values.
fn record(number: u32) -> Vec<u8> {
    let mut record = RecordWriter::new("corexy");
    for index in 0..=(number % 12) as u8 {
        record.add(Entry { id: 7, index, value: f64::from(number) + f64::from(index) / 16.0 });
    }
    record.bytes().to_vec()
}

/// Saves `record` while the power fails at `cut`; returns the flash afterwards.
fn save_until(bytes: &[u8], cut: Cut, record: &[u8]) -> Vec<u8> {
    let mut store = store(Flash::new(bytes.to_vec()).with_cut(cut));
    assert_eq!(store.save(record), Err(StoreError::Memory(NOT_WORKING)), "{cut:?}: the power went");
    store.into_flash().into_bytes()
}

/// Every word and erasure of 1,000 saves, which go round the sectors 125 times. At each, the power
/// fails before it and, with four seeds, in its midst. Every seventh time, the next save begins
/// with what such a cut has left.
#[test]
fn a_cut_leaves_the_old_record_or_the_new_one() {
    let (mut cuts, mut news, mut in_erasures, mut seed) = (0_u32, 0_u32, 0_u32, 1);
    // The previous content of a chip does not matter.
    let mut bytes: Vec<u8> = (0..SECTORS * SECTOR).map(|at| (at * at) as u8).collect();
    for number in 0..1_000 {
        let old = load(&mut store(Flash::new(bytes.clone())));
        let new = record(number);
        let mut whole = store(Flash::new(bytes.clone()));
        whole.save(&new).unwrap();
        assert_eq!(load(&mut whole).as_ref(), Some(&new));
        let flash = whole.into_flash();
        let erases = flash.erasures() > 0;
        let mut left = flash.clone().into_bytes();
        for operations in 0..flash.operations() {
            for part in 0..5 {
                seed += 1;
                let cut = Cut { operations, half: (part > 0).then_some(seed) };
                left = save_until(&bytes, cut, &new);
                cuts += 1;
                in_erasures += u32::from(erases && operations == 0 && part > 0);
                let mut after = store(Flash::new(left.clone()));
                let read = load(&mut after);
                assert!(read == old || read.as_ref() == Some(&new), "{number}, {cut:?}: {read:?}");
                news += u32::from(read != old);
                let next = record(number + 1);
                after.save(&next).unwrap();
                assert_eq!(load(&mut after), Some(next), "{number}, {cut:?}: storing works again");
            }
        }
        bytes = if number % 7 == 6 { left } else { flash.into_bytes() };
    }
    println!("{cuts} cuts, {in_erasures} of them within an erasure; {news} left the new record");
    assert!(cuts >= 100_000 && in_erasures >= 500 && news > 0, "{cuts}, {in_erasures}, {news}");
}

/// All sectors are erased equally often, and once for all their slots.
#[test]
fn sectors_wear_alike() {
    let saves = 4_000;
    let mut store = store(Flash::new(vec![0xff; SECTORS * SECTOR]));
    for number in 0..saves {
        store.save(&record(number)).unwrap();
    }
    assert_eq!(load(&mut store), Some(record(saves - 1)));
    assert_eq!(store.into_flash().erasures(), saves / 4);
}

#[test]
fn the_longest_record_is_stored_and_a_longer_one_refused() {
    let mut store = store(Flash::new(vec![0xff; SECTORS * SECTOR]));
    let longest = vec![0xa5; MAX_BYTES];
    store.save(&longest).unwrap();
    assert_eq!(store.save(&vec![0; MAX_BYTES + 1]), Err(StoreError::TooLong));
    assert_eq!(store.save(&vec![0; 100_000]), Err(StoreError::TooLong));
    assert_eq!(load(&mut store), Some(longest));
    store.save(&[]).unwrap();
    assert_eq!(load(&mut store), Some(vec![]));
}

#[test]
fn sectors_that_are_none_are_refused() {
    for bytes in [0, SECTOR, 2 * SECTOR - 4, 2 * SECTOR + SLOT_BYTES] {
        assert_eq!(Store::new(Flash::new(vec![0xff; bytes])).err(), Some(StoreError::Sectors), "{bytes}");
    }
    // A slot does not fit a sector.
    let small = MemoryFlash::<_, 512>::new(vec![0xff; 4096]);
    assert_eq!(Store::new(small).err(), Some(StoreError::Sectors));
}

/// A record with a wrong bit is skipped, and the previous one is read.
#[test]
fn a_wrong_bit_makes_the_record_before_it_the_newest() {
    let mut store = store(Flash::new(vec![0xff; SECTORS * SECTOR]));
    let [old, new] = [record(3), record(4)];
    store.save(&old).unwrap();
    store.save(&new).unwrap();
    let bytes = store.into_flash().into_bytes();
    for bit in 0..8 * (12 + new.len()) {
        let mut bytes = bytes.clone();
        bytes[SLOT_BYTES + bit / 8] ^= 1 << (bit % 8);
        assert_eq!(load(&mut self::store(Flash::new(bytes))).as_ref(), Some(&old), "bit {bit}");
    }
}
