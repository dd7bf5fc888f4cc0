//! Random plans, and what the planner makes of them.

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AXES, AccelerationProfile, AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, Notice, PlannedBlock,
    Planner, PressureAdvance, Progress, SecondSlope, ShaperKind, StepEntry, StepKind, StepSink, StepsPerMm,
    smooth_ticks,
};
use ferrostep_random_cases::Random;

/// All step events in order: tick, axes, directions; and where motion ends.
#[derive(Default)]
pub struct Events {
    tick: u64,
    directions: u8,
    pub events: Vec<(u64, u8, u8)>,
    pub ended: Option<(u64, [i64; 4])>,
    lines: Vec<(u64, u32)>,
}

impl StepSink for Events {
    fn entry(&mut self, entry: StepEntry) {
        match entry.kind() {
            StepKind::Directions { directions } => self.directions = directions,
            StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                for index in 1..=count {
                    self.tick += u64::from(interval_ticks);
                    let axes = if index == count { axes ^ added } else { axes };
                    self.events.push((self.tick, axes, self.directions));
                }
            }
        }
    }

    fn notice(&mut self, notice: Notice) {
        match notice {
            Notice::BlockEnded { tick, motor_steps } => self.ended = Some((tick, motor_steps)),
            Notice::MoveEnded { tick, line } => self.lines.push((tick, line)),
            Notice::FanPower { .. } => {}
        }
    }
}

fn geometry(kinematics: Kinematics, minimum_event_interval_ticks: u32) -> Geometry {
    let steps = |value: f64| StepsPerMm::from_f64(value).unwrap();
    Geometry {
        kinematics,
        steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(140.0)],
        minimum_event_interval_ticks,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    }
}

pub fn limits(acceleration: f64) -> Limits {
    Limits {
        max_feed_mm_per_s: [400.0, 400.0, 20.0, 100.0],
        max_acceleration_mm_per_s2: [20_000.0, 20_000.0, 500.0, 10_000.0],
        print_acceleration_mm_per_s2: acceleration,
        travel_acceleration_mm_per_s2: acceleration,
        retract_acceleration_mm_per_s2: 3_000.0,
        junction_deviation_mm: 0.05,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; AXES],
    }
}

/// A machine, its shapers and its moves.
#[derive(Clone, Debug)]
pub struct Case {
    pub geometry: Geometry,
    pub limits: Limits,
    pub shapers: [AxisShaper; 2],
    pub pressure_advance: PressureAdvance,
    /// Time of the moving average, s.
    pub smooth_time_s: Option<f64>,
    /// Jerk of an S-curve, mm/s^3; there is then one move, as long as its speed needs.
    pub jerk_mm_per_s3: Option<f64>,
    pub moves: Vec<Move>,
}

impl Case {
    fn planner(&self) -> Planner<Vec<Slot>> {
        let mut planner = Planner::new(self.geometry, self.limits, vec![Slot::EMPTY; 64]);
        let mut choice = MotionChoice {
            shapers: self.shapers,
            pressure_advance: self.pressure_advance,
            smooth_time_s: self.smooth_time_s,
            ..MotionChoice::DEFAULT
        };
        if let Some(jerk_mm_per_s3) = self.jerk_mm_per_s3 {
            choice = MotionChoice { acceleration: AccelerationProfile::SCurve, jerk_mm_per_s3, ..choice };
        }
        planner.set_motion_choice(&choice).unwrap();
        planner
    }

    /// The blocks with their speeds.
    pub fn blocks(&self) -> Vec<PlannedBlock> {
        let mut planner = self.planner();
        let mut blocks = Vec::new();
        for one in &self.moves {
            while planner.add(one).is_err() {
                blocks.push(planner.next_planned().unwrap());
            }
        }
        planner.flush();
        while let Some(block) = planner.next_planned() {
            blocks.push(block);
        }
        blocks
    }

    /// Events that are executed.
    pub fn events(&self) -> Events {
        let (mut planner, mut events) = (self.planner(), Events::default());
        for one in &self.moves {
            while planner.add(one).is_err() {
                planner.advance(&mut events);
            }
        }
        planner.flush();
        while planner.advance(&mut events) == Progress::Worked {}
        assert!(planner.is_idle() && !planner.is_in_motion());
        events
    }
}

/// No advance for every other plan, and all kinds for the rest.
fn advance(random: &mut Random) -> PressureAdvance {
    if random.bits().is_multiple_of(2) {
        return PressureAdvance::NONE;
    }
    let seconds = random.magnitude(0.005, 0.5);
    let above = SecondSlope { filament_mm_per_s: random.magnitude(0.2, 6.0), seconds: seconds * random.share() };
    PressureAdvance {
        seconds,
        above: random.bits().is_multiple_of(2).then_some(above),
        smooth_time_s: random.bits().is_multiple_of(2).then_some(random.magnitude(0.002, 0.06)),
    }
}

pub fn case(random: &mut Random) -> Case {
    let kinematics = if random.bits().is_multiple_of(3) { Kinematics::CoreXy } else { Kinematics::Cartesian };
    let shaper = |random: &mut Random| AxisShaper {
        kind: ShaperKind::EXAMPLES[random.bits() as usize % ShaperKind::EXAMPLES.len()],
        frequency_hz: random.magnitude(22.0, 120.0),
        damping: 0.19 * random.share(),
    };
    let x = shaper(random);
    let y = if random.bits().is_multiple_of(2) { x } else { shaper(random) };
    let mut place = [0i64; 3];
    let mut moves = Vec::new();
    let mut direction = 6.3 * random.share();
    for line in 1..=4 + random.bits() as u32 % 12 {
        let length = random.magnitude(0.05, 30.0);
        direction += match random.bits() % 4 {
            0 => 0.01,
            1 => std::f64::consts::PI,
            2 => 6.3 * random.share(),
            _ => 0.5 * random.share(),
        };
        if !random.bits().is_multiple_of(12) {
            place[0] += (length * direction.cos() * 1e5) as i64;
            place[1] += (length * direction.sin() * 1e5) as i64;
        }
        if random.bits().is_multiple_of(9) {
            place[2] += (random.share() * 40_000.0) as i64;
        }
        let filament = if random.bits().is_multiple_of(3) { 0.0 } else { (random.share() - 0.1) * 0.08 * length };
        moves.push(Move {
            target_10nm: place,
            filament_100pm: (filament * 1e7) as i64,
            feed_mm_per_s: random.magnitude(5.0, 300.0) as f32,
            line,
            ends_move: true,
        });
    }
    let shapers = if x.kind == ShaperKind::None && y.kind == ShaperKind::None {
        [AxisShaper { kind: ShaperKind::Mzv, ..x }, y]
    } else {
        [x, y]
    };
    let (limits, pressure_advance) = (limits(random.magnitude(300.0, 20_000.0)), advance(random));
    let fits = |time_s: &f64| {
        let ticks = smooth_ticks(Some(*time_s)).unwrap();
        shapers.iter().all(|shaper| shaper.kernel_beside(ticks).is_ok())
    };
    let smooth_time_s = (!random.bits().is_multiple_of(3)).then(|| random.magnitude(0.001, 0.05)).filter(fits);
    let is_alone = random.bits().is_multiple_of(4) && smooth_time_s.is_some();
    let shapers = if is_alone { [AxisShaper::NONE; 2] } else { shapers };
    Case {
        geometry: geometry(kinematics, 1),
        limits,
        shapers,
        pressure_advance,
        smooth_time_s,
        jerk_mm_per_s3: None,
        moves,
    }
}
