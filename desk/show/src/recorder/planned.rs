//! The record of a print whose steps are not made: from moves with their phases to nodes.

use ferrostep_simulator::nozzle::NozzleError;

use super::{Machine, Recorder};
use crate::node::{Kind, Node};
use crate::path::{Place, motion, node};

/// A part of a move in which the speed changes evenly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Phase {
    /// Duration of the phase, s.
    pub seconds: f64,
    /// Speeds at its start and its end, mm/s: of the path, or of the filament where only
    /// that moves.
    pub speeds_mm_per_s: [f64; 2],
    /// Number of the limit that holds, in the page's list of their names, from 1; 0: unknown.
    pub limit: u8,
}

/// A straight move as it is executed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExecutedMove {
    /// Number of its line.
    pub line: u32,
    /// Start of the move, machine coordinates, mm.
    pub start_mm: [f64; 3],
    /// Displacement of X, Y, Z and the filament, mm.
    pub displacement_mm: [f64; 4],
    /// The speed that its line asks for, mm/s.
    pub feed_mm_per_s: f64,
    /// Phases of the move, one after the other.
    pub phases: [Phase; 3],
}

impl Recorder {
    /// Begins a record of moves as they are planned, with the machine at zero.
    ///
    /// # Errors
    /// The nozzle's numbers are out of range.
    pub fn of_plan(machine: Machine) -> Result<Self, NozzleError> {
        Ok(Self { is_planned: true, ..Self::new(machine)? })
    }

    /// A move is executed, after all before it.
    pub fn ran(&mut self, one: &ExecutedMove) {
        let state = self.states.at(one.line);
        let [x, y, z, filament_mm] = one.displacement_mm;
        let path_mm = (x * x + y * y + z * z).sqrt();
        let (kind, bead) =
            if state.homes { (Kind::Homing, 0.0) } else { motion(path_mm, filament_mm, self.machine.filament_mm2) };
        let passed_mm = |phase: &Phase| 0.5 * (phase.speeds_mm_per_s[0] + phase.speeds_mm_per_s[1]) * phase.seconds;
        let all_mm: f64 = one.phases.iter().map(passed_mm).sum();
        let mut place = self.speeds.last();
        let mut so_far_mm = 0.0;
        let mut longest = Phase::default();
        let last = one.phases.iter().rposition(|phase| phase.seconds > 0.0);
        for (index, phase) in one.phases.iter().enumerate().filter(|(_, phase)| phase.seconds > 0.0) {
            so_far_mm += passed_mm(phase);
            let is_last = Some(index) == last;
            let share = if is_last || all_mm <= 0.0 { 1.0 } else { so_far_mm / all_mm };
            place.time_s += phase.seconds;
            place.position_mm = std::array::from_fn(|axis| one.start_mm[axis] + share * one.displacement_mm[axis]);
            if phase.seconds > longest.seconds {
                longest = *phase;
            }
            // Filament alone has no path on which its speed could be shown.
            let (speed_mm_per_s, limit) = match kind.moves() {
                true => (phase.speeds_mm_per_s[1], phase.limit),
                false if !is_last => continue,
                false => (0.0, longest.limit),
            };
            let feed_mm_per_s = one.feed_mm_per_s as f32;
            self.nodes.keep(Node { feed_mm_per_s, limit, ..node(place, speed_mm_per_s, kind, bead, one.line, state) });
        }
        self.begin(place);
    }

    /// The machine is at another place from a tick of the motion clock on, as after homing.
    pub fn stands(&mut self, tick: u64, position_mm: [f64; 3]) {
        self.tick = self.tick.max(tick);
        let place = Place { time_s: self.time_s(tick), position_mm, ..self.speeds.last() };
        self.stand(place);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use ferrostep_simulator::nozzle::NozzleSettings;

    use super::*;
    use crate::lines::LineState;

    fn recorder() -> Recorder {
        let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Recorder::of_plan(Machine {
            tick_hz: 1000,
            mm_per_step: unit,
            filament_mm_per_step: 1.0,
            filament_mm2: 2.0,
            nozzle: NozzleSettings::default(),
            max_nodes: 100,
        })
        .unwrap()
    }

    fn phase(seconds: f64, speeds_mm_per_s: [f64; 2], limit: u8) -> Phase {
        Phase { seconds, speeds_mm_per_s, limit }
    }

    /// A print of 20 mm without a ramp at its end, and a retraction after a wait.
    #[test]
    fn phases_retractions_and_waits_become_nodes() {
        let mut recorder = recorder();
        recorder.stands(1000, [5.0, 0.0, 0.2]);
        recorder.note_state(3, LineState { layer: Some(4), feature: 2, ..LineState::default() });
        let phases = [phase(1.0, [0.0, 10.0], 1), phase(1.5, [10.0, 10.0], 2), phase(0.0, [10.0, 10.0], 1)];
        let line = ExecutedMove {
            line: 3,
            start_mm: [5.0, 0.0, 0.2],
            displacement_mm: [20.0, 0.0, 0.0, 1.0],
            feed_mm_per_s: 10.0,
            phases,
        };
        recorder.ran(&line);
        recorder.executes(4);
        recorder.waited(3500, 2.0, false);
        let phases = [phase(0.1, [0.0, 20.0], 3), phase(0.0, [20.0, 20.0], 2), phase(0.1, [20.0, 0.0], 3)];
        let retraction = ExecutedMove {
            line: 5,
            start_mm: [25.0, 0.0, 0.2],
            displacement_mm: [0.0, 0.0, 0.0, -2.0],
            phases,
            ..line
        };
        recorder.ran(&retraction);
        let nodes = recorder.finish().nodes;
        let found: Vec<_> = nodes
            .iter()
            .map(|node| (node.kind, node.line, node.time_s, node.position_mm[0], node.speed_mm_per_s, node.limit))
            .collect();
        let expected = [
            (Kind::Travel, 0, 0.0, 0.0, 0.0, 0),
            (Kind::Homing, 0, 1.0, 5.0, 0.0, 0),
            (Kind::Print, 3, 2.0, 10.0, 10.0, 1),
            (Kind::Print, 3, 3.5, 25.0, 10.0, 2),
            (Kind::Wait, 4, 5.5, 25.0, 0.0, 0),
            (Kind::Retract, 5, 5.7, 25.0, 0.0, 3),
        ];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found.2 - expected.2).abs() < 1e-9, "{found:?}, expected {expected:?}");
            assert_eq!(
                (found.0, found.1, found.3, found.4, found.5),
                (expected.0, expected.1, expected.3, expected.4, expected.5)
            );
        }
        let [print, retraction] = [&nodes[3], &nodes[5]];
        assert_eq!((print.layer, print.feature, print.bead), (4, 2, 0.1));
        assert_eq!(retraction.bead, -2.0);
    }
}
