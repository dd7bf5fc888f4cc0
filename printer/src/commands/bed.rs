//! G29, G30, G34, G35, G80, M48, M420, M421 and M555: the bed is probed, and Z follows its surface.
//!
//! Heights are motor heights at which the probe triggers, minus the one at which it triggered while
//! Z was homed: the surface is at 0 where Z is homed, whatever the probe's offset (M851).

mod align;
mod area;
mod reports;
mod round;
mod screws;

use ferrostep_gcode::{BedCommand, Decimal, PinCommand};
use ferrostep_planner::surface::{MeshError, MeshGrid, MeshInterpolation};

use crate::error::CommandError;
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::homing::Homing;
use crate::motion::length::mm;
use crate::part::Part;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::within;
use crate::settings::profile::homing::MeshSettings;

/// Index of Z.
const Z: usize = 2;

/// Units of 10 nm in a millimetre.
const MM: f64 = 100_000.0;

/// Units of 10 nm in a micrometre.
const UM: i64 = 100;

/// Largest height of a point, either sign, units of 10 nm.
pub(crate) const MAX_HEIGHT_10NM: i64 = 1_000_000;

/// Number of M48's probings without P; the minimum is `MIN_SAMPLES`. Marlin's numbers.
const SAMPLES: u8 = 10;
const MIN_SAMPLES: u8 = 4;

impl<P: Ports> Printer<'_, P> {
    /// Returns true if the bed can be measured and followed.
    pub fn has_bed(&self) -> bool {
        P::Motion::HAS_BED && self.profile.mesh.is_some()
    }

    /// Executes a command for the bed.
    pub(crate) async fn bed(&mut self, command: &BedCommand) -> Result<(), CommandError> {
        let Some(settings) = self.profile.mesh else { return Ok(()) };
        if self.interpreter.modal.in_prepared_job && command.switches_on() {
            return Err(CommandError::MeshAndJob);
        }
        self.motion.finish().await?;
        let follows = self.interpreter.modal.follows_bed;
        match *command {
            BedCommand::Measure { unless_on: true, .. } if follows => {}
            BedCommand::Measure { area, .. } => {
                self.needs_home()?;
                let grid = self.grid(area, &settings)?;
                self.measure(&grid, &settings).await?;
            }
            BedCommand::Area(area) => {
                self.grid(Some(area), &settings)?;
                self.modes.bed_area = Some(area);
            }
            BedCommand::Probe { x, y } => {
                self.needs_home()?;
                let place_10nm = self.probed_place(x, y)?;
                let height = self.probe_apart(place_10nm, 1, &settings).await?;
                self.report_place(place_10nm, height.first_10nm);
            }
            BedCommand::Repeat { samples, x, y } => {
                self.needs_home()?;
                let place_10nm = self.probed_place(x, y)?;
                let samples = samples.unwrap_or(SAMPLES);
                if samples < MIN_SAMPLES {
                    let (minimum, maximum) = (MIN_SAMPLES.into(), u8::MAX.into());
                    return Err(CommandError::OutOfRange { word: 'P', value: samples.into(), minimum, maximum });
                }
                let heights = self.probe_apart(place_10nm, samples, &settings).await?;
                self.report_repeatability(&heights);
            }
            BedCommand::Screws => self.measure_screws(&settings).await?,
            BedCommand::Align { rounds, accuracy, amplification } => {
                if <P::Motion as Motion>::ZMotors::PRESENT {
                    let (printer, settings) = (&mut *self, &settings);
                    <P::Motion as Motion>::ZMotors::only(move || {
                        printer.align_z(rounds, accuracy, amplification, settings)
                    })
                    .await?;
                }
            }
            BedCommand::Follow { on, fade, reports } => self.follow(on, fade, reports)?,
            BedCommand::SetPoint { column, row, height, adds } => self.set_point([column, row], height, adds)?,
            BedCommand::Clear => self.forget_mesh(),
        }
        Ok(())
    }

    /// Makes Z follow the mesh, or stops it, at standstill: the motors do not move, and the
    /// position's Z becomes the one above the mesh or without it.
    #[inline(never)]
    pub(crate) fn switch_bed(&mut self, on: bool) -> Result<(), MeshError> {
        // Within 5 m.
        let fade_10nm = self.interpreter.modal.mesh_fade_10nm as i32;
        self.motion.mesh(|mesh| mesh.set_fade_10nm(fade_10nm));
        let outcome = self.motion.follow_bed(on);
        let follows = on && outcome.is_ok();
        let size_10nm = self.profile.size_10nm[Z];
        let rise_10nm = self.motion.mesh(|mesh| if mesh.fade_10nm() > 0 { 0 } else { mesh.highest_10nm() });
        let modal = &mut self.interpreter.modal;
        modal.follows_bed = follows;
        modal.mesh_rise_10nm = if follows { i64::from(rise_10nm.unwrap_or(0)).clamp(0, size_10nm) } else { 0 };
        self.interpreter.follow(self.motion.position_10nm());
        outcome
    }

    /// Executes M502 for the mesh: clears it and restores the profile's fade.
    pub(crate) fn reset_mesh(&mut self) {
        if let Some(settings) = self.profile.mesh.filter(|_| self.has_bed()) {
            self.forget_mesh();
            self.interpreter.modal.mesh_fade_10nm = settings.fade_10nm;
        }
    }

    /// Stops bed following, and empties the mesh.
    pub(crate) fn forget_mesh(&mut self) {
        // Only switching on can fail.
        let _off = self.switch_bed(false);
        self.motion.mesh(|mesh| mesh.begin(&MeshGrid::NONE, MeshInterpolation::Bilinear));
    }

    /// Executes M420 and G29 A. A missing mesh is only reported, as in Marlin: slicers write M420
    /// S1 for stored meshes.
    #[inline(never)]
    fn follow(&mut self, on: Option<bool>, fade: Option<Decimal>, reports: bool) -> Result<(), CommandError> {
        let follows = self.interpreter.modal.follows_bed;
        if on == Some(true) {
            self.needs_home()?;
        }
        if on.is_some() || fade.is_some() {
            let before_10nm = self.interpreter.modal.mesh_fade_10nm;
            let mut fade_10nm = before_10nm;
            if let Some(fade) = fade {
                let length_10nm = self.interpreter.modal.length_10nm(fade).ok_or(CommandError::TooFar)?;
                fade_10nm = within('Z', length_10nm, 0, self.profile.size_10nm[Z])?;
            }
            let _off = self.switch_bed(false);
            self.interpreter.modal.mesh_fade_10nm = fade_10nm;
            if on.unwrap_or(follows)
                && let Err(error) = self.switch_bed(true)
            {
                self.interpreter.modal.mesh_fade_10nm = before_10nm;
                if follows {
                    let _as_before = self.switch_bed(true);
                }
                if error != MeshError::Incomplete {
                    return Err(CommandError::Mesh(error));
                }
                let why = CommandError::Mesh(error);
                self.replies.say(format_args!("echo:Failed to enable Bed Leveling: {why}"));
            }
        }
        if reports {
            self.report_mesh();
        }
        self.report_following();
        Ok(())
    }

    /// Executes M421.
    #[inline(never)]
    fn set_point(&mut self, point: [u8; 2], height: Decimal, adds: bool) -> Result<(), CommandError> {
        let follows = self.interpreter.modal.follows_bed;
        let length_10nm = self.interpreter.modal.length_10nm(height).ok_or(CommandError::TooFar)?;
        let points = self.motion.mesh(|mesh| mesh.grid().points).unwrap_or_default();
        if points == [0; 2] {
            return Err(CommandError::Mesh(MeshError::Incomplete));
        }
        for ((word, index), points) in ['I', 'J'].into_iter().zip(point).zip(points) {
            if index >= points {
                let (value, maximum) = (index.into(), f64::from(points) - 1.0);
                return Err(CommandError::OutOfRange { word, value, minimum: 0.0, maximum });
            }
        }
        let before_um = self.motion.mesh(|mesh| mesh.height_um(point)).flatten().unwrap_or(0);
        let base_10nm = if adds { i64::from(before_um) * UM } else { 0 };
        let (least, most) = (-MAX_HEIGHT_10NM - base_10nm, MAX_HEIGHT_10NM - base_10nm);
        let height_10nm = base_10nm + within(if adds { 'Q' } else { 'Z' }, length_10nm, least, most)?;
        let _off = self.switch_bed(false);
        self.motion.mesh(|mesh| mesh.set_height_um(point, height_um(height_10nm)));
        if follows && let Err(error) = self.switch_bed(true) {
            self.motion.mesh(|mesh| mesh.set_height_um(point, before_um));
            let _as_before = self.switch_bed(true);
            return Err(CommandError::Mesh(error));
        }
        Ok(())
    }

    /// Executes G29: measures the points of a grid, row by row there and back. One missing point
    /// discards the mesh.
    async fn measure(&mut self, grid: &MeshGrid, settings: &MeshSettings) -> Result<(), CommandError> {
        self.forget_mesh();
        self.motion.mesh(|mesh| mesh.begin(grid, settings.interpolation));
        let outcome = self.measure_all(grid, settings).await;
        self.follow_probing();
        self.modes.bed_area = None;
        if outcome.is_err() {
            self.forget_mesh();
            return outcome;
        }
        // Heights and limits of the mesh are known only now.
        if let Err(error) = self.switch_bed(true) {
            self.report_mesh();
            return Err(CommandError::Mesh(error));
        }
        self.report_mesh();
        self.report_following();
        Ok(())
    }

    async fn measure_all(&mut self, grid: &MeshGrid, settings: &MeshSettings) -> Result<(), CommandError> {
        let [columns, rows] = grid.points;
        for index in 0..u16::from(columns) * u16::from(rows) {
            let (row, along) = ((index / u16::from(columns)) as u8, (index % u16::from(columns)) as u8);
            let column = if row % 2 == 0 { along } else { columns - 1 - along };
            let place_10nm = grid.place_10nm([column, row]).map(i64::from);
            if self.is_above_bed(place_10nm).is_err() {
                continue;
            }
            let mut heights = Heights::NONE;
            self.probe(place_10nm, settings.samples, settings, &mut heights).await?;
            let height_um = height_um(heights.mean_10nm());
            self.motion.mesh(|mesh| mesh.set_height_um([column, row], height_um));
        }
        if self.profile.safe_homing.is_round {
            self.motion.mesh(round::continue_surface);
        }
        Ok(())
    }

    /// Probes a place of the bed without the mesh; if Z follows the mesh, it does so again
    /// afterwards.
    async fn probe_apart(
        &mut self,
        place_10nm: [i64; 2],
        samples: u8,
        settings: &MeshSettings,
    ) -> Result<Heights, CommandError> {
        let follows = self.interpreter.modal.follows_bed;
        let _off = self.switch_bed(false);
        let mut heights = Heights::NONE;
        let outcome = self.probe(place_10nm, samples, settings, &mut heights).await;
        self.follow_probing();
        if follows {
            let _as_before = self.switch_bed(true);
        }
        outcome.map(|()| heights)
    }

    /// Height of the motors at which the probe triggered while Z was homed.
    fn home_height_10nm(&self) -> i64 {
        self.interpreter.modal.z.trigger_10nm.unwrap_or_else(|| self.interpreter.trigger_10nm(Z))
    }

    /// Probes a place of the bed `samples` times; the nozzle stays above the bed on the way there
    /// and afterwards.
    async fn probe(
        &mut self,
        place_10nm: [i64; 2],
        samples: u8,
        settings: &MeshSettings,
        heights: &mut Heights,
    ) -> Result<(), CommandError> {
        let nozzle_10nm = self.nozzle_at(place_10nm)?;
        let home_10nm = self.home_height_10nm();
        let mut lift_10nm = home_10nm.max(0) + settings.lift_10nm;
        let (motion, interpreter) = (&mut self.motion, &mut self.interpreter);
        let mut homing = Homing { motion, interpreter, drivers: self.fitted.drivers, line: self.lines.number };
        if let Some(pin) = homing.pin_out() {
            let homing = &mut homing;
            <P::Motion as Motion>::Servo::only(move || homing.tell_pin(pin, PinCommand::In)).await?;
        }
        homing.go_over_bed(nozzle_10nm, lift_10nm).await?;
        let mut outcome = Ok(());
        for _ in 0..samples {
            match homing.probe_bed(settings.depth_10nm).await {
                Ok(found_10nm) => {
                    heights.add(found_10nm - home_10nm);
                    // Where the bed is higher than at home, the nozzle keeps the same distance
                    // above it.
                    lift_10nm = lift_10nm.max(found_10nm + settings.lift_10nm);
                }
                Err(error) => {
                    outcome = Err(error);
                    break;
                }
            }
            homing.rise_over_bed(lift_10nm).await?;
        }
        if let Err(error) = outcome {
            if !error.stops() {
                homing.rise_over_bed(lift_10nm).await?;
            }
            let [x, y] = place_10nm.map(mm);
            self.replies.say(format_args!("echo:line {}: the probe failed at X{x} Y{y} of the bed", self.lines.number));
        }
        outcome
    }

    /// Makes the G-code's position that of the motors after probing; the homing time limit has
    /// ended.
    fn follow_probing(&mut self) {
        let position_10nm = self.motion.position_10nm();
        self.motion.set_position(position_10nm);
        self.follow_the_motors();
    }

    /// Refuses a machine that does not know its position.
    fn needs_home(&self) -> Result<(), CommandError> {
        let modal = &self.interpreter.modal;
        match (0..3).find(|&axis| !modal.homed[axis]) {
            Some(axis) => Err(CommandError::BedUnhomed { axis }),
            None => Ok(()),
        }
    }

    /// Position of the nozzle when the probe is at a place.
    fn nozzle_at(&self, place_10nm: [i64; 2]) -> Result<[i64; 2], CommandError> {
        let mut nozzle_10nm = place_10nm;
        for (axis, nozzle) in nozzle_10nm.iter_mut().enumerate() {
            let [least, most] = self.reach_10nm(axis);
            let word = AXIS_NAMES.get(axis).copied().unwrap_or('?');
            let offset_10nm = self.interpreter.modal.probe_offset_10nm.get(axis).copied().unwrap_or(0);
            *nozzle = within(word, *nozzle, least, most)? - offset_10nm;
        }
        self.is_above_bed(place_10nm)?;
        Ok(nozzle_10nm)
    }

    /// Refuses a place of the probe that is beside a round bed.
    pub(crate) fn is_above_bed(&self, place_10nm: [i64; 2]) -> Result<(), CommandError> {
        if self.profile.safe_homing.is_above_bed(place_10nm) { Ok(()) } else { Err(CommandError::BesideBed) }
    }

    /// Axis position of the probe for G30 and M48.
    fn probed_place(&self, x: Option<Decimal>, y: Option<Decimal>) -> Result<[i64; 2], CommandError> {
        let modal = &self.interpreter.modal;
        let [x_10nm, y_10nm, _] = modal.machine_10nm;
        // A point on the bed, straight below the probe.
        let mut asked_10nm = [x_10nm, y_10nm, 0];
        for ((axis, place), word) in asked_10nm.iter_mut().enumerate().zip([x, y]) {
            *place = match word {
                // The bed's coordinates are those of T0.
                Some(word) => {
                    let length_10nm = modal.length_10nm(word).ok_or(CommandError::TooFar)?;
                    length_10nm - self.bed_offset_10nm()[axis]
                }
                None => *place + modal.probe_offset_10nm[axis],
            };
        }
        let [x_10nm, y_10nm, _] = self.interpreter.skew.axes(asked_10nm);
        let place_10nm = [x_10nm, y_10nm];
        self.nozzle_at(place_10nm)?;
        Ok(place_10nm)
    }
}

/// Heights found at one place.
#[derive(Clone, Copy, Debug)]
struct Heights {
    count: u16,
    first_10nm: i64,
    sum_10nm: i64,
    /// Sum of the squared differences from the first height, units of 10 nm.
    squares: i64,
    least_10nm: i64,
    most_10nm: i64,
}

impl Heights {
    const NONE: Self =
        Self { count: 0, first_10nm: 0, sum_10nm: 0, squares: 0, least_10nm: i64::MAX, most_10nm: i64::MIN };

    fn add(&mut self, height_10nm: i64) {
        if self.count == 0 {
            self.first_10nm = height_10nm;
        }
        let away_10nm = height_10nm - self.first_10nm;
        self.count += 1;
        self.sum_10nm += away_10nm;
        self.squares += away_10nm * away_10nm;
        self.least_10nm = self.least_10nm.min(height_10nm);
        self.most_10nm = self.most_10nm.max(height_10nm);
    }

    fn mean_10nm(&self) -> i64 {
        let count = i64::from(self.count.max(1));
        self.first_10nm + (2 * self.sum_10nm + count * self.sum_10nm.signum()) / (2 * count)
    }

    /// Standard deviation of these heights, units of 10 nm, as Marlin computes it.
    fn deviation_10nm(&self) -> f32 {
        let count = f64::from(self.count.max(1));
        let mean = self.sum_10nm as f64 / count;
        ferrostep_planner::square_root::square_root_f32((self.squares as f64 / count - mean * mean) as f32)
    }
}

/// Height in the mesh's unit, um, rounded.
fn height_um(height_10nm: i64) -> i16 {
    let rounded = (height_10nm + height_10nm.signum() * (UM / 2)) / UM;
    rounded.clamp((i16::MIN + 1).into(), i16::MAX.into()) as i16
}
