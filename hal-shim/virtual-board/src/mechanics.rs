//! A machine's frame, sheet and sensors without its motors' steps: moves are lengths, so that a
//! homing takes microseconds of the desk's time and can be tried from very many places.
//!
//! The frame has a hard end on both sides of each axis; the lower one of Z is the bed. A motor that
//! pushes against an end loses those steps, and the greatest push is recorded.

use super::VirtualProbe;

/// Distance that a motor must be held back until its driver reports a stall, units of 10 nm: 0.06
/// mm, as [`super::StallSignal`] has it for the Prusa MINI.
pub const STALL_LAG_10NM: i64 = 6_000;

/// Up to this far before its place a sensor that bounces may seem to trigger, units
/// of 10 nm: 0.1 mm.
pub const BOUNCE_10NM: i64 = 10_000;

/// The sensor that an axis homes with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorPlace {
    /// A switch, or a probe's height, at this machine coordinate, units of 10 nm.
    At(i64),
    /// The motor stalls at the frame's end.
    Frame,
}

/// Faults of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorFault {
    /// The sensor works.
    Healthy,
    /// Always triggered: a broken wire of a switch that opens, an input without a sensor
    /// and with a pull-up.
    AlwaysOn,
    /// Never triggered: a shorted wire, no sheet on the bed.
    AlwaysOff,
    /// The input has the sensor of another axis.
    WiredTo(usize),
    /// The signal comes and goes within 0.1 mm before the sensor's place.
    Bouncing,
    /// Every other approach ends at a spike anywhere before its end.
    Spiking,
}

/// An axis's sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualSensor {
    /// Place of the sensor.
    pub place: SensorPlace,
    /// True at the upper end of the axis, false at the lower.
    pub at_max: bool,
    /// The sensor's fault.
    pub fault: SensorFault,
}

/// The machine.
#[derive(Clone, Debug)]
pub struct Mechanics {
    /// Lower and upper end of each axis, units of 10 nm; Z's lower end is the bed.
    frame_10nm: [[i64; 2]; 3],
    /// The sensors of X, Y and Z.
    pub sensors: [VirtualSensor; 3],
    /// Z's sensor is this probe.
    probe: Option<VirtualProbe>,
    true_10nm: [i64; 3],
    /// Distance that each motor pushes against an end of the frame now, with its sign.
    push_10nm: [i64; 3],
    /// Greatest distance so far, against the lower and the upper end.
    beyond_10nm: [[i64; 2]; 3],
    random: u64,
}

impl Mechanics {
    /// A machine whose nozzle truly is at a place within the frame; `seed` sets
    /// the random choices.
    pub fn new(
        frame_10nm: [[i64; 2]; 3],
        sensors: [VirtualSensor; 3],
        probe: Option<VirtualProbe>,
        true_10nm: [i64; 3],
        seed: u64,
    ) -> Self {
        let random = seed | 1;
        Self { frame_10nm, sensors, probe, true_10nm, push_10nm: [0; 3], beyond_10nm: [[0; 2]; 3], random }
    }

    /// True position of the nozzle, units of 10 nm.
    pub fn true_position_10nm(&self) -> [i64; 3] {
        self.true_10nm
    }

    /// Greatest distances that the motors have pushed against the lower and the upper end of each
    /// axis, units of 10 nm.
    pub fn pushed_10nm(&self) -> [[i64; 2]; 3] {
        self.beyond_10nm
    }

    /// The motors move by this.
    pub fn go(&mut self, by_10nm: [i64; 3]) {
        for (axis, by) in by_10nm.into_iter().enumerate() {
            self.go_along(axis, by);
        }
    }

    fn go_along(&mut self, axis: usize, by_10nm: i64) {
        let (Some([lower, upper]), Some(place), Some(push), Some(beyond)) = (
            self.frame_10nm.get(axis).copied(),
            self.true_10nm.get_mut(axis),
            self.push_10nm.get_mut(axis),
            self.beyond_10nm.get_mut(axis),
        ) else {
            return;
        };
        if by_10nm == 0 {
            return;
        }
        if push.signum() != by_10nm.signum() {
            *push = 0;
        }
        let wanted = *place + by_10nm;
        *place = wanted.clamp(lower, upper);
        *push += wanted - *place;
        beyond[0] = beyond[0].max(-*push);
        beyond[1] = beyond[1].max(*push);
    }

    /// The motors move an axis by this, or less: until its input says that the sensor has
    /// triggered. Returns how far they have moved, and whether it has.
    pub fn seek(&mut self, axis: usize, by_10nm: i64) -> (i64, bool) {
        let length = by_10nm.abs();
        let spike = matches!(self.sensors.get(axis), Some(VirtualSensor { fault: SensorFault::Spiking, .. }))
            .then(|| (self.chance(2) == 0).then(|| self.chance(length.max(1))))
            .flatten();
        let way = self.way_to_sensor(axis, by_10nm.signum()).into_iter().chain(spike).min();
        let (length, triggered) = match way {
            Some(way) if way <= length => (way, true),
            _ => (length, false),
        };
        let moved = length * by_10nm.signum();
        self.go_along(axis, moved);
        (moved, triggered)
    }

    /// True if an axis's input reads as triggered, at standstill.
    pub fn is_triggered(&self, axis: usize) -> bool {
        let Some(sensor) = self.sensors.get(axis) else { return false };
        match sensor.fault {
            SensorFault::AlwaysOn => true,
            SensorFault::AlwaysOff => false,
            SensorFault::WiredTo(other) => self.sensors.get(other).is_some_and(|sensor| self.has_met(other, sensor)),
            SensorFault::Healthy | SensorFault::Bouncing | SensorFault::Spiking => self.has_met(axis, sensor),
        }
    }

    /// True if the axis really is at its sensor.
    fn has_met(&self, axis: usize, sensor: &VirtualSensor) -> bool {
        // Only a motor in motion can stall.
        let SensorPlace::At(at) = sensor.place else { return false };
        let Some(&place) = self.true_10nm.get(axis) else { return false };
        self.is_in_sight(axis) && if sensor.at_max { place >= at } else { place <= at }
    }

    /// True if the axis's sensor is not a probe, or the probe is above the sheet.
    fn is_in_sight(&self, axis: usize) -> bool {
        axis != 2 || self.probe.is_none_or(|probe| probe.is_above_sheet(self.true_10nm))
    }

    /// Distance that the motors must move in a direction until the input triggers; `None`
    /// if it never does.
    fn way_to_sensor(&mut self, axis: usize, direction: i64) -> Option<i64> {
        let sensor = *self.sensors.get(axis)?;
        if self.is_triggered(axis) {
            return Some(0);
        }
        let towards = if sensor.at_max { 1 } else { -1 };
        let never = matches!(sensor.fault, SensorFault::AlwaysOff | SensorFault::WiredTo(_));
        if never || direction != towards || !self.is_in_sight(axis) {
            return None;
        }
        let (place, [lower, upper]) = (*self.true_10nm.get(axis)?, *self.frame_10nm.get(axis)?);
        let end = if sensor.at_max { upper } else { lower };
        let way = match sensor.place {
            SensorPlace::Frame => (end - place) * towards + STALL_LAG_10NM,
            // A switch beyond the frame is never reached.
            SensorPlace::At(at) if (end - at) * towards < 0 => return None,
            SensorPlace::At(at) => (at - place) * towards,
        };
        let early = if sensor.fault == SensorFault::Bouncing { self.chance(BOUNCE_10NM) } else { 0 };
        Some((way - early).max(0))
    }

    /// A number from 0 to below `below` (xorshift, Marsaglia 2003).
    fn chance(&mut self, below: i64) -> i64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        ((self.random >> 11) % below.unsigned_abs().max(1)).cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MM: i64 = 100_000;

    fn sensor(place: SensorPlace, at_max: bool) -> VirtualSensor {
        VirtualSensor { place, at_max, fault: SensorFault::Healthy }
    }

    /// X stalls at its upper end, Y has a switch at 0, Z a probe at 1 mm; the sheet is 100 mm wide.
    fn machine(place: [i64; 3]) -> Mechanics {
        let probe =
            VirtualProbe { offset_10nm: [-10 * MM, 0], sheet_10nm: [[0, 100 * MM]; 2], shape: crate::SheetShape::FLAT };
        let sensors =
            [sensor(SensorPlace::Frame, true), sensor(SensorPlace::At(0), false), sensor(SensorPlace::At(MM), false)];
        Mechanics::new([[-2 * MM, 100 * MM]; 3], sensors, Some(probe), place, 7)
    }

    #[test]
    fn the_frame_holds_what_is_pushed_against_it() {
        let mut machine = machine([95 * MM, 50 * MM, 50 * MM]);
        machine.go([8 * MM, 0, -60 * MM]);
        assert_eq!(machine.true_position_10nm(), [100 * MM, 50 * MM, -2 * MM]);
        assert_eq!(machine.pushed_10nm(), [[0, 3 * MM], [0, 0], [8 * MM, 0]]);
        // What was lost there is not found again, and pushes in one direction add up.
        machine.go([MM, 0, 5 * MM]);
        assert_eq!(machine.true_position_10nm(), [100 * MM, 50 * MM, 3 * MM]);
        assert_eq!(machine.pushed_10nm(), [[0, 4 * MM], [0, 0], [8 * MM, 0]]);
    }

    #[test]
    fn sensors_trigger_at_their_places() {
        let mut machine = machine([95 * MM, 50 * MM, 50 * MM]);
        assert_eq!(machine.seek(0, 200 * MM), (5 * MM + STALL_LAG_10NM, true));
        assert_eq!(machine.seek(1, -20 * MM), (-20 * MM, false));
        assert_eq!(machine.seek(1, -200 * MM), (-30 * MM, true));
        assert!(machine.is_triggered(1) && !machine.is_triggered(0));
        assert_eq!(machine.seek(2, -200 * MM), (-49 * MM, true));
        assert_eq!(machine.pushed_10nm()[2], [0, 0]);
    }

    #[test]
    fn a_probe_beside_the_sheet_sees_nothing() {
        // The probe is 10 mm to the left of the nozzle.
        for (x, sees) in [(9, false), (10, true), (100, true)] {
            let mut machine = machine([x * MM, 50 * MM, 5 * MM]);
            assert_eq!(machine.seek(2, -6 * MM).1, sees, "{x}");
        }
    }

    #[test]
    fn faults() {
        let at = |fault| {
            let mut machine = machine([50 * MM; 3]);
            machine.sensors[1].fault = fault;
            machine
        };
        assert_eq!(at(SensorFault::AlwaysOn).seek(1, -99 * MM), (0, true));
        assert_eq!(at(SensorFault::AlwaysOff).seek(1, -99 * MM), (-99 * MM, false));
        assert_eq!(at(SensorFault::WiredTo(2)).seek(1, -99 * MM), (-99 * MM, false));
        let mut bouncing = at(SensorFault::Bouncing);
        let (moved, triggered) = bouncing.seek(1, -99 * MM);
        assert!(triggered && (-50 * MM..-50 * MM + BOUNCE_10NM).contains(&moved), "{moved}");
        let mut spiking = at(SensorFault::Spiking);
        let ends: Vec<i64> = (0..20).map(|_| spiking.clone_and_step(1)).collect();
        assert!(ends.contains(&(-50 * MM)) && ends.iter().any(|&end| end > -50 * MM), "{ends:?}");
    }

    impl Mechanics {
        /// End of a seek that would begin here.
        fn clone_and_step(&mut self, axis: usize) -> i64 {
            self.chance(2);
            self.clone().seek(axis, -99 * MM).0
        }
    }
}
