//! Z follows a surface: X, Y and the extruder step when they would without it, Z is where an independent f64 surface has it, and
//! within its limits.
#![allow(clippy::unwrap_used)]

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::surface::{Bed, BedEntries, BedStage, Mesh, MeshError, MeshGrid, MeshInterpolation};
use ferrostep_planner::{
    AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, MoveError, Notice, Planner, Progress, ShaperKind,
    StandardOnBed, StepEntry, StepLedger, StepObserver, StepSink, StepsPerMm, TICKS_PER_SECOND,
};
use proptest::prelude::*;

const Z: u8 = 0b100;
const MM: i64 = 100_000;

/// An event: tick, motors, those that run backwards.
type Event = (u64, u8, u8);

#[derive(Default)]
struct Seen(Vec<Event>);

impl StepObserver for Seen {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.0.push((tick, axes, directions));
    }
}

/// Where the steps go: through the stage, if there is one.
struct Sink {
    stage: Option<BedStage>,
    ledger: StepLedger,
    seen: Seen,
    /// Ends of blocks at which the motors stood elsewhere.
    miscounts: usize,
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

    /// Plays what waits; `false` if nothing does.
    fn work(&mut self) -> bool {
        let Some(stage) = self.stage.as_mut().filter(|stage| stage.is_waiting()) else { return false };
        let mut out = BedEntries::NONE;
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

#[derive(Clone, Copy, Debug)]
struct Machine {
    kinematics: Kinematics,
    steps_per_mm: [f64; 3],
    limits: Limits,
    shaped: bool,
}

impl Machine {
    fn new(kinematics: Kinematics) -> Self {
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

    fn geometry(&self) -> Geometry {
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
    fn planner(&self, start_10nm: [i64; 3]) -> Planner<Vec<Slot>, StandardOnBed> {
        let mut planner = Planner::new(self.geometry(), self.limits, vec![Slot::EMPTY; 64]);
        if self.shaped {
            let shaper = AxisShaper { kind: ShaperKind::Zv, frequency_hz: 40.0, damping: 0.1 };
            planner.set_motion_choice(&MotionChoice { shapers: [shaper; 2], ..MotionChoice::DEFAULT }).unwrap();
        }
        planner.set_position(start_10nm);
        planner
    }

    /// The steps of moves from a place, with the mesh if there is one, and if `keeps`, within Z's limits.
    fn run(&self, start_10nm: [i64; 3], moves: &[Move], mesh: Option<&Mesh>, keeps: bool) -> Sink {
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
        let mut advance = |planner: &mut Planner<Vec<Slot>, StandardOnBed>| {
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

    /// About [`START`], where the motors can stand on the mesh.
    fn start(&self, mesh: &Mesh) -> [i64; 3] {
        let geometry = self.geometry();
        let mut stage = BedStage::new(&geometry);
        *stage.mesh().unwrap() = mesh.clone();
        stage.switch(true).unwrap();
        let [x, y, z] = geometry.motor_steps(START).map(i64::from);
        let [start_x, start_y, _] = START;
        [start_x, start_y, geometry.position_10nm([x, y, z - stage.stand([x, y, z], 0)])[2]]
    }

    /// Where motors that stand at these steps have the tool, mm.
    fn place(&self, [a, b, _]: [i64; 3]) -> [f64; 2] {
        let [sa, sb, _] = self.steps_per_mm;
        let (a, b) = (a as f64 / sa, b as f64 / sb);
        match self.kinematics {
            Kinematics::CoreXy => [(a + b) / 2.0, (a - b) / 2.0],
            _ => [a, b],
        }
    }
}

/// The surface in double precision, with nothing of the code that is tested but the mesh's heights.
struct Surface<'a> {
    mesh: &'a Mesh,
    /// Into how many parts the distances of its points are divided.
    parts: [u8; 2],
    /// Row by row, um.
    heights_um: Vec<Vec<f64>>,
    steps_per_mm: f64,
}

/// Heights at even distances, and between each two `parts` - 1 more on the cubic curves that have there the mean of the slopes to both
/// neighbours (at the ends the slope of the parabola through three): Hermite's form. As the mesh has them, to a um.
fn curve(heights: &[f64], parts: u8) -> Vec<f64> {
    let last = heights.len() - 1;
    let slope = |at: usize| match at {
        _ if last == 1 => heights[1] - heights[0],
        0 => -1.5 * heights[0] + 2.0 * heights[1] - 0.5 * heights[2],
        _ if at == last => 1.5 * heights[last] - 2.0 * heights[last - 1] + 0.5 * heights[last - 2],
        _ => (heights[at + 1] - heights[at - 1]) / 2.0,
    };
    let mut all = Vec::new();
    for at in 0..last {
        for part in 0..parts {
            let t = f64::from(part) / f64::from(parts);
            let (from, to) = (heights[at], heights[at + 1]);
            let bend = (2.0 * t * t * t - 3.0 * t * t + 1.0) * from + (3.0 * t * t - 2.0 * t * t * t) * to;
            let leave = (t * t * t - 2.0 * t * t + t) * slope(at) + (t * t * t - t * t) * slope(at + 1);
            all.push((bend + leave).round());
        }
    }
    all.push(heights[last]);
    all
}

impl<'a> Surface<'a> {
    fn new(mesh: &'a Mesh, machine: &Machine) -> Self {
        let [columns, rows] = mesh.grid().points;
        let parts = if mesh.interpolation() == MeshInterpolation::Bicubic {
            [columns, rows].map(|points| if points < 3 { 1 } else { (14 / (points - 1)).max(1) })
        } else {
            [1; 2]
        };
        let measured = (0..rows).map(|row| {
            let heights: Vec<_> = (0..columns).map(|column| mesh.height_um([column, row]).unwrap().into()).collect();
            curve(&heights, parts[0])
        });
        let measured: Vec<_> = measured.collect();
        let columns = (0..measured[0].len()).map(|column| {
            let heights: Vec<_> = measured.iter().map(|row| row[column]).collect();
            curve(&heights, parts[1])
        });
        let columns: Vec<_> = columns.collect();
        let heights_um = (0..columns[0].len()).map(|row| columns.iter().map(|column| column[row]).collect()).collect();
        Self { mesh, parts, heights_um, steps_per_mm: machine.steps_per_mm[2] }
    }

    /// Its height at a place, mm; a cell beyond the grid the outermost cells go on.
    fn height_mm(&self, place_mm: [f64; 2]) -> f64 {
        let grid = self.mesh.grid();
        let cells = [0, 1].map(|axis| {
            let parts = f64::from(self.parts[axis]);
            let cells = f64::from(grid.points[axis] - 1) * parts;
            let at =
                (place_mm[axis] * MM as f64 - f64::from(grid.from_10nm[axis])) / f64::from(grid.spacing_10nm[axis]);
            let at = (at * parts).clamp(-parts, cells + parts);
            let cell = at.floor().clamp(0.0, cells - 1.0);
            (cell as usize, at - cell)
        });
        let [(column, t), (row, v)] = cells;
        let at = |right: usize, back: usize| self.heights_um[row + back][column + right] / 1000.0;
        at(0, 0) * (1.0 - t) * (1.0 - v) + at(1, 0) * t * (1.0 - v) + at(0, 1) * (1.0 - t) * v + at(1, 1) * t * v
    }

    /// What of it is left at a height of the plan, in steps of Z.
    fn height_steps(&self, place_mm: [f64; 2], z_mm: f64) -> f64 {
        let fade_mm = f64::from(self.mesh.fade_10nm()) / MM as f64;
        let left = if fade_mm > 0.0 { (1.0 - z_mm / fade_mm).clamp(0.0, 1.0) } else { 1.0 };
        self.height_mm(place_mm) * left * self.steps_per_mm
    }
}

/// A mesh with these heights, row by row, um, from 20 mm to 120 mm.
fn mesh_of(points: [u8; 2], heights_um: &[i16], fade_10nm: i32) -> Mesh {
    mesh_between(MeshInterpolation::Bilinear, points, heights_um, fade_10nm)
}

fn mesh_between(interpolation: MeshInterpolation, points: [u8; 2], heights_um: &[i16], fade_10nm: i32) -> Mesh {
    let mut mesh = Mesh::NONE;
    mesh.begin(&MeshGrid::over([[2_000_000, 12_000_000]; 2], points).unwrap(), interpolation);
    let places = (0..points[1]).flat_map(|row| (0..points[0]).map(move |column| [column, row]));
    for (place, height) in places.zip(heights_um.iter().cycle()) {
        assert!(mesh.set_height_um(place, *height));
    }
    mesh.set_fade_10nm(fade_10nm);
    mesh
}

fn any_mesh() -> impl Strategy<Value = Mesh> {
    let points = [2u8..7, 2u8..7];
    let fade = prop_oneof![Just(0i32), 200_000i32..1_500_000];
    let between = prop_oneof![Just(MeshInterpolation::Bilinear), Just(MeshInterpolation::Bicubic)];
    (between, points, proptest::collection::vec(-150i16..150, 36), fade).prop_map(|(between, points, heights, fade)| {
        // Curves through such heights, and where they go on beyond them, are steeper than straight lines.
        let share = if between == MeshInterpolation::Bicubic { 4 } else { 1 };
        let heights: Vec<_> = heights.into_iter().map(|height| height / share).collect();
        mesh_between(between, points, &heights, fade)
    })
}

/// Paths within 0 and 140 mm, beyond the mesh too; now and then Z moves, alone or along, and the filament alone.
fn any_path() -> impl Strategy<Value = Vec<Move>> {
    let length = prop_oneof![1 => -200i64..200, 3 => -3 * MM..3 * MM, 2 => -60 * MM..60 * MM];
    let step = (length.clone(), length, -MM..MM);
    let kind = 0u8..10;
    let feed = prop_oneof![Just(10f32), Just(60.0), Just(250.0)];
    proptest::collection::vec((step, kind, feed, 0i64..3_000_000), 3..25).prop_map(|moves| {
        let mut target_10nm = START;
        let mut line = 0;
        let made = moves.into_iter().map(|((x, y, z), kind, feed_mm_per_s, filament_100pm)| {
            let moves_xy = kind < 8;
            if moves_xy {
                target_10nm[0] = (target_10nm[0] + x).clamp(0, 140 * MM);
                target_10nm[1] = (target_10nm[1] + y).clamp(0, 140 * MM);
            }
            if (7..9).contains(&kind) {
                target_10nm[2] = (target_10nm[2] + z).clamp(0, 20 * MM);
            }
            line += 1;
            let filament_100pm = if kind % 2 == 0 { filament_100pm } else { 0 };
            Move { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move: true }
        });
        made.collect()
    })
}

const START: [i64; 3] = [70 * MM, 70 * MM, MM / 5];

fn without_z(events: &[Event]) -> Vec<Event> {
    let events = events.iter().map(|(tick, axes, directions)| (*tick, axes & !Z, directions & !Z));
    events.filter(|(_, axes, _)| *axes != 0).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// X, Y and the extruder keep their steps and times to the tick, and Z is at the surface at every event.
    #[test]
    fn only_z_changes_and_it_is_at_the_surface(
        mesh in any_mesh(), path in any_path(), core in any::<bool>(), shaped in any::<bool>(),
    ) {
        let mut machine = Machine::new(if core { Kinematics::CoreXy } else { Kinematics::Cartesian });
        machine.shaped = shaped;
        let start = machine.start(&mesh);
        let plain = machine.run(start, &path, None, true);
        let followed = machine.run(start, &path, Some(&mesh), true);
        prop_assert_eq!(followed.miscounts, 0);
        prop_assert_eq!(without_z(&followed.seen.0), without_z(&plain.seen.0));
        check_surface(&machine, &mesh, start, &plain.seen.0, &followed)?;
    }
}

/// Follows both runs by their events.
fn check_surface(
    machine: &Machine,
    mesh: &Mesh,
    start_10nm: [i64; 3],
    plain: &[Event],
    followed: &Sink,
) -> Result<(), TestCaseError> {
    let surface = Surface::new(mesh, machine);
    let mut plan = machine.geometry().motor_steps(start_10nm).map(i64::from);
    let mut issued = followed.ledger.motor_steps()[2];
    for (_, axes, directions) in &followed.seen.0 {
        if axes & Z != 0 {
            issued -= if directions & Z == 0 { 1 } else { -1 };
        }
    }
    // Where Z's motor stood at first.
    let mut z = issued;
    let mut events = followed.seen.0.iter().peekable();
    // Three quarters of a step. Where the plan steps Z too, and events are so near to each other that no step fits between, the
    // next one makes the step: the surface is a little farther away until then.
    const MOST: [f64; 2] = [0.75 + 0.01, 1.0];
    let mut before = 0;
    for (tick, axes, directions) in plain {
        for (motor, steps) in plan.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                *steps += if directions >> motor & 1 == 0 { 1 } else { -1 };
            }
        }
        while let Some((_, axes, directions)) = events.next_if(|event| event.0 <= *tick) {
            if axes & Z != 0 {
                z += if directions & Z == 0 { 1 } else { -1 };
            }
        }
        let z_mm = plan[2] as f64 / machine.steps_per_mm[2];
        let away = (z - plan[2]) as f64 - surface.height_steps(machine.place(plan), z_mm);
        let [most, near] = MOST;
        let most = if axes & Z != 0 && tick - before < 2 * 168 { near } else { most };
        before = *tick;
        prop_assert!(away.abs() <= most, "{} steps away at tick {} and {:?}", away, tick, plan);
    }
    Ok(())
}

/// Z's steps: when, and by which sign.
fn z_steps(sink: &Sink) -> Vec<(f64, f64)> {
    let second = f64::from(TICKS_PER_SECOND);
    let of_z = sink.seen.0.iter().filter(|(_, axes, _)| axes & Z != 0);
    of_z.map(|(tick, _, back)| (*tick as f64 / second, if back & Z == 0 { 1.0 } else { -1.0 })).collect()
}

/// Greatest speed and acceleration of Z, mm/s and mm/s^2, by its steps, over windows of so many of one sign: the times of steps are
/// those of other events, and so much of it must not be seen.
fn fastest(steps: &[(f64, f64)], window: usize, steps_per_mm: f64) -> (f64, f64) {
    let mut most = (0.0f64, 0.0f64);
    for part in steps.windows(2 * window + 1) {
        if part.iter().any(|step| step.1 != part[0].1) {
            continue;
        }
        let [start, middle, end] = [0, window, 2 * window].map(|index| part[index].0);
        let speed = |time: f64| window as f64 / steps_per_mm / time;
        let (first, second) = (speed(middle - start), speed(end - middle));
        most.0 = most.0.max(first);
        most.1 = most.1.max((second - first).abs() / (0.5 * (end - start)));
    }
    most
}

/// A slope of 1 % at 10,000 mm/s^2, X and Y to and fro, and a Z that could not follow.
#[test]
fn z_keeps_its_limits_on_a_slope() {
    let mut machine = Machine::new(Kinematics::Cartesian);
    machine.limits.max_feed_mm_per_s[2] = 2.0;
    machine.limits.max_acceleration_mm_per_s2[2] = 6.0;
    // 1 mm over the 100 mm of the mesh.
    let mesh = mesh_of([2, 2], &[-500, 500, -500, 500], 0);
    let targets = [[120, 70], [20, 70], [120, 80], [70, 80]].map(|[x, y]| [x * MM, y * MM, MM / 5]);
    let path: Vec<Move> = (1..)
        .zip(targets)
        .map(|(line, target_10nm)| Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 300.0, line, ends_move: true })
        .collect();
    let (speed, acceleration) = fastest(&z_steps(&machine.run(START, &path, Some(&mesh), true)), 30, 400.0);
    assert!((1.96..2.02).contains(&speed), "{speed} mm/s");
    assert!((5.7..6.3).contains(&acceleration), "{acceleration} mm/s^2");
    // Without the bounds it would be 3 mm/s and 100 mm/s^2, of which these windows see a part.
    let (speed, acceleration) = fastest(&z_steps(&machine.run(START, &path, Some(&mesh), false)), 30, 400.0);
    assert!(speed > 2.9 && acceleration > 20.0, "{speed} mm/s, {acceleration} mm/s^2");
    // A Z that can is no reason to be slower.
    let machine = Machine::new(Kinematics::Cartesian);
    let plain = machine.run(START, &path, None, true);
    assert_eq!(without_z(&machine.run(START, &path, Some(&mesh), true).seen.0), without_z(&plain.seen.0));
}

/// Over a ridge Z's speed changes at once, by no more than it may at a corner.
#[test]
fn z_keeps_its_corner_velocity_over_a_ridge() {
    for (limit, most) in [(1.0, 1.03), (60.0, 9.1)] {
        let mut machine = Machine::new(Kinematics::Cartesian);
        machine.limits.instantaneous_corner_velocity_mm_per_s[2] = limit;
        // Up 1.5 % and down again.
        let mesh = mesh_of([3, 2], &[0, 750, 0, 0, 750, 0], 0);
        let start = [20 * MM, 70 * MM, MM / 5];
        let request = Move {
            target_10nm: [120 * MM, 70 * MM, MM / 5],
            filament_100pm: 0,
            feed_mm_per_s: 300.0,
            line: 1,
            ends_move: true,
        };
        let steps = z_steps(&machine.run(start, &[request], Some(&mesh), true));
        let turn = steps.iter().position(|step| step.1 < 0.0).unwrap();
        let speed = |part: &[(f64, f64)]| (part.len() - 1) as f64 / 400.0 / (part[part.len() - 1].0 - part[0].0);
        let jump = speed(&steps[turn - 41..turn]) + speed(&steps[turn..turn + 41]);
        assert!(jump <= most && jump >= 0.9 * most, "{jump} mm/s of {limit}");
    }
}

/// A surface that is twisted: Z accelerates at constant speed in the plane.
#[test]
fn z_keeps_its_acceleration_over_a_twist() {
    let mut machine = Machine::new(Kinematics::CoreXy);
    machine.limits.max_acceleration_mm_per_s2[2] = 12.0;
    let mesh = mesh_of([2, 2], &[600, -600, -600, 600], 0);
    let start = [22 * MM, 22 * MM, MM / 5];
    let target_10nm = [118 * MM, 118 * MM, MM / 5];
    let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 300.0, line: 1, ends_move: true };
    let (_, acceleration) = fastest(&z_steps(&machine.run(start, &[request], Some(&mesh), true)), 30, 400.0);
    assert!(acceleration < 12.6, "{acceleration} mm/s^2");
    let (_, acceleration) = fastest(&z_steps(&machine.run(start, &[request], Some(&mesh), false)), 30, 400.0);
    assert!(acceleration > 20.0, "{acceleration} mm/s^2");
}

/// A path along a contour line, of whose steps each goes a little up or down, turns Z hardly ever.
#[test]
fn a_contour_line_turns_z_once() {
    let machine = Machine::new(Kinematics::Cartesian);
    // It rises along X + Y by 0.4 % each.
    let mesh = mesh_of([2, 2], &[-400, 0, 0, 400], 0);
    let path: Vec<Move> = (1..=40)
        .map(|line| {
            // Each at another place between two steps of Z.
            let by = i64::from(line) * 11_000;
            let target_10nm =
                if line % 2 == 0 { [30 * MM + by, 110 * MM, MM / 5] } else { [110 * MM + by, 30 * MM, MM / 5] };
            Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 100.0, line: line as u32, ends_move: true }
        })
        .collect();
    let steps = z_steps(&machine.run(START, &path, Some(&mesh), true));
    let turns = steps.windows(2).filter(|pair| pair[0].1 != pair[1].1).count();
    assert!(turns < 80, "{turns} turns in {} steps of 40 moves", steps.len());
}

#[test]
fn meshes_that_z_cannot_follow() {
    let machine = Machine::new(Kinematics::Cartesian);
    let switched = |machine: &Machine, mesh: &Mesh| {
        let mut stage = BedStage::new(&machine.geometry());
        *stage.mesh().unwrap() = mesh.clone();
        stage.switch(true)
    };
    assert_eq!(switched(&machine, &Mesh::NONE), Err(MeshError::Incomplete));
    let mut incomplete = Mesh::NONE;
    incomplete.begin(&MeshGrid::over([[0, 1_000_000]; 2], [2, 2]).unwrap(), MeshInterpolation::Bicubic);
    assert!((0..3).all(|index| incomplete.set_height_um([index % 2, index / 2], 0)));
    assert_eq!(switched(&machine, &incomplete), Err(MeshError::Incomplete));
    assert!(!incomplete.set_height_um([2, 0], 0));
    // 6 mm over 100 mm.
    let steep = mesh_of([2, 2], &[0, 6_000, 0, 6_000], 0);
    assert!(
        matches!(switched(&machine, &steep), Err(MeshError::TooSteep { slope, .. }) if (slope - 0.06).abs() < 1e-4)
    );
    let uneven = mesh_of([2, 2], &[0, 500, 0, 500], 199_000);
    assert_eq!(switched(&machine, &uneven), Err(MeshError::FadesTooSoon { least_10nm: 200_000 }));
    // As many steps of Z as it may be steep for: 0.2 mm of Z for 1 mm of X and Y.
    let fine = Machine { steps_per_mm: [20.0, 20.0, 3200.0], ..machine };
    assert!(
        matches!(switched(&fine, &mesh_of([2, 2], &[0, 500, 0, 500], 0)), Err(MeshError::TooSteep { maximum, .. }) if maximum < 0.004)
    );
    let shared = Machine { kinematics: Kinematics::CoreXz, ..machine };
    assert_eq!(switched(&shared, &mesh_of([2, 2], &[0], 0)), Err(MeshError::SharedMotor));
    for points in [[1, 2], [2, 16], [0, 0]] {
        assert_eq!(MeshGrid::over([[0, 1_000_000]; 2], points), None, "{points:?}");
    }
    assert_eq!(MeshGrid::over([[0, 1_000_000], [5, 5]], [2, 2]), None);
}

/// A bed that is bent like a wave: the largest distance between it and the surface that Z follows, mm, by the motors' steps on rows of
/// moves over all of the mesh.
fn gap_mm(interpolation: MeshInterpolation, points: u8, bed_mm: impl Fn([f64; 2]) -> f64) -> f64 {
    let machine = Machine::new(Kinematics::Cartesian);
    let grid = MeshGrid::over([[2_000_000, 12_000_000]; 2], [points; 2]).unwrap();
    let places = (0..points).flat_map(|row| (0..points).map(move |column| [column, row]));
    let heights_um: Vec<_> = places
        .map(|point| (bed_mm(grid.place_10nm(point).map(|units| f64::from(units) / MM as f64)) * 1000.0).round() as i16)
        .collect();
    let mesh = mesh_between(interpolation, [points; 2], &heights_um, 0);
    let start = machine.start(&mesh);
    let mut moves = Vec::new();
    for row in 0..=20 {
        let (y, x) = ((20 + row * 5) * MM, if row % 2 == 0 { 120 * MM } else { 20 * MM });
        let from_x = 140 * MM - x;
        for target_10nm in [[from_x, y, start[2]], [x, y, start[2]]] {
            moves.push(Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 100.0, line: 1, ends_move: true });
        }
    }
    let followed = machine.run(start, &moves, Some(&mesh), true);
    let mut place = machine.geometry().motor_steps(start).map(i64::from);
    let plan_z = place[2];
    place[2] = followed.ledger.motor_steps()[2];
    for (_, axes, directions) in &followed.seen.0 {
        place[2] -= if axes & Z == 0 {
            0
        } else if directions & Z == 0 {
            1
        } else {
            -1
        };
    }
    let mut most: f64 = 0.0;
    for (_, axes, directions) in &followed.seen.0 {
        for (motor, steps) in place.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                *steps += if directions >> motor & 1 == 0 { 1 } else { -1 };
            }
        }
        let [x, y] = machine.place(place);
        if (20.0..=120.0).contains(&x) && (20.0..=120.0).contains(&y) {
            most = most.max(((place[2] - plan_z) as f64 / 400.0 - bed_mm([x, y])).abs());
        }
    }
    most
}

/// On bent beds the curves leave less of a gap than straight lines between the same points.
#[test]
fn curves_fit_a_bent_bed_better() {
    use MeshInterpolation::{Bicubic, Bilinear};
    type Bed = fn([f64; 2]) -> f64;
    let bowl: Bed = |[x, y]| 0.5 * (((x - 70.0) / 50.0).powi(2) + ((y - 70.0) / 50.0).powi(2)) - 0.4;
    let wave: Bed = |[x, y]| 0.3 * (x / 25.0).sin() + 0.2 * (y / 30.0).cos();
    let saddle: Bed = |[x, y]| (x - 70.0) * (y - 60.0) / 5000.0 + 0.2 * (x / 40.0).sin();
    for (name, bed, points, share) in [
        ("bowl", bowl, 4, 0.1),
        ("bowl", bowl, 5, 0.15),
        ("wave", wave, 5, 0.5),
        ("wave", wave, 7, 0.4),
        ("saddle", saddle, 4, 0.5),
    ] {
        let [straight, curved] = [Bilinear, Bicubic].map(|between| gap_mm(between, points, bed));
        println!("{name}, {points} by {points} points: {straight:.4} mm bilinear, {curved:.4} mm bicubic");
        // Z keeps within 3/4 of a step of 2.5 um.
        assert!(curved < 0.003 + share * straight, "{name}, {points}: {straight} mm, {curved} mm");
    }
}

proptest! {
    /// The surface is at the measured points where they were measured, whatever is between them; and never higher than it says.
    #[test]
    fn curves_pass_through_the_measured_points(mesh in any_mesh(), at in [0.0f64..1.0, 0.0..1.0]) {
        let machine = Machine::new(Kinematics::Cartesian);
        let geometry = machine.geometry();
        let mut stage = BedStage::new(&geometry);
        *stage.mesh().unwrap() = mesh.clone();
        stage.mesh().unwrap().set_fade_10nm(0);
        stage.switch(true).unwrap();
        let grid = mesh.grid();
        for row in 0..grid.points[1] {
            for column in 0..grid.points[0] {
                let [x, y] = grid.place_10nm([column, row]).map(i64::from);
                let height_um = mesh.height_um([column, row]).unwrap();
                let correction = stage.stand(geometry.motor_steps([x, y, 0]).map(i64::from), 0);
                let away = correction as f64 - f64::from(height_um) * 0.4;
                // Half a step, and what the surface rises in half a step of X and Y.
                prop_assert!(away.abs() <= 0.55, "{column} {row}: {away}");
            }
        }
        let highest = f64::from(stage.mesh().unwrap().highest_10nm()) / MM as f64;
        let surface = Surface::new(&mesh, &machine);
        let place = at.map(|share| -60.0 + 260.0 * share);
        prop_assert!(surface.height_mm(place) <= highest + 1e-9, "{} above {highest}", surface.height_mm(place));
    }
}
