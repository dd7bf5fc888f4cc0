//! Records of a chip in memory, whose rate differs from the set one.

use std::cell::RefCell;

use ferrostep_hal_shim::AccelerometerType;

use super::*;

const SECOND: u64 = TICKS_PER_SECOND as u64;

/// Samples that its memory holds.
const CAPACITY: u64 = 32;

/// A chip whose samples are counted.
#[derive(Debug, Default)]
struct Chip {
    now_ticks: u64,
    /// Time when it began to sample; `None` at rest.
    since_ticks: Option<u64>,
    rate_hz: u16,
    /// Per thousand that it is faster than it was set.
    fast_per_mille: i64,
    taken: u64,
    lost: u64,
    begun: u32,
    fault: Option<AccelerometerFault>,
    is_deaf: bool,
}

impl Chip {
    fn waiting(&self) -> u64 {
        let Some(since_ticks) = self.since_ticks.filter(|_| !self.is_deaf) else { return 0 };
        let milli_hz = u64::from(self.rate_hz) * (1000 + self.fast_per_mille) as u64;
        let sampled =
            (u128::from(self.now_ticks - since_ticks) * u128::from(milli_hz) / 1000 / u128::from(SECOND)) as u64;
        sampled - self.taken - self.lost
    }
}

/// The bus to it.
#[derive(Debug)]
struct Bus<'a>(&'a RefCell<Chip>);

impl AccelerometerChip for Bus<'_> {
    const TYPE: AccelerometerType =
        AccelerometerType { name: "counted", rates_hz: &[25, 100, 800, 1600, 3200], resolution_bits: &[10, 13] };

    fn check(&mut self) -> Result<(), AccelerometerFault> {
        self.0.borrow().fault.map_or(Ok(()), Err)
    }

    fn begin(&mut self, rate_hz: u16, _: u8) -> Result<(), AccelerometerFault> {
        self.check()?;
        let mut chip = self.0.borrow_mut();
        (chip.rate_hz, chip.taken, chip.lost) = (rate_hz, 0, 0);
        (chip.since_ticks, chip.begun) = (Some(chip.now_ticks), chip.begun + 1);
        Ok(())
    }

    fn end(&mut self) {
        self.0.borrow_mut().since_ticks = None;
    }

    fn waiting(&mut self) -> Result<WaitingSamples, AccelerometerFault> {
        self.check()?;
        let mut chip = self.0.borrow_mut();
        let overflowed = chip.waiting() >= CAPACITY;
        chip.lost += chip.waiting().saturating_sub(CAPACITY);
        Ok(WaitingSamples { samples: chip.waiting() as u8, overflowed })
    }

    fn take(&mut self) -> Result<[i32; 3], AccelerometerFault> {
        self.check()?;
        let mut chip = self.0.borrow_mut();
        chip.taken += 1;
        Ok([(chip.taken + chip.lost - 1) as i32, 0, 1_000_000])
    }
}

/// A recorder, its chip, and its events.
struct Rig<'a> {
    chip: &'a RefCell<Chip>,
    recorder: Recorder<Bus<'a>>,
    heard: Vec<RecordEvent>,
}

impl<'a> Rig<'a> {
    fn new(chip: &'a RefCell<Chip>) -> Self {
        Self { chip, recorder: Recorder::new(Bus(chip)), heard: Vec::new() }
    }

    fn now(&self) -> u32 {
        self.chip.borrow().now_ticks as u32
    }

    fn record(&mut self, samples: u16, at_next_move: bool) -> Result<(), CommandError> {
        self.recorder.record(samples, at_next_move, self.now())
    }

    fn set(&mut self, rate_hz: u16) {
        self.recorder.set(Some(rate_hz), None).unwrap();
    }

    /// Advances time, and takes what there is each time.
    fn pass(&mut self, times: u32, ticks: u64) {
        for _ in 0..times {
            self.chip.borrow_mut().now_ticks += ticks;
            while let Some(event) = self.recorder.next(self.now()) {
                self.heard.push(event);
            }
        }
    }

    fn samples(&self) -> Vec<(u16, i32)> {
        let sample = |event: &RecordEvent| match event {
            RecordEvent::Sample { number, micro_g: [x, ..] } => Some((*number, *x)),
            _ => None,
        };
        self.heard.iter().filter_map(sample).collect()
    }
}

const MS: u64 = SECOND / 1000;

#[test]
fn a_record_has_all_samples_in_order_and_its_end() {
    let chip = RefCell::default();
    let mut rig = Rig::new(&chip);
    rig.record(500, false).unwrap();
    rig.pass(400, 2 * MS);
    assert_eq!(rig.heard.first(), Some(&RecordEvent::Begun));
    assert_eq!(rig.heard.last(), Some(&RecordEvent::Ended { rate_hz: 1600, overflows: 0 }));
    assert_eq!(rig.samples(), (0..500).map(|number| (number, i32::from(number))).collect::<Vec<_>>());
    assert_eq!((rig.heard.len(), chip.borrow().since_ticks), (502, None), "the chip rests again");
}

/// Over a clock that wraps every 51 s, and a rate that is a little off.
#[test]
fn the_rate_of_a_long_record_is_measured() {
    for (fast_per_mille, expected_hz) in [(0, 800), (30, 824), (-45, 764)] {
        let chip = RefCell::new(Chip { fast_per_mille, now_ticks: (1 << 32) - SECOND, ..Chip::default() });
        let mut rig = Rig::new(&chip);
        rig.set(800);
        rig.record(50_000, false).unwrap();
        rig.pass(35_000, 2 * MS);
        assert_eq!(rig.heard.last(), Some(&RecordEvent::Ended { rate_hz: expected_hz, overflows: 0 }));
        // The rate of a short record is the set one.
        rig.record(900, false).unwrap();
        rig.pass(1000, 2 * MS);
        assert_eq!(rig.heard.last(), Some(&RecordEvent::Ended { rate_hz: 800, overflows: 0 }));
    }
}

#[test]
fn what_the_memory_loses_is_counted_and_the_record_goes_on() {
    let chip = RefCell::default();
    let mut rig = Rig::new(&chip);
    rig.record(2000, false).unwrap();
    rig.pass(100, 2 * MS);
    // Twice the recorder is not called for 50 ms, in which the chip takes 80 samples.
    for _ in 0..2 {
        rig.pass(1, 50 * MS);
        rig.pass(10, 2 * MS);
    }
    rig.pass(1000, 2 * MS);
    assert_eq!(rig.heard.last(), Some(&RecordEvent::Ended { rate_hz: 1600, overflows: 2 }));
    let samples = rig.samples();
    assert!(samples.iter().map(|(number, _)| *number).eq(0..2000), "numbered as they are reported");
    assert_eq!(samples[1999].1, 1999 + 2 * 48);
}

#[test]
fn a_record_may_wait_for_a_move_and_another_ends_it() {
    let chip = RefCell::default();
    let mut rig = Rig::new(&chip);
    rig.record(100, true).unwrap();
    rig.pass(100, 2 * MS);
    assert!(rig.recorder.awaits_move() && rig.heard.is_empty() && chip.borrow().begun == 0);
    rig.recorder.move_began(rig.now());
    rig.pass(10, 2 * MS);
    assert!(!rig.recorder.awaits_move() && rig.samples().len() == 32);
    // Another begins: first the recorder reports the end of this one.
    rig.record(5, false).unwrap();
    rig.heard.clear();
    rig.pass(10, 2 * MS);
    let end = RecordEvent::Ended { rate_hz: 1600, overflows: 0 };
    assert_eq!((rig.heard[0], rig.heard[1], rig.heard.len()), (end, RecordEvent::Begun, 8));
    // A record without a line yet ends silently, as does one that waits.
    for at_next_move in [false, true] {
        rig.heard.clear();
        rig.record(5, at_next_move).unwrap();
        rig.record(0, false).unwrap();
        rig.recorder.move_began(rig.now());
        rig.pass(10, 2 * MS);
        assert_eq!(rig.heard, []);
    }
    // So does a change of settings end one; a question does not.
    rig.record(1000, false).unwrap();
    rig.pass(10, 2 * MS);
    rig.recorder.set(None, None).unwrap();
    rig.heard.clear();
    rig.set(3200);
    rig.pass(10, 2 * MS);
    assert_eq!(rig.heard, [end]);
}

#[test]
fn a_chip_that_is_gone_refuses_commands_and_ends_a_record() {
    let gone = AccelerometerFault::Identity { read: 0xff, expected: 0xe5 };
    let chip = RefCell::new(Chip { fault: Some(gone), ..Chip::default() });
    let mut rig = Rig::new(&chip);
    let refused = Err(CommandError::Accelerometer(gone));
    assert_eq!(rig.recorder.set(None, None).map(|_| ()), refused);
    assert_eq!((rig.record(10, false), rig.record(10, true)), (refused, refused));
    assert_eq!(rig.record(0, false), Ok(()), "the end of nothing needs no chip");
    assert_eq!(
        CommandError::Accelerometer(gone).to_string(),
        "the accelerometer does not answer: its identity reads 0xff, expected 0xe5: check its plug, its wires and its supply"
    );
    // In the middle of a record, and between the command and the move that it waits for.
    for at_next_move in [false, true] {
        chip.borrow_mut().fault = None;
        rig.record(1000, at_next_move).unwrap();
        rig.pass(5, 2 * MS);
        chip.borrow_mut().fault = Some(gone);
        rig.recorder.move_began(rig.now());
        rig.heard.clear();
        rig.pass(5, 2 * MS);
        assert_eq!(rig.heard, [RecordEvent::Failed(RecordFault::Chip(gone))]);
        assert!(rig.heard[0].to_string().starts_with("echo:record ended: the accelerometer does not answer: "));
    }
    // The settings of the refused commands were not taken.
    chip.borrow_mut().fault = None;
    assert_eq!(rig.recorder.set(None, None).unwrap().rate_hz, 1600);
}

/// A chip that answers, with a memory that stays empty: at the slowest rate it also gets time
/// for some samples.
#[test]
fn a_chip_that_takes_no_samples_ends_the_record() {
    for (rate_hz, least_ms, most_ms) in [(3200, 100, 110), (25, 500, 510)] {
        let chip = RefCell::new(Chip { is_deaf: true, ..Chip::default() });
        let mut rig = Rig::new(&chip);
        rig.set(rate_hz);
        rig.record(1000, false).unwrap();
        let mut ms = 0;
        while rig.heard.len() < 2 {
            rig.pass(1, 2 * MS);
            ms += 2;
        }
        assert_eq!(rig.heard[1], RecordEvent::Failed(RecordFault::Chip(AccelerometerFault::Silent)));
        assert!((least_ms..=most_ms).contains(&ms), "{rate_hz} Hz: {ms} ms");
    }
}

#[test]
fn an_unread_record_ends() {
    let chip = RefCell::default();
    let mut rig = Rig::new(&chip);
    rig.set(25);
    rig.record(60_000, false).unwrap();
    // A host that reads now and then keeps it going.
    for _ in 0..3 {
        rig.pass(10, 2 * MS);
        for _ in 0..2400 {
            chip.borrow_mut().now_ticks += 2 * MS;
            rig.recorder.wait_for_room(rig.now());
        }
    }
    rig.pass(1, 2 * MS);
    assert!(matches!(rig.heard.last(), Some(RecordEvent::Sample { .. })));
    for _ in 0..2600 {
        chip.borrow_mut().now_ticks += 2 * MS;
        rig.recorder.wait_for_room(rig.now());
    }
    assert_eq!(chip.borrow().since_ticks, None, "the chip rests");
    rig.heard.clear();
    rig.pass(10, 2 * MS);
    assert_eq!(rig.heard, [RecordEvent::Failed(RecordFault::Unread)]);
}
