//! The motors that lift the desk's Z, each by itself while they are aligned, and the sheet as the
//! probe sees it then.

use ferrostep_printer::{Profile, ZAlignment};
use ferrostep_profiles::heights_by_motors;
use ferrostep_virtual_board::{SheetShape, VirtualMotors, VirtualProbe};

/// The motors of a machine that aligns them.
#[derive(Debug)]
pub(super) struct DeskZMotors {
    alignment: ZAlignment,
    count: usize,
    steps_per_mm: f64,
    /// The probe over the profile's sheet, with the motors' positions at power-on.
    probe: VirtualProbe,
    /// Mask of the motors that make Z's steps.
    stepping: u8,
    /// Z's steps when that was chosen.
    counted: i64,
    /// Steps that each motor has made more than the axis.
    more: [i64; 4],
}

impl DeskZMotors {
    /// All motors step; `None` for a machine that aligns none.
    pub fn new(profile: &Profile) -> Option<Self> {
        let mesh = profile.mesh?;
        let [x, y, _] = profile.safe_homing.probe_offset_10nm;
        let [.., z, _] = profile.steps_per_mm;
        Some(Self {
            alignment: *profile.z_alignment()?,
            count: profile.z_motors?.0.count(),
            steps_per_mm: z.to_f64(),
            probe: VirtualProbe { offset_10nm: [x, y], sheet_10nm: profile.safe_homing.bed_10nm, shape: mesh.sheet },
            stepping: u8::MAX,
            counted: 0,
            more: [0; 4],
        })
    }

    /// Makes the motors in the mask take the steps to come.
    pub fn step(&mut self, stepping: u8, motors: &mut VirtualMotors) {
        let [.., z, _] = motors.ledger.motor_steps();
        for (motor, more) in self.more.iter_mut().enumerate() {
            if self.stepping >> motor & 1 == 0 {
                *more -= z - self.counted;
            }
        }
        (self.stepping, self.counted) = (stepping, z);
        motors.set_probe(VirtualProbe { shape: self.sheet(), ..self.probe });
    }

    /// The sheet as it lies below an axis whose motors have moved so: lower where they have
    /// gone away from it.
    fn sheet(&self) -> SheetShape {
        let more_10nm = self.more.map(|steps| steps as f64 / self.steps_per_mm * 1e5);
        let (places, _) = self.alignment.places_10nm.split_at(self.count);
        let [[left, right], [front, back]] = self.probe.sheet_10nm;
        let away = |corner: [i64; 2]| {
            let weights = heights_by_motors(places, corner).unwrap_or_default();
            weights.iter().zip(more_10nm).map(|(weight, more)| weight * more).sum::<f64>()
        };
        let [a, b, c, d] = [[left, front], [right, front], [left, back], [right, back]].map(away);
        let of_profile = self.probe.shape;
        let lowered = |value: i64, by: f64| value - by.round() as i64;
        let [along_x, along_y] = of_profile.tilt_10nm;
        SheetShape {
            height_10nm: lowered(of_profile.height_10nm, (a + b + c + d) / 4.0),
            tilt_10nm: [lowered(along_x, (b + d - a - c) / 2.0), lowered(along_y, (c + d - a - b) / 2.0)],
            twist_10nm: lowered(of_profile.twist_10nm, (a + d - b - c) / 4.0),
            ..of_profile
        }
    }
}
