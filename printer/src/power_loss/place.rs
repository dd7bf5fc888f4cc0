//! The place of a print as bytes.

use ferrostep_card::Kept;
use ferrostep_gcode::Units;
use ferrostep_hal_shim::FanOutput;
use ferrostep_planner::{Limits, PressureAdvance, SecondSlope};

use crate::modal::Modal;
use crate::paused::Paused;
use crate::profile::FirmwareRetraction;

/// Of the order of the fields below: another one does not read them.
const VERSION: u8 = 1;

/// Where the height of the motors is in the bytes.
const STANDS_AT: usize = 1;

/// What a print needs to go on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Where the motors of Z stand while the place is kept, at least, units of 10 nm.
    pub stands_10nm: i64,
    /// Byte of the file at which the next line begins.
    pub offset: u32,
    /// Lines before it.
    pub lines: u32,
    /// Which machine it is.
    pub profile: u32,
    /// The state between its lines.
    pub paused: Paused,
    /// The powers of the fans.
    pub fans: [u8; FanOutput::COUNT],
    /// Limits of its moves.
    pub limits: Limits,
    /// How far its extruder runs ahead.
    pub advance: PressureAdvance,
}

/// FNV-1a of a profile's name.
pub(super) fn profile_number(name: &str) -> u32 {
    name.bytes().fold(0x811C_9DC5, |number, byte| (number ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}

/// The height of the motors in a place's bytes becomes another.
pub(super) fn set_stands(bytes: &mut [u8], stands_10nm: i64) {
    let height = stands_10nm as i32;
    let field = bytes.iter_mut().skip(STANDS_AT);
    field.zip(height.to_le_bytes()).for_each(|(out, byte)| *out = byte);
}

impl Place {
    /// Writes the place.
    pub fn write(&mut self, out: &mut Kept) {
        out.clear();
        // A constant number of bytes, which fits (test).
        let _ = self.pass(&mut Codec::Write(out));
    }

    /// Reads a place over this one; `false` if it is no such place.
    #[must_use]
    pub fn read(&mut self, bytes: &[u8]) -> bool {
        let mut codec = Codec::Read(bytes);
        self.pass(&mut codec).is_some() && matches!(codec, Codec::Read([]))
    }

    /// The fields, one after the other, to the bytes or from them.
    fn pass(&mut self, codec: &mut Codec<'_, '_>) -> Option<()> {
        let mut version = [VERSION];
        codec.bytes(&mut version)?;
        if version != [VERSION] {
            return None;
        }
        codec.int(&mut self.stands_10nm)?;
        for number in [&mut self.offset, &mut self.lines, &mut self.profile] {
            let mut bytes = number.to_le_bytes();
            codec.bytes(&mut bytes)?;
            *number = u32::from_le_bytes(bytes);
        }
        codec.bytes(&mut self.fans)?;
        let Paused { modal, place_10nm, targets_celsius, drawn_100pm: _, load_100pm: _, until_ms: _ } =
            &mut self.paused;
        for celsius in targets_celsius {
            codec.float(celsius)?;
        }
        place_10nm.iter_mut().try_for_each(|coordinate| codec.int(coordinate))?;
        pass_modal(modal, codec)?;
        let Limits {
            max_feed_mm_per_s,
            max_acceleration_mm_per_s2,
            print_acceleration_mm_per_s2,
            travel_acceleration_mm_per_s2,
            retract_acceleration_mm_per_s2,
            junction_deviation_mm,
            instantaneous_corner_velocity_mm_per_s,
        } = &mut self.limits;
        let of_axes =
            [max_feed_mm_per_s, max_acceleration_mm_per_s2, instantaneous_corner_velocity_mm_per_s].into_iter();
        of_axes.flatten().try_for_each(|value| codec.double(value))?;
        for value in [
            print_acceleration_mm_per_s2,
            travel_acceleration_mm_per_s2,
            retract_acceleration_mm_per_s2,
            junction_deviation_mm,
        ] {
            codec.double(value)?;
        }
        pass_advance(&mut self.advance, codec)
    }
}

fn pass_modal(modal: &mut Modal, codec: &mut Codec<'_, '_>) -> Option<()> {
    let mut inches = modal.units == Units::Inches;
    for flag in [
        &mut inches,
        &mut modal.relative,
        &mut modal.relative_extruder,
        &mut modal.retracted,
        &mut modal.soft_limits,
        &mut modal.cold_extrusion_allowed,
        &mut modal.follows_bed,
    ] {
        codec.flag(flag)?;
    }
    modal.units = if inches { Units::Inches } else { Units::Millimetres };
    for percent in [&mut modal.feed_percent, &mut modal.flow_percent, &mut modal.kept_feed_percent] {
        let mut bytes = percent.to_le_bytes();
        codec.bytes(&mut bytes)?;
        *percent = u16::from_le_bytes(bytes);
    }
    codec.long(&mut modal.feed_10nm_per_min)?;
    codec.long(&mut modal.extruder_10nm)?;
    codec.float(&mut modal.min_extrusion_celsius)?;
    let of_axes = [&mut modal.machine_10nm, &mut modal.offset_10nm, &mut modal.home_offset_10nm];
    of_axes.into_iter().flatten().try_for_each(|length| codec.int(length))?;
    let FirmwareRetraction { length_10nm, retract_10nm_per_s, extra_recover_10nm, recover_10nm_per_s, lift_10nm } =
        &mut modal.retraction;
    for value in [
        length_10nm,
        retract_10nm_per_s,
        extra_recover_10nm,
        recover_10nm_per_s,
        lift_10nm,
        &mut modal.lift_10nm,
        &mut modal.z.shift_10nm,
    ] {
        codec.int(value)?;
    }
    Some(())
}

fn pass_advance(advance: &mut PressureAdvance, codec: &mut Codec<'_, '_>) -> Option<()> {
    // No second slope is one of speed 0, and no time to average over is 0: neither is allowed.
    let mut above = advance.above.unwrap_or(SecondSlope { filament_mm_per_s: 0.0, seconds: 0.0 });
    let mut smooth_time_s = advance.smooth_time_s.unwrap_or(0.0);
    for value in [&mut advance.seconds, &mut above.filament_mm_per_s, &mut above.seconds, &mut smooth_time_s] {
        codec.double(value)?;
    }
    advance.above = (above.filament_mm_per_s > 0.0).then_some(above);
    advance.smooth_time_s = (smooth_time_s > 0.0).then_some(smooth_time_s);
    Some(())
}

/// Writes fields, or reads them: one order for both.
enum Codec<'a, 'b> {
    Write(&'a mut Kept),
    Read(&'b [u8]),
}

impl Codec<'_, '_> {
    fn bytes<const N: usize>(&mut self, value: &mut [u8; N]) -> Option<()> {
        match self {
            Self::Write(out) => out.extend_from_slice(value).ok(),
            Self::Read(rest) => {
                let (first, after) = rest.split_first_chunk()?;
                (*value, *rest) = (*first, after);
                Some(())
            }
        }
    }

    fn flag(&mut self, value: &mut bool) -> Option<()> {
        let mut byte = [u8::from(*value)];
        self.bytes(&mut byte)?;
        *value = byte != [0];
        Some(())
    }

    /// A length or speed of a machine, which has 32 bits: up to 21 m.
    fn int(&mut self, value: &mut i64) -> Option<()> {
        let mut bytes = (*value as i32).to_le_bytes();
        self.bytes(&mut bytes)?;
        *value = i64::from(i32::from_le_bytes(bytes));
        Some(())
    }

    fn long(&mut self, value: &mut i64) -> Option<()> {
        let mut bytes = value.to_le_bytes();
        self.bytes(&mut bytes)?;
        *value = i64::from_le_bytes(bytes);
        Some(())
    }

    fn float(&mut self, value: &mut f32) -> Option<()> {
        let mut bytes = value.to_le_bytes();
        self.bytes(&mut bytes)?;
        *value = f32::from_le_bytes(bytes);
        Some(())
    }

    fn double(&mut self, value: &mut f64) -> Option<()> {
        let mut bytes = value.to_le_bytes();
        self.bytes(&mut bytes)?;
        *value = f64::from_le_bytes(bytes);
        Some(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
