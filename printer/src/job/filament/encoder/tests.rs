//! The watch of an encoder, beside a model of its wheel.

use proptest::prelude::*;

use super::*;
use crate::motion::machine::pushed::FilamentCount;

const STEPS_PER_MM: f64 = 400.0;
const DEBOUNCE_MS: u16 = 5;

/// An extruder, and the encoder's wheel on its filament, looked at every 2 ms.
struct Bench {
    count: FilamentCount,
    watch: EncoderWatch,
    signals: Signals,
    now_ms: u32,
    /// Position of the extruder, and of the filament in the encoder, mm.
    extruder_mm: f64,
    filament_mm: f64,
    /// Filament from edge to edge.
    edge_mm: f64,
    is_jammed: bool,
    /// True if the wheel's slot trembles at its edge.
    chatters: bool,
}

impl Bench {
    fn new(edge_mm: f64, detection_mm: f64) -> Self {
        let signals = Signals::new();
        signals.set_filament_detection_10nm((detection_mm * 1e5) as u32);
        signals.count_filament_anew();
        Self {
            count: FilamentCount::default(),
            watch: EncoderWatch::new(),
            signals,
            // A clock that wraps.
            now_ms: u32::MAX - 1000,
            extruder_mm: 0.0,
            filament_mm: 0.1,
            edge_mm,
            is_jammed: false,
            chatters: false,
        }
    }

    /// Moves the extruder by this much in 2 ms. Returns true if filament is missing then.
    fn look(&mut self, by_mm: f64) -> bool {
        let at_least = self.count.at_end();
        self.extruder_mm += by_mm;
        if !self.is_jammed {
            self.filament_mm += by_mm;
        }
        self.count.follow((self.extruder_mm * STEPS_PER_MM).floor() as i64);
        self.now_ms = self.now_ms.wrapping_add(2);
        let trembles = self.chatters && (self.now_ms / 2).is_multiple_of(2);
        let level = (self.filament_mm / self.edge_mm).floor() as i64 & 1 != i64::from(trembles);
        let pushed = PushedFilament { at_least, at_most: self.count.at_end() };
        self.watch.look(self.now_ms, level, pushed, STEPS_PER_MM as f32, DEBOUNCE_MS, &self.signals);
        self.signals.is_filament_missing()
    }

    /// Moves it by this much at a speed. Returns true if filament was missing at any time.
    fn push(&mut self, mm: f64, mm_per_s: f64) -> bool {
        let looks = (mm.abs() / mm_per_s / 0.002).ceil().max(1.0);
        (0..looks as u32).fold(false, |missing, _| self.look(mm / looks) || missing)
    }

    fn stand(&mut self, ms: u32) {
        (0..ms / 2).for_each(|_| {
            self.look(0.0);
        });
    }
}

#[test]
fn filament_that_stands_is_missing_after_the_length_and_there_again_with_the_next_sign() {
    let mut bench = Bench::new(2.88, 7.0);
    assert!(!bench.push(40.0, 3.0));
    bench.is_jammed = true;
    // The last sign was up to an edge ago.
    assert!(!bench.push(7.0 - 2.88 - 0.1, 3.0));
    assert!(bench.push(2.88 + 0.2, 3.0));
    bench.is_jammed = false;
    assert!(bench.push(0.1, 3.0));
    bench.push(2.88 + 0.1, 3.0);
    assert!(!bench.signals.is_filament_missing());
}

#[test]
fn a_sign_less_print_is_counted_anew_when_asked() {
    let mut bench = Bench::new(2.88, 7.0);
    bench.is_jammed = true;
    for _ in 0..4 {
        assert!(!bench.push(6.8, 3.0));
        bench.signals.count_filament_anew();
        bench.look(0.0);
    }
    assert!(bench.push(7.0 * 9.0 / 8.0 + 0.1, 3.0));
    bench.signals.count_filament_anew();
    assert!(!bench.signals.is_filament_missing());
}

/// A clogged nozzle: the gear grinds, but draws the filament back and pushes it
/// again, past an edge.
#[test]
fn filament_that_only_goes_to_and_fro_does_not_move() {
    let mut bench = Bench::new(2.88, 7.0);
    bench.filament_mm = 2.98;
    let mut pushed_mm = 0.0;
    let is_found = (0..20).any(|_| {
        bench.is_jammed = true;
        pushed_mm += 1.0;
        let is_missing = bench.push(1.0, 3.0);
        bench.is_jammed = false;
        bench.push(-0.8, 40.0);
        bench.stand(150);
        bench.push(0.8, 40.0);
        is_missing
    });
    assert!(is_found && pushed_mm <= 8.0, "{pushed_mm}");
}

/// The same with filament that moves: the retractions cost no sign, wherever they lie.
#[test]
fn retractions_of_a_print_hide_no_sign() {
    for start in 0..60 {
        let mut bench = Bench::new(2.88, 3.0);
        bench.filament_mm = f64::from(start) * 0.1;
        for _ in 0..60 {
            assert!(!bench.push(0.7, 2.5), "{start}");
            assert!(!bench.push(-0.8, 40.0), "{start}");
            bench.stand(120);
            assert!(!bench.push(0.8, 40.0), "{start}");
        }
    }
}

/// A level that trembles at an edge gives no sign: at standstill, and while the gear grinds.
#[test]
fn a_chattering_level_is_no_sign() {
    let mut bench = Bench::new(2.88, 7.0);
    assert!(!bench.push(20.0, 3.0));
    bench.is_jammed = true;
    let mut pushed_mm = 0.0;
    let is_found = (0..20).any(|_| {
        bench.chatters = true;
        bench.stand(400);
        let is_missing = bench.push(1.0, 3.0);
        pushed_mm += 1.0;
        is_missing
    });
    assert!(is_found && pushed_mm <= 8.0, "{pushed_mm}");
}

/// The encoder is read every 2 ms, and an edge must last 5 ms.
#[test]
fn the_fastest_filament_has_an_edge_every_eight_milliseconds() {
    let mut bench = Bench::new(2.88, 7.0);
    assert!(!bench.push(500.0, 2.88 / 0.008));
}

/// A piece of a print: how far, and how fast.
fn piece() -> impl Strategy<Value = (f64, f64, u32)> {
    prop_oneof![
        // A line.
        (0.05..6.0, 0.3..25.0).prop_map(|(mm, speed)| (mm, speed, 0)),
        // Drawn back, moved, pushed again: both in one.
        (0.2..6.0, 20.0..60.0, 0u32..400).prop_map(|(mm, speed, ms): (f64, f64, u32)| (-mm, speed, ms)),
    ]
}

proptest! {
    /// The wheel gives its signs at any length below the one that counts, wherever it
    /// is at the start.
    #[test]
    fn a_print_is_never_stopped_and_a_jam_always_is(
        pieces in proptest::collection::vec(piece(), 1..60),
        detection_mm in 2.0..20.0, of_it in 0.3..0.96, start_mm in 0.0..40.0, jams_after in 0usize..60,
    ) {
        let mut bench = Bench::new(detection_mm * of_it, detection_mm);
        bench.filament_mm = start_mm;
        for &(mm, speed, ms) in pieces.iter().take(jams_after) {
            prop_assert!(!bench.push(mm, speed));
            if mm < 0.0 {
                bench.stand(ms);
                prop_assert!(!bench.push(-mm, speed));
            }
        }
        bench.is_jammed = true;
        let (mut new_mm, mut is_missing) = (0.0, false);
        for &(mm, speed, ms) in pieces.iter().cycle() {
            if mm > 0.0 {
                new_mm += mm;
                is_missing = bench.push(mm, speed);
            } else {
                bench.push(mm, speed);
                bench.stand(ms);
                bench.push(-mm, speed);
            }
            // An eighth more where the count has begun anew.
            let is_over = new_mm > detection_mm * 9.0 / 8.0 + 0.2;
            prop_assert!(is_missing || !is_over, "{new_mm} of {detection_mm}");
            if is_missing || pieces.iter().all(|(mm, ..)| *mm < 0.0) {
                break;
            }
        }
    }
}
