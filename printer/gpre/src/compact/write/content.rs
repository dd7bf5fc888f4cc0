//! The payload of a frame.

use std::vec::Vec;

use super::items::ItemWriter;
use super::lambdas::lambdas;
use super::steps::Steps;
use super::waiting::{Place, Waiting};
use crate::bits::{BitWriter, golomb_bits, zigzag};
use crate::compact::shape::{FILAMENT_PREDICTED, PATH_NONE, PATH_XY, PATH_XYZ, PATH_Z};

/// Units that X, Y and Z are tried in, of 10 nm, and the filament, of 0.1 nm; or else the largest
/// that divides all.
const UNITS: [i64; 4] = [1000, 100, 10, 1];

/// The items of a frame, with its units, lambdas and code orders.
pub struct Content<'a> {
    start: &'a Place,
    items: &'a [Waiting],
    unit_10nm: i64,
    filament_unit_100pm: i64,
    /// Steps of the moves, in order.
    steps: Vec<Steps>,
    /// The lambda of each move, where it has one.
    lambdas: Vec<f32>,
    orders: [u32; 4],
}

/// The largest of the units that divides all, or the greatest common divisor where that is larger
/// and small enough.
fn unit(all: impl Iterator<Item = i64>) -> i64 {
    let common = all.fold(0i64, |mut a, b| {
        let mut b = b.abs();
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    });
    if common == 0 {
        return 1;
    }
    let tried = UNITS.into_iter().find(|unit| common % unit == 0).unwrap_or(1);
    if common <= 1000 { common.max(tried) } else { tried }
}

impl<'a> Content<'a> {
    pub fn new(start: &'a Place, items: &'a [Waiting]) -> Self {
        let moves = || items.iter().filter_map(|item| if let Waiting::Move(next) = item { Some(next) } else { None });
        let mut position = start.position_10nm;
        let mut paths = Vec::new();
        for next in moves() {
            let target = next.target_10nm().map(i64::from);
            let [x, y, z] = target;
            paths.push([x - position[0], y - position[1], z - position[2]]);
            position = target;
        }
        let unit_10nm = unit(paths.iter().flatten().copied());
        let filament_unit_100pm = unit(moves().map(|next| next.filament_100pm));
        let steps: Vec<_> = paths
            .iter()
            .zip(moves())
            .map(|(path, next)| {
                let kind = match path {
                    [0, 0, 0] => PATH_NONE,
                    [0, 0, _] => PATH_Z,
                    [_, _, 0] => PATH_XY,
                    _ => PATH_XYZ,
                };
                // Lengths are within 10 m.
                let path = path.map(|component| (component / unit_10nm) as i32);
                Steps { path, filament: next.filament_100pm / filament_unit_100pm, kind }
            })
            .collect();
        let lambdas = lambdas(&steps);
        let mut content = Self { start, items, unit_10nm, filament_unit_100pm, steps, lambdas, orders: [0; 4] };
        content.choose_orders();
        content
    }

    fn choose_orders(&mut self) {
        let mut numbers: [Vec<u64>; 4] = Default::default();
        for (steps, &lambda) in self.steps.iter().zip(&self.lambdas) {
            if steps.kind == PATH_XY || steps.kind == PATH_XYZ {
                numbers[0].push(zigzag(steps.path[0].into()));
                numbers[1].push(zigzag(steps.path[1].into()));
            }
            if steps.kind == PATH_Z || steps.kind == PATH_XYZ {
                numbers[2].push(zigzag(steps.path[2].into()));
            }
            if let (FILAMENT_PREDICTED, difference) = steps.encoded_filament(lambda) {
                numbers[3].push(zigzag(difference));
            }
        }
        for (order, numbers) in self.orders.iter_mut().zip(&numbers) {
            let bits = |k: u32| numbers.iter().map(|&number| u64::from(golomb_bits(number, k))).sum::<u64>();
            *order = (0..24).min_by_key(|&k| bits(k)).unwrap_or(0);
        }
    }

    pub fn payload(&self, can_be_entered: bool) -> Vec<u8> {
        let mut bits = BitWriter::default();
        let (start, modal) = (self.start, &self.start.modal);
        bits.bits(can_be_entered.into(), 1);
        for coordinate in start.position_10nm {
            bits.signed(coordinate, 24);
        }
        bits.golomb(start.line.into(), 20);
        bits.bits(start.feed_mm_per_s.to_bits().into(), 32);
        bits.signed(modal.extruder_10nm, 28);
        for offset in modal.offset_10nm {
            bits.signed(offset, 8);
        }
        bits.signed(modal.lift_10nm, 8);
        bits.golomb(modal.nozzle_celsius.into(), 8);
        bits.golomb(modal.bed_celsius.into(), 8);
        bits.golomb(modal.feed_percent.into(), 7);
        bits.golomb(modal.flow_percent.into(), 7);
        bits.bits(start.fan_power.into(), 8);
        bits.bits(modal.limits.is_some().into(), 1);
        for value in modal.limits.iter().flatten() {
            let whole = *value as u32;
            if whole as f32 == *value && whole < 1 << 24 {
                bits.bits(0, 1);
                bits.golomb(whole.into(), 10);
            } else {
                bits.bits(1, 1);
                bits.bits(value.to_bits().into(), 32);
            }
        }
        bits.golomb(self.unit_10nm.unsigned_abs(), 7);
        bits.golomb(self.filament_unit_100pm.unsigned_abs(), 7);
        for order in self.orders {
            bits.bits(order.into(), 5);
        }
        let mut items = ItemWriter::new(self.start);
        let mut moves = self.steps.iter().zip(&self.lambdas);
        for item in self.items {
            match item {
                Waiting::Move(next) => {
                    if let Some((steps, lambda)) = moves.next() {
                        items.add_move(next, steps, *lambda, self.orders);
                    }
                }
                Waiting::Fan { line, power } => {
                    items.begin_other(5);
                    items.bits.golomb(u64::from(line.saturating_sub(items.line)), 1);
                    items.line = *line;
                    items.bits.bits((*power).into(), 8);
                }
                Waiting::Command { line, text } => items.add_command(*line, text),
                Waiting::Modal(_) => {}
            }
        }
        bits.golomb(items.count, 8);
        let length = items.bits.length();
        let bytes = items.bits.into_bytes();
        for index in 0..length {
            bits.bits((bytes[index / 8] >> (7 - index % 8) & 1).into(), 1);
        }
        bits.into_bytes()
    }
}
