//! A planner with the stage that follows a bed, and what its motors do.

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::surface::{Bed, BedStage, Mesh};
use ferrostep_planner::{
    AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, MoveError, Notice, PassedEntries, Planner, Progress,
    ShaperKind, Standard, StepEntry, StepLedger, StepObserver, StepSink, StepsPerMm,
};

use crate::surface::reference::Surface;

pub const Z: u8 = 0b100;
pub const MM: i64 = 100_000;

/// An event: tick, motors, those that run backwards.
pub type Event = (u64, u8, u8);

#[derive(Default)]
pub struct Seen(pub Vec<Event>);

impl StepObserver for Seen {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.0.push((tick, axes, directions));
    }
}

/// Destination of the steps: through the stage, if there is one.
pub struct Sink {
    pub stage: Option<BedStage>,
    pub ledger: StepLedger,
    pub seen: Seen,
    /// Ends of blocks at which the motors stood elsewhere.
    pub miscounts: usize,
    interval_ticks: u32,
}

impl Sink {
    fn play(&mut self, entry: StepEntry) {
        // The step queue takes no entry that is nearer.
        assert!(entry.count() == 0 || entry.interval_ticks() >= self.interval_ticks, "{entry:?}");
        self.ledger.play(entry, &mut self.seen);
    }

    fn note(&mut self, notice: Notice) {
        if let Notice::BlockEnded { motor_steps, .. } = notice {
            self.miscounts += usize::from(motor_steps != self.ledger.motor_steps());
        }
    }

    /// Plays what waits; `false` if the queue is empty.
    fn work(&mut self) -> bool {
        let Some(stage) = self.stage.as_mut().filter(|stage| stage.is_waiting()) else { return false };
        let mut out = PassedEntries::NONE;
        let notice = stage.work(&mut out);
        out.all().iter().for_each(|entry| self.play(*entry));
        notice.into_iter().for_each(|notice| self.note(notice));
        true
    }
}

impl StepSink for Sink {
    fn entry(&mut self, entry: StepEntry) {
        if !self.stage.as_mut().is_some_and(|stage| stage.take(&[entry])) {
            self.play(entry);
        }
    }

    fn notice(&mut self, notice: Notice) {
        if !self.stage.as_mut().is_some_and(|stage| stage.take_notice(&notice)) {
            self.note(notice);
        }
    }
}

pub const START: [i64; 3] = [70 * MM, 70 * MM, MM / 5];

#[derive(Clone, Copy, Debug)]
pub struct Machine {
    pub kinematics: Kinematics,
    pub steps_per_mm: [f64; 3],
    pub limits: Limits,
    pub shaped: bool,
}

impl Machine {
    pub fn new(kinematics: Kinematics) -> Self {
        let limits = Limits {
            // Z can do more than any move asks for.
            max_feed_mm_per_s: [300.0, 300.0, 400.0, 60.0],
            max_acceleration_mm_per_s2: [10_000.0, 10_000.0, 50_000.0, 5_000.0],
            print_acceleration_mm_per_s2: 8_000.0,
            travel_acceleration_mm_per_s2: 10_000.0,
            retract_acceleration_mm_per_s2: 1_500.0,
            junction_deviation_mm: 0.05,
            instantaneous_corner_velocity_mm_per_s: [f64::INFINITY, f64::INFINITY, 400.0, 10.0],
        };
        Self { kinematics, steps_per_mm: [100.0, 100.0, 400.0], limits, shaped: false }
    }

    pub fn geometry(&self) -> Geometry {
        let steps = |value| StepsPerMm::from_f64(value).unwrap();
        let [x, y, z] = self.steps_per_mm.map(steps);
        Geometry {
            kinematics: self.kinematics,
            steps_per_mm: [x, y, z, steps(95.0)],
            minimum_event_interval_ticks: 168,
            event_cost_ticks: 0,
            move_cost_ticks: 0,
        }
    }

    /// A planner at a place.
    pub fn planner(&self, start_10nm: [i64; 3]) -> Planner<Vec<Slot>, Standard<BedStage>> {
        let mut planner = Planner::new(self.geometry(), self.limits, vec![Slot::EMPTY; 64]);
        if self.shaped {
            let shaper = AxisShaper { kind: ShaperKind::Zv, frequency_hz: 40.0, damping: 0.1 };
            planner.set_motion_choice(&MotionChoice { shapers: [shaper; 2], ..MotionChoice::DEFAULT }).unwrap();
        }
        planner.set_position(start_10nm);
        planner
    }

    /// The steps of moves from a place, with the mesh if there is one, and if `keeps`,
    /// within Z's limits.
    pub fn run(&self, start_10nm: [i64; 3], moves: &[Move], mesh: Option<&Mesh>, keeps: bool) -> Sink {
        let mut planner = self.planner(start_10nm);
        let geometry = self.geometry();
        let mut ledger = StepLedger::default();
        ledger.redefine_motor_steps(geometry.motor_steps(start_10nm).map(i64::from));
        let stage = mesh.map(|mesh| {
            let mut stage = BedStage::new(&geometry);
            *stage.mesh().unwrap() = mesh.clone();
            let bounds = stage.switch(true).unwrap();
            planner.set_surface(keeps.then_some(bounds));
            // The motors begin on the surface.
            let [x, y, z, _] = ledger.motor_steps();
            let surface = Surface::new(mesh, self);
            let [px, py, pz] = start_10nm.map(|units| units as f64 / MM as f64);
            let correction = surface.height_steps([px, py], pz).round() as i64;
            let total = (z + correction - 1..=z + correction + 1)
                .find(|total| total - stage.stand([x, y, *total], 0) == z)
                .unwrap_or_else(|| panic!("no place for Z at {z} and {correction}"));
            ledger.redefine_motor_steps([x, y, total]);
            stage
        });
        let mut sink = Sink { stage, ledger, seen: Seen::default(), miscounts: 0, interval_ticks: 168 };
        let mut advance = |planner: &mut Planner<Vec<Slot>, Standard<BedStage>>| {
            sink.work() || planner.advance(&mut sink) == Progress::Worked
        };
        for request in moves {
            while planner.add(request) == Err(MoveError::NoRoom) {
                advance(&mut planner);
            }
        }
        planner.flush();
        while advance(&mut planner) {}
        assert!(planner.is_idle());
        sink
    }

    /// Motor position near [`START`] that the motors can have on the mesh.
    pub fn start(&self, mesh: &Mesh) -> [i64; 3] {
        let geometry = self.geometry();
        let mut stage = BedStage::new(&geometry);
        *stage.mesh().unwrap() = mesh.clone();
        stage.switch(true).unwrap();
        let [x, y, z] = geometry.motor_steps(START).map(i64::from);
        let [start_x, start_y, _] = START;
        [start_x, start_y, geometry.position_10nm([x, y, z - stage.stand([x, y, z], 0)])[2]]
    }

    /// Tool position, mm, for these motor steps.
    pub fn place(&self, [a, b, _]: [i64; 3]) -> [f64; 2] {
        let [sa, sb, _] = self.steps_per_mm;
        let (a, b) = (a as f64 / sa, b as f64 / sb);
        match self.kinematics {
            Kinematics::CoreXy => [(a + b) / 2.0, (a - b) / 2.0],
            _ => [a, b],
        }
    }
}

pub fn without_z(events: &[Event]) -> Vec<Event> {
    let events = events.iter().map(|(tick, axes, directions)| (*tick, axes & !Z, directions & !Z));
    events.filter(|(_, axes, _)| *axes != 0).collect()
}
