//! Entries that a planner makes of a path, and that the stage makes of those.

use ferrostep_planner::backlash::{Backlash, BacklashCorrection, BacklashStage};
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, MoveError, Notice, PassedEntries, Planner, Progress,
    ShaperKind, StepEntry, StepLedger, StepObserver, StepSink, StepsPerMm,
};
use proptest::prelude::*;

pub const MM: i64 = 100_000;
pub const STEPS_PER_MM: [f64; 3] = [80.0, 100.0, 400.0];
pub const MINIMUM_INTERVAL_TICKS: u32 = 168;

pub const LIMITS: Limits = Limits {
    max_feed_mm_per_s: [300.0, 300.0, 40.0, 60.0],
    max_acceleration_mm_per_s2: [10_000.0, 10_000.0, 500.0, 5_000.0],
    print_acceleration_mm_per_s2: 5_000.0,
    travel_acceleration_mm_per_s2: 10_000.0,
    retract_acceleration_mm_per_s2: 1_500.0,
    junction_deviation_mm: 0.05,
    instantaneous_corner_velocity_mm_per_s: [8.0, 8.0, 0.4, 5.0],
};

/// An event: tick, motors, those that run backwards.
pub type Event = (u64, u8, u8);

#[derive(Default)]
pub struct Seen(pub Vec<Event>);

impl StepObserver for Seen {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.0.push((tick, axes, directions));
    }
}

/// Output of one call of the planner.
#[derive(Clone, Default)]
pub struct Portion {
    pub entries: Vec<StepEntry>,
    pub notices: Vec<Notice>,
}

impl StepSink for Portion {
    fn entry(&mut self, entry: StepEntry) {
        assert!(self.notices.is_empty());
        self.entries.push(entry);
    }

    fn notice(&mut self, notice: Notice) {
        self.notices.push(notice);
    }
}

fn geometry() -> Geometry {
    let steps = |value| StepsPerMm::from_f64(value).unwrap();
    let [x, y, z] = STEPS_PER_MM.map(steps);
    Geometry {
        kinematics: Kinematics::Cartesian,
        steps_per_mm: [x, y, z, steps(95.0)],
        minimum_event_interval_ticks: MINIMUM_INTERVAL_TICKS,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    }
}

/// The portions of moves from 0.
pub fn plan(moves: &[Move], shaped: bool) -> Vec<Portion> {
    let mut planner: Planner<Vec<Slot>> = Planner::new(geometry(), LIMITS, vec![Slot::EMPTY; 64]);
    if shaped {
        let shaper = AxisShaper { kind: ShaperKind::Zv, frequency_hz: 40.0, damping: 0.1 };
        planner.set_motion_choice(&MotionChoice { shapers: [shaper; 2], ..MotionChoice::DEFAULT }).unwrap();
    }
    let mut portions = Vec::new();
    let mut advance = |planner: &mut Planner<Vec<Slot>>| {
        let mut portion = Portion::default();
        let progress = planner.advance(&mut portion);
        portions.push(portion);
        progress == Progress::Worked
    };
    for request in moves {
        while planner.add(request) == Err(MoveError::NoRoom) {
            advance(&mut planner);
        }
    }
    planner.flush();
    while advance(&mut planner) {}
    portions
}

/// The stage, its output, and how often a block ended elsewhere.
pub struct Bench {
    pub stage: BacklashStage,
    pub ledger: StepLedger,
    pub seen: Seen,
    pub entries: Vec<StepEntry>,
    pub miscounts: usize,
}

impl Bench {
    pub fn new(backlash: &Backlash) -> Self {
        let mut stage = BacklashStage::new(&geometry(), &LIMITS);
        stage.set(backlash);
        Self { stage, ledger: StepLedger::default(), seen: Seen::default(), entries: Vec::new(), miscounts: 0 }
    }

    /// Passes portions; `seeks`: of a move towards a sensor.
    pub fn run(&mut self, portions: &[Portion], seeks: bool) {
        for Portion { entries, notices } in portions {
            if !self.stage.take(entries) {
                entries.iter().for_each(|entry| self.play(*entry));
            }
            for notice in notices {
                if !self.stage.take_notice(notice) {
                    self.note(*notice);
                }
            }
            while self.stage.is_waiting() {
                let mut out = PassedEntries::NONE;
                let notice = self.stage.work(seeks, &mut out);
                out.all().iter().for_each(|entry| self.play(*entry));
                notice.into_iter().for_each(|notice| self.note(notice));
            }
        }
    }

    fn play(&mut self, entry: StepEntry) {
        // The step queue takes no entry that is nearer.
        assert!(entry.count() == 0 || entry.interval_ticks() >= MINIMUM_INTERVAL_TICKS, "{entry:?}");
        self.entries.push(entry);
        self.ledger.play(entry, &mut self.seen);
    }

    fn note(&mut self, notice: Notice) {
        if let Notice::BlockEnded { motor_steps, .. } = notice {
            self.miscounts += usize::from(motor_steps != self.ledger.motor_steps());
        }
    }
}

/// A path of moves with extrusion, and plays of all axes.
pub fn any_path() -> impl Strategy<Value = Vec<Move>> {
    let place = [0..=15 * MM, 0..=15 * MM, 0..=MM];
    proptest::collection::vec((place, 5.0..250.0_f32), 1..30).prop_map(|places| {
        let moves = places.into_iter().zip(1..);
        let moves = moves.map(|((target_10nm, feed_mm_per_s), line)| Move {
            target_10nm,
            filament_100pm: 500_000,
            feed_mm_per_s,
            line,
            ends_move: true,
        });
        moves.collect()
    })
}

pub fn any_backlash() -> impl Strategy<Value = Backlash> {
    ([0.0..0.4_f64, 0.0..0.4_f64, 0.0..0.1_f64], prop_oneof![Just(1.0), 0.1..1.0_f64], 0.0..6.0_f64)
        .prop_map(|(play_mm, correction, smoothing_mm)| Backlash { play_mm, correction, smoothing_mm })
}
