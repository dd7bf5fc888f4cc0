//! Random machines and paths: corners of every angle, moves from 10 um on, arcs, spirals, stairs,
//! hairpins, reversals and stops.

use ferrostep_random_cases::Random;
use std::f64::consts::{PI, TAU};

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AXES, AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, PlannedBlock, Planner, ShaperKind, StepsPerMm,
    smooth_ticks,
};

/// A machine, its filters and its moves.
#[derive(Clone, Debug)]
pub struct Case {
    pub acceleration: f64,
    pub filament_acceleration: f64,
    pub shapers: [AxisShaper; 2],
    pub smooth_time_s: Option<f64>,
    pub path_tolerance_mm: f64,
    pub filament_on_the_way: bool,
    pub steps_per_mm: [f64; 3],
    pub moves: Vec<Move>,
}

const EXTRUDER_STEPS_PER_MM: f64 = 140.0;

/// The most that there may be: no block has several moves then, and a place is known from the
/// motors to 0.1 um.
const FINE_STEPS_PER_MM: f64 = 10_000.0;

impl Case {
    fn limits(&self) -> Limits {
        Limits {
            max_feed_mm_per_s: [500.0, 500.0, 20.0, 100.0],
            max_acceleration_mm_per_s2: [self.acceleration, self.acceleration, 500.0, self.filament_acceleration],
            print_acceleration_mm_per_s2: self.acceleration,
            travel_acceleration_mm_per_s2: self.acceleration,
            retract_acceleration_mm_per_s2: 3_000.0,
            // Wide enough that only the tolerance limits.
            junction_deviation_mm: 10.0,
            instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; AXES],
        }
    }

    /// The blocks with their speeds, with the tolerance or without.
    pub fn blocks(&self, keeps: bool) -> Vec<PlannedBlock> {
        self.blocks_with(keeps, 64)
    }

    /// Blocks of the moves, planned with a look-ahead ring of this size.
    pub fn blocks_with(&self, keeps: bool, ring: usize) -> Vec<PlannedBlock> {
        let steps = |value: f64| StepsPerMm::from_f64(value).unwrap();
        let [x, y, z] = self.steps_per_mm;
        let geometry = Geometry {
            kinematics: Kinematics::Cartesian,
            steps_per_mm: [steps(x), steps(y), steps(z), steps(EXTRUDER_STEPS_PER_MM)],
            minimum_event_interval_ticks: 1,
            event_cost_ticks: 0,
            move_cost_ticks: 0,
        };
        let mut planner: Planner<Vec<Slot>> = Planner::new(geometry, self.limits(), vec![Slot::EMPTY; ring]);
        let choice = MotionChoice {
            shapers: self.shapers,
            smooth_time_s: self.smooth_time_s,
            path_tolerance_mm: keeps.then_some(self.path_tolerance_mm),
            filament_on_the_way: self.filament_on_the_way,
            ..MotionChoice::DEFAULT
        };
        planner.set_motion_choice(&choice).unwrap();
        let mut blocks = Vec::new();
        for one in &self.moves {
            // A fan that changes between two moves closes the block before it is known what comes.
            if one.line % 23 == 0 {
                while !planner.add_fan_power(0, 0) {
                    blocks.extend(planner.next_planned());
                }
            }
            while planner.add(one).is_err() {
                blocks.extend(planner.next_planned());
            }
        }
        planner.flush();
        while let Some(block) = planner.next_planned() {
            blocks.push(block);
        }
        blocks
    }
}

/// A path that is being drawn.
struct Drawn<'a> {
    random: &'a mut Random,
    place: [i64; 3],
    direction: f64,
    feed: f32,
    /// Filament per mm of path.
    flow: f64,
    moves: Vec<Move>,
}

impl Drawn<'_> {
    fn add(&mut self, filament_mm: f64) {
        let line = self.moves.len() as u32 + 1;
        self.moves.push(Move {
            target_10nm: self.place,
            filament_100pm: (filament_mm * 1e7) as i64,
            feed_mm_per_s: self.feed,
            line,
            ends_move: true,
        });
    }

    fn go(&mut self, length_mm: f64) {
        self.place[0] += (length_mm * self.direction.cos() * 1e5).round() as i64;
        self.place[1] += (length_mm * self.direction.sin() * 1e5).round() as i64;
        self.add(self.flow * length_mm);
    }

    fn turn(&mut self, angle: f64) {
        self.direction += angle;
    }

    /// Chords that all turn by the same angle, their lengths growing by a ratio.
    fn spiral(&mut self, chords: u32, angle: f64, first_mm: f64, ratio: f64) {
        let mut length = first_mm;
        for _ in 0..chords {
            self.go(length.clamp(0.01, 20.0));
            self.turn(angle);
            length *= ratio;
        }
    }

    /// Adds filament back, a lift, travels, a lowering, and filament again.
    fn way(&mut self) {
        let (flow, feed) = (self.flow, self.feed);
        let filament = self.random.magnitude(0.02, 4.0);
        let lift = if self.random.bits().is_multiple_of(3) { 0.0 } else { self.random.magnitude(0.05, 1.0) };
        self.feed = self.random.magnitude(10.0, 80.0) as f32;
        self.add(-filament);
        (self.flow, self.feed) = (0.0, self.random.magnitude(50.0, 400.0) as f32);
        self.place[2] += (lift * 1e5) as i64;
        self.add(0.0);
        for _ in 0..1 + self.random.bits() % 4 {
            let (angle, length) = (TAU * self.random.share(), self.random.magnitude(0.1, 60.0));
            self.turn(angle);
            self.go(length);
        }
        self.place[2] -= (lift * 1e5) as i64;
        self.add(0.0);
        self.feed = self.random.magnitude(10.0, 80.0) as f32;
        self.add(filament);
        (self.flow, self.feed) = (flow, feed);
    }

    fn piece(&mut self) {
        let sign = if self.random.bits().is_multiple_of(2) { 1.0 } else { -1.0 };
        let (any_angle, length) = (TAU * self.random.share(), self.random.magnitude(0.01, 30.0));
        let chords = 2 + self.random.bits() as u32 % 30;
        match self.random.bits() % 12 {
            // An arc of a slicer, and one that opens or closes.
            0 | 1 => {
                let (radius, chord) = (self.random.magnitude(0.05, 50.0), self.random.magnitude(0.01, 2.0));
                self.spiral(chords, sign * (chord / radius).min(1.5), chord, 1.0);
            }
            2 => {
                let ratio = self.random.magnitude(0.7, 1.4);
                let (angle, first) = (self.random.magnitude(0.01, 1.5), self.random.magnitude(0.01, 1.0));
                self.spiral(chords, sign * angle, first, ratio);
            }
            // Stairs.
            3 => {
                let (angle, chord) = (PI * self.random.share(), self.random.magnitude(0.01, 1.0));
                for _ in 0..chords {
                    self.go(chord);
                    self.turn(angle);
                    self.go(chord);
                    self.turn(-angle);
                }
            }
            // Infill: long lines, short connections.
            4 => {
                let (line, apart) = (self.random.magnitude(1.0, 40.0), self.random.magnitude(0.05, 1.0));
                for turn in 0..6 {
                    let side = if turn % 2 == 0 { 0.5 * PI } else { -0.5 * PI };
                    self.go(line);
                    self.turn(side);
                    self.go(apart);
                    self.turn(side);
                }
            }
            5 => {
                self.go(length);
                self.turn(PI);
                let back = length * self.random.share().max(1e-3);
                self.go(back);
            }
            // Z, filament alone, and a slope.
            6 => {
                self.place[2] += (self.random.magnitude(0.05, 2.0) * 1e5) as i64;
                self.add(0.0);
            }
            7 => {
                let filament = sign * self.random.magnitude(0.001, 2.0);
                self.add(filament);
            }
            8 => {
                self.place[2] += (self.random.magnitude(0.01, 0.4) * 1e5) as i64;
                self.go(length);
            }
            9 => {
                self.feed = self.random.magnitude(5.0, 400.0) as f32;
                self.flow = if self.random.bits().is_multiple_of(3) { 0.0 } else { 0.1 * self.random.share() };
            }
            // Lines in line.
            10 => (0..chords).for_each(|_| self.go(length.min(2.0))),
            _ => {
                for _ in 0..chords {
                    let (angle, length) = (PI * self.random.share().powi(3), self.random.magnitude(0.01, 10.0));
                    self.go(length);
                    self.turn(sign * angle);
                }
            }
        }
        if self.random.bits().is_multiple_of(3) {
            self.turn(any_angle);
        }
    }
}

pub fn case(random: &mut Random) -> Case {
    let shaper = |random: &mut Random| AxisShaper {
        kind: ShaperKind::EXAMPLES[random.bits() as usize % ShaperKind::EXAMPLES.len()],
        frequency_hz: random.magnitude(25.0, 120.0),
        damping: 0.19 * random.share(),
    };
    let x = shaper(random);
    let shapers = match random.bits() % 4 {
        0 => [x, shaper(random)],
        1 => [x, AxisShaper { frequency_hz: x.frequency_hz * (0.8 + 0.4 * random.share()), ..x }],
        2 => [x, x],
        _ => [AxisShaper::NONE; 2],
    };
    let fits = |time_s: &f64| {
        let ticks = smooth_ticks(Some(*time_s)).unwrap();
        shapers.iter().all(|shaper| shaper.kernel_beside(ticks).is_ok())
    };
    let is_bare = shapers.iter().all(|shaper| shaper.kind == ShaperKind::None);
    let smooth_time_s =
        (is_bare || !random.bits().is_multiple_of(3)).then(|| random.magnitude(0.001, 0.04)).filter(fits);
    let acceleration = random.magnitude(300.0, 20_000.0);
    let filament_acceleration = random.magnitude(1_000.0, 20_000.0);
    let path_tolerance_mm = random.magnitude(0.003, 0.3);
    let (direction, feed) = (TAU * random.share(), random.magnitude(5.0, 400.0) as f32);
    let wanted = 40 + random.bits() as usize % 120;
    let mut drawn = Drawn { random, place: [0; 3], direction, feed, flow: 0.04, moves: Vec::new() };
    while drawn.moves.len() < wanted {
        drawn.piece();
    }
    let moves = drawn.moves;
    let (filament_on_the_way, steps_per_mm) = (false, [80.0, 80.0, 400.0]);
    Case {
        acceleration,
        filament_acceleration,
        shapers,
        smooth_time_s,
        path_tolerance_mm,
        filament_on_the_way,
        steps_per_mm,
        moves,
    }
}

/// A case with filament on the way between its lines, and the blocks that are planned of it: each
/// of them as a move of the case.
pub fn on_the_way(random: &mut Random) -> (Case, Vec<PlannedBlock>) {
    let mut case = Case { filament_on_the_way: true, steps_per_mm: [FINE_STEPS_PER_MM; 3], ..case(random) };
    let (direction, feed) = (TAU * random.share(), random.magnitude(20.0, 400.0) as f32);
    let mut drawn = Drawn { random, place: [0; 3], direction, feed, flow: 0.04, moves: Vec::new() };
    for _ in 0..12 {
        drawn.piece();
        drawn.way();
    }
    case.moves = drawn.moves;
    let (mut steps, mut line) = ([0; 3], 0);
    let mut moves = Vec::new();
    let mut blocks = case.blocks(true);
    for planned in &mut blocks {
        for (sum, steps) in steps.iter_mut().zip(planned.block.steps) {
            *sum += i64::from(steps);
        }
        line += 1;
        planned.block.line = line;
        let target_10nm = steps.map(|steps| (steps as f64 * 1e5 / FINE_STEPS_PER_MM).round() as i64);
        let filament_mm = f64::from(planned.block.extruder_256ths) / (256.0 * EXTRUDER_STEPS_PER_MM);
        // A move shorter than a step lasts as long as one.
        let stands = planned.block.steps == [0; 3] && planned.block.extruder_256ths == 0;
        let filament_100pm = if stands { 1 } else { (filament_mm * 1e7).round() as i64 };
        moves.push(Move { target_10nm, filament_100pm, feed_mm_per_s: 1.0, line, ends_move: true });
    }
    case.moves = moves;
    (case, blocks)
}
