//! The record of a print: from steps, waits and temperatures to nodes.

mod planned;

use ferrostep_simulator::nozzle::{Nozzle, NozzleError, NozzleSettings};

use crate::commanded::PlannedMove;
use crate::layers::Layers;
use crate::lines::{LineState, LineStates};
use crate::node::{Kind, Node, UNMARKED};
use crate::path::{Path, Place};
use crate::reduce::{Nodes, Reduced};
use crate::sampler::{Sample, Sampler};
use crate::speeds::{Ending, Speeds};
use crate::surface::Surface;
use crate::temperatures::{Temperature, Temperatures};
use crate::totals::Totals;

pub use planned::{ExecutedMove, Phase};

/// Shorter waits are a rounding of clocks.
const SHORTEST_WAIT_S: f64 = 1e-5;

/// Parameters of a machine that the record needs.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Ticks of the motion clock in a second, at least 1000.
    pub tick_hz: u32,
    /// Millimetres of X, Y and Z for a step of each of the three motors.
    pub mm_per_step: [[f64; 3]; 3],
    /// Millimetres of filament for a step of the extruder.
    pub filament_mm_per_step: f64,
    /// Cross-section of the filament.
    pub filament_mm2: f64,
    /// The nozzle.
    pub nozzle: NozzleSettings,
    /// Maximum number of nodes to keep, at least 16.
    pub max_nodes: usize,
}

/// Records a print.
#[derive(Debug)]
pub struct Recorder {
    machine: Machine,
    sampler: Sampler,
    /// True if moves arrive as they are planned, without steps.
    is_planned: bool,
    surface: Option<Surface>,
    speeds: Speeds,
    path: Path,
    nozzle: Nozzle,
    /// Volume in the nozzle beyond what has flowed out, mm^3.
    pressure_mm3: f64,
    states: LineStates,
    /// The line that is being executed.
    line: u32,
    idle_s: f64,
    tick: u64,
    nodes: Kept,
    temperatures: Temperatures,
}

/// A finished record.
#[derive(Debug, Default)]
pub struct Recording {
    /// The path, in the order of time; the first is its beginning.
    pub nodes: Vec<Node>,
    /// Nodes that were left out because there were too many.
    pub left_out: u64,
    /// Largest distance of the path from the nodes that were left out, mm: the same in every
    /// layer; 0 if none were.
    pub tolerance_mm: f32,
    /// Sums over all nodes, also those left out.
    pub totals: Totals,
    /// Temperatures in time.
    pub temperatures: Vec<Temperature>,
}

/// Nodes and what is counted of them.
#[derive(Debug)]
struct Kept {
    nodes: Nodes,
    totals: Totals,
    last: Node,
    layers: Layers,
    /// True from the first node on whose layer the file marks.
    is_marked: bool,
}

impl Kept {
    fn keep(&mut self, mut node: Node) {
        if node.layer == UNMARKED {
            node.layer = self.layers.note(&self.last, &node);
            if self.layers.take_beginning() {
                self.totals.begin_part(self.last.time_s);
            }
        } else if !std::mem::replace(&mut self.is_marked, true) && self.totals.has_printed() {
            self.totals.begin_part(self.last.time_s);
        }
        self.totals.note(&self.last, &node);
        let is_longer = matches!(node.kind, Kind::Wait | Kind::Heating)
            && (self.last.kind, self.last.line, self.last.position_mm) == (node.kind, node.line, node.position_mm);
        self.last = node;
        // A long wait comes in pieces.
        if is_longer { self.nodes.replace_last(node) } else { self.nodes.push(node) }
    }
}

impl Kept {
    fn keep_rest(&mut self, mut node: Node) {
        node.time_s = self.last.time_s;
        if node.layer == UNMARKED {
            node.layer = self.layers.note(&self.last, &node);
        }
        self.last = node;
        self.nodes.push(node);
    }
}

impl Recorder {
    /// Begins a record with the machine at zero.
    ///
    /// # Errors
    /// The nozzle's numbers are out of range.
    pub fn new(machine: Machine) -> Result<Self, NozzleError> {
        let mut nodes = Kept {
            nodes: Nodes::new(machine.max_nodes.max(16)),
            totals: Totals::default(),
            last: Node::default(),
            layers: Layers::default(),
            is_marked: false,
        };
        nodes.nodes.push(Node::default());
        let step_mm = machine.mm_per_step.iter().map(|axis| axis.iter().map(|mm| mm.abs()).sum()).fold(0.0, f64::max);
        Ok(Self {
            sampler: Sampler::new(machine.tick_hz.max(1000)),
            is_planned: false,
            surface: None,
            speeds: Speeds::new(step_mm, Place::default()),
            path: Path::new(machine.filament_mm2, machine.filament_mm_per_step, Place::default()),
            nozzle: Nozzle::new(machine.nozzle)?,
            pressure_mm3: 0.0,
            states: LineStates::default(),
            line: 0,
            idle_s: 0.0,
            tick: 0,
            nodes,
            temperatures: Temperatures::default(),
            machine,
        })
    }

    /// A line is being executed; its motion may come later.
    pub fn executes(&mut self, line: u32) {
        self.line = line;
    }

    /// The state of the file from a line on.
    pub fn note_state(&mut self, line: u32, state: LineState) {
        self.states.note(line, state);
    }

    /// Motors step at a tick of the motion clock; bit i of `directions`: motor i steps backwards.
    #[inline]
    pub fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.tick = tick;
        if self.sampler.step(tick, axes, directions) {
            let settled = self.sampler.settled_tick(tick);
            self.sample(settled);
        }
    }

    /// A move has been planned after the others; if it ends its line's move,
    /// [`Self::move_ended`] follows.
    pub fn planned(&mut self, taken: &PlannedMove) {
        self.path.planned(taken);
    }

    /// The move of a line ends at a tick.
    pub fn move_ended(&mut self, tick: u64, line: u32) {
        self.sampler.end_move(tick, line);
        self.tick = self.tick.max(tick);
    }

    /// Z follows this surface from now on, or none; the motors are at rest.
    pub fn follow(&mut self, surface: Option<Surface>) {
        self.settle(false);
        self.surface = surface;
        let place = self.place(self.tick, self.sampler.positions().map(|steps| steps as f64));
        self.begin(place);
    }

    /// Gives the motors other positions from now on, as homing does. Z then follows no surface.
    pub fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.tick = self.tick.max(tick);
        self.settle(true);
        self.surface = None;
        self.path.broken_off();
        self.sampler.redefine(tick, motor_steps);
        let place = self.place(tick, motor_steps.map(|steps| steps as f64));
        self.stand(place);
    }

    /// The machine is at a place that homing has given it.
    fn stand(&mut self, place: Place) {
        self.begin(place);
        let node = Node {
            time_s: place.time_s,
            position_mm: place.position_mm.map(|mm| mm as f32),
            kind: Kind::Homing,
            line: self.line,
            layer: UNMARKED,
            pressure_mm3: self.pressure_mm3 as f32,
            ..Node::default()
        };
        self.nodes.keep(node);
    }

    /// The motion clock has reached a tick, and time has passed while it stopped there: `idle_s` in
    /// all since the beginning. `heats`: for a heater.
    pub fn waited(&mut self, tick: u64, idle_s: f64, heats: bool) {
        if idle_s <= self.idle_s + SHORTEST_WAIT_S {
            return;
        }
        self.tick = self.tick.max(tick);
        self.settle(false);
        self.idle_s = idle_s;
        let state = self.states.at(self.line);
        let kind = if heats { Kind::Heating } else { Kind::Wait };
        // Pressure continues to fall.
        let mut place = self.speeds.last();
        let time_s = self.time_s(self.tick);
        self.press(time_s - place.time_s, 0.0);
        place.time_s = time_s;
        place.pressure_mm3 = self.pressure_mm3;
        self.begin(place);
        let nozzle_mm: [f64; 3] = std::array::from_fn(|axis| place.position_mm[axis] + state.nozzle_mm[axis]);
        let node = Node {
            time_s,
            pressure_mm3: self.pressure_mm3 as f32,
            feed_mm_per_s: state.feed_mm_per_s,
            line: self.line,
            layer: state.layer.unwrap_or(UNMARKED),
            kind,
            feature: state.feature,
            tool: state.tool,
            position_mm: nozzle_mm.map(|mm| mm as f32),
            ..Node::default()
        };
        self.nodes.keep(node);
    }

    /// Temperatures now.
    pub fn note_temperature(&mut self, temperature: Temperature) {
        self.temperatures.note(temperature);
    }

    /// A part that the job asks for after the line that stopped it. It has no time, and is counted
    /// in nothing.
    pub fn rest(&mut self, node: Node) {
        self.settle(false);
        self.nodes.keep_rest(node);
    }

    /// Ends the record.
    pub fn finish(mut self) -> Recording {
        self.settle(false);
        let Reduced { nodes, left_out, tolerance_mm } = self.nodes.nodes.finish();
        Recording {
            nodes,
            left_out,
            tolerance_mm,
            totals: self.nodes.totals.finish(),
            temperatures: self.temperatures.finish(),
        }
    }

    fn time_s(&self, tick: u64) -> f64 {
        tick as f64 / f64::from(self.machine.tick_hz) + self.idle_s
    }

    fn place(&self, tick: u64, [a, b, c, extruder]: [f64; 4]) -> Place {
        let [x, y, z] = self.machine.mm_per_step;
        let sum = |row: [f64; 3]| row[0] * a + row[1] * b + row[2] * c;
        let motors_mm = [sum(x), sum(y), sum(z)];
        Place {
            time_s: self.time_s(tick),
            position_mm: self.surface.as_ref().map_or(motors_mm, |surface| surface.planned_mm(motors_mm)),
            filament_mm: extruder * self.machine.filament_mm_per_step,
            pressure_mm3: self.pressure_mm3,
        }
    }

    /// Pushes filament into the nozzle for a time.
    fn press(&mut self, time_s: f64, filament_mm: f64) {
        if time_s > 0.0 {
            let volume_mm3 = filament_mm * self.machine.filament_mm2;
            let out_mm3 = self.nozzle.advance(time_s, volume_mm3 / time_s);
            self.pressure_mm3 += volume_mm3 - out_mm3;
        }
    }

    /// Starts again at another place.
    fn begin(&mut self, place: Place) {
        self.speeds.begin(place);
        self.path.begin(place);
    }

    /// Takes all samples up to a tick.
    fn sample(&mut self, until: u64) {
        while let Some(Sample { tick, motors, ends }) = self.sampler.next(until) {
            self.take(tick, motors, ends);
            self.pass(false);
        }
    }

    fn take(&mut self, tick: u64, motors: [f64; 4], ends: Option<u32>) {
        let before = self.speeds.last();
        let mut place = self.place(tick, motors);
        self.press(place.time_s - before.time_s, place.filament_mm - before.filament_mm);
        place.pressure_mm3 = self.pressure_mm3;
        self.speeds.push(Ending { place, ends });
    }

    /// Passes on the samples whose speed is known: all of them at rest.
    fn pass(&mut self, is_at_rest: bool) {
        let Self { path, nodes, states, speeds, .. } = self;
        while let Some((Ending { place, ends }, speed_mm_per_s)) = speeds.pop(is_at_rest) {
            path.pass(place, speed_mm_per_s);
            if let Some(line) = ends {
                path.end(line, states, &mut |node| nodes.keep(node));
            }
        }
    }

    /// Takes all samples up to now, when the motors are at rest.
    fn settle(&mut self, homes: bool) {
        if self.is_planned || self.nodes.last.is_rest {
            return;
        }
        self.sample(self.tick);
        // The rest of a grid's interval.
        self.take(self.tick, self.sampler.positions().map(|steps| steps as f64), None);
        self.pass(true);
        let Self { path, nodes, states, line, .. } = self;
        path.settle(*line, homes, states, &mut |node| nodes.keep(node));
    }
}
