#![allow(clippy::unwrap_used)]

use std::cell::Cell;
use std::rc::Rc;

use super::model::{Faults, Model};
use super::*;

struct Bench {
    slot: SdioSlot<Model, Box<dyn Fn() -> u32>>,
    faults: Rc<Cell<Faults>>,
    ticks: Rc<Cell<u64>>,
}

/// A card of 2 MiB. Each look at the clock takes a microsecond.
fn bench(is_version_2: bool) -> Bench {
    let memory: &'static BlockMemory = Box::leak(Box::default());
    let image = (0..2 << 20_usize).map(|place| ((place * 7) >> 3) as u8).collect();
    let model = Model::new(image, is_version_2, memory);
    let (faults, ticks) = (Rc::clone(&model.faults), Rc::<Cell<u64>>::default());
    let clock = Rc::clone(&ticks);
    let now: Box<dyn Fn() -> u32> = Box::new(move || {
        clock.set(clock.get() + u64::from(MS) / 1000);
        clock.get() as u32
    });
    Bench { slot: SdioSlot::new(model, now, memory, 0x2000_0000, Some((2, 14))), faults, ticks }
}

fn block(bench: &Bench, index: u32) -> Result<Vec<u8>, CardError> {
    let mut blocks = [Block::new()];
    bench.slot.read(&mut blocks, BlockIdx(index))?;
    Ok(blocks[0].contents.to_vec())
}

#[test]
fn old_and_new_cards_are_read_and_written() {
    for is_version_2 in [false, true] {
        let bench = bench(is_version_2);
        assert_eq!(block(&bench, 0), Err(CardError::Missing), "not started");
        bench.slot.start().unwrap();
        assert!(bench.slot.is_still_started());
        assert_eq!(bench.slot.num_blocks().unwrap(), BlockCount(4096));
        for index in [0, 1, 4095] {
            let expected: Vec<u8> = (0..512).map(|place| (((index as usize * 512 + place) * 7) >> 3) as u8).collect();
            assert_eq!(block(&bench, index).unwrap(), expected);
        }
        assert_eq!(block(&bench, 4096), Err(CardError::Damaged));
        let mut written = Block::new();
        written.contents.iter_mut().enumerate().for_each(|(place, byte)| *byte = place as u8 ^ 0x5a);
        bench.slot.write(std::slice::from_ref(&written), BlockIdx(77)).unwrap();
        assert_eq!(block(&bench, 77).unwrap(), written.contents);
        assert_eq!(bench.slot.0.borrow().registers.written, 1);
    }
}

#[test]
fn every_wait_ends() {
    let faults = [
        (Faults { missing: true, ..Faults::default() }, CardError::Missing),
        (Faults { silent: true, ..Faults::default() }, CardError::Silent),
        (Faults { bad_block: true, ..Faults::default() }, CardError::Garbled),
        (Faults { no_stream: true, ..Faults::default() }, CardError::Garbled),
        (Faults { no_end: true, ..Faults::default() }, CardError::Silent),
        (Faults { stays_busy: true, ..Faults::default() }, CardError::Silent),
    ];
    let most_ticks = u64::from(ferrostep_hal_shim::card::MAX_BLOCK_MS) * u64::from(MS);
    for (fault, error) in faults {
        let bench = bench(true);
        bench.slot.start().unwrap();
        bench.faults.set(fault);
        let before = bench.ticks.get();
        let outcome = if fault.stays_busy {
            bench.slot.write(&[Block::new()], BlockIdx(5))
        } else {
            block(&bench, 5).map(|_| ())
        };
        assert_eq!(outcome, Err(error), "{fault:?}");
        assert!(
            bench.ticks.get() - before < most_ticks,
            "{fault:?}: {} ms",
            (bench.ticks.get() - before) / u64::from(MS)
        );
        // Mended, it works again; a card that was gone or stuck needs a start first.
        bench.faults.set(Faults::default());
        assert_eq!(bench.slot.is_still_started(), !(fault.missing || fault.silent || fault.stays_busy), "{fault:?}");
        if !bench.slot.is_still_started() {
            assert_eq!(block(&bench, 5), Err(CardError::Missing), "{fault:?}");
            bench.slot.start().unwrap();
        }
        block(&bench, 5).unwrap();
    }
    for fault in [Faults { never_starts: true, ..Faults::default() }, Faults { silent: true, ..Faults::default() }] {
        let bench = bench(true);
        bench.faults.set(fault);
        let before = bench.ticks.get();
        assert_eq!(bench.slot.start(), Err(CardError::Silent), "{fault:?}");
        assert!(bench.ticks.get() - before < most_ticks, "{fault:?}");
    }
}

#[test]
fn a_card_that_was_pulled_out_is_started_again() {
    let bench = bench(true);
    bench.slot.start().unwrap();
    bench.faults.set(Faults { missing: true, ..Faults::default() });
    assert!(!bench.slot.is_inserted());
    bench.faults.set(Faults::default());
    assert!(bench.slot.is_inserted() && !bench.slot.is_still_started());
    assert_eq!(block(&bench, 0), Err(CardError::Missing));
    bench.slot.start().unwrap();
    assert!(block(&bench, 0).is_ok());
}

#[test]
fn capacities_are_those_of_the_specification() {
    // A card of 2 GB: 2^12 * 2^9 blocks of 1024 bytes; one of 32 GB; a layout to come.
    assert_eq!(capacity([0, 10 << 16 | 0x3ff, 3 << 30 | 7 << 15]), Some(Capacity { blocks: 4 << 20 }));
    assert_eq!(capacity([1 << 30, 0, 0xedc8 << 16]), Some(Capacity { blocks: 62_333_952 }));
    assert_eq!(capacity([2 << 30, 0, 0]), None);
    assert_eq!(capacity([0, 0, 0]), None);
}
