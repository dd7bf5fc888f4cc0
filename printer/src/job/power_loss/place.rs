//! The place of a print as bytes.

use ferrostep_card::Kept;
use ferrostep_gcode::Units;
use ferrostep_hal_shim::FanOutput;
use ferrostep_planner::{Limits, PressureAdvance, SecondSlope, StepsPerMm};

use crate::job::paused::Paused;
use crate::job::tool_box::ToolBox;
use crate::motion::modal::Modal;
use crate::motion::skew::Skew;
use crate::part::Part;
use crate::settings::profile::filament::FirmwareRetraction;
use crate::settings::profile::tools::MAX_TOOLS;

/// Version of the order of the fields below: firmware with another one does not read them.
const VERSION: u8 = 4;

/// Place of the motors' height in the bytes.
const STANDS_AT: usize = 1;

/// State that a print needs to be resumed. `T`: whether there may be several tools.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place<T: Part> {
    /// Minimum height of the motors of Z while the place is kept, units of 10 nm.
    pub stands_10nm: i64,
    /// Byte of the file at which the next line begins.
    pub offset: u32,
    /// Lines before it.
    pub lines: u32,
    /// The machine: [`ferrostep_settings::hash_of`] its profile's name.
    pub profile: u32,
    /// The state between its lines.
    pub paused: Paused,
    /// The powers of the fans.
    pub fans: [u8; FanOutput::COUNT],
    /// Limits of its moves.
    pub limits: Limits,
    /// Pressure advance of its extruder.
    pub advance: PressureAdvance,
    /// Steps of the extruder in a millimetre of filament, in units of 1e-5.
    pub extruder_steps: i64,
    /// Skew of its axes.
    pub skew: Skew,
    /// The tools, of several.
    pub tools: T::Of<ToolBox>,
}

/// The height of the motors in a place's bytes becomes another.
pub(crate) fn set_stands(bytes: &mut [u8], stands_10nm: i64) {
    let height = stands_10nm as i32;
    let field = bytes.iter_mut().skip(STANDS_AT);
    field.zip(height.to_le_bytes()).for_each(|(out, byte)| *out = byte);
}

impl<T: Part> Place<T> {
    /// Writes the place.
    pub fn write(&mut self, out: &mut Kept) {
        out.clear();
        self.pass(&mut Codec { out: Some(out), bytes: &[], is_short: false });
    }

    /// Reads a place over this one; `false` if these bytes are of another version or length.
    #[must_use]
    pub fn read(&mut self, bytes: &[u8]) -> bool {
        let Some((&VERSION, bytes)) = bytes.split_first() else { return false };
        let mut codec = Codec { out: None, bytes, is_short: false };
        self.pass(&mut codec);
        !codec.is_short && codec.bytes.is_empty()
    }

    /// The fields, one after the other, to the bytes or from them.
    fn pass(&mut self, codec: &mut Codec<'_, '_>) {
        if let Some(out) = &mut codec.out {
            // A constant number of bytes follows, which fits (test).
            let _ = out.push(VERSION);
        }
        let Self { stands_10nm, offset, lines, profile, paused, fans, limits, advance, extruder_steps, skew, tools } =
            self;
        let Paused { modal, place_10nm, targets_celsius, drawn_100pm, load_100pm, pushes_more: _, until_ms: _ } =
            paused;
        codec.int(stands_10nm);
        codec.int(extruder_steps);
        skew.factors.iter_mut().for_each(|factor| *factor = codec.word(factor.cast_unsigned()).cast_signed());
        [offset, lines, profile].into_iter().for_each(|number| *number = codec.word(*number));
        let [a, b, c, d, e, f] = *fans;
        let (first, rest) =
            (codec.word(u32::from_le_bytes([a, b, c, d])), codec.word(u32::from_le_bytes([e, f, 0, 0])));
        let ([a, b, c, d], [e, f, ..]) = (first.to_le_bytes(), rest.to_le_bytes());
        *fans = [a, b, c, d, e, f];
        for celsius in targets_celsius.iter_mut().chain([&mut modal.min_extrusion_celsius]) {
            *celsius = f32::from_bits(codec.word(celsius.to_bits()));
        }
        for filament in [drawn_100pm, load_100pm] {
            *filament = codec.long(*filament as u64) as i64;
        }
        pass_modal(modal, place_10nm, codec);
        let Limits {
            max_feed_mm_per_s,
            max_acceleration_mm_per_s2,
            print_acceleration_mm_per_s2,
            travel_acceleration_mm_per_s2,
            retract_acceleration_mm_per_s2,
            junction_deviation_mm,
            instantaneous_corner_velocity_mm_per_s,
        } = limits;
        let alone = [
            print_acceleration_mm_per_s2,
            travel_acceleration_mm_per_s2,
            retract_acceleration_mm_per_s2,
            junction_deviation_mm,
        ];
        for of_axes in [max_feed_mm_per_s, max_acceleration_mm_per_s2, instantaneous_corner_velocity_mm_per_s] {
            of_axes.iter_mut().for_each(|value| codec.double(value));
        }
        alone.into_iter().for_each(|value| codec.double(value));
        pass_advance(advance, codec);
        if let Some(tools) = T::get_mut(tools) {
            pass_tools(tools, codec);
        }
    }
}

fn pass_advance(advance: &mut PressureAdvance, codec: &mut Codec<'_, '_>) {
    // No second slope is one of speed 0, and no time to average over is 0: neither is allowed.
    let mut above = advance.above.unwrap_or(SecondSlope { filament_mm_per_s: 0.0, seconds: 0.0 });
    let mut smooth_time_s = advance.smooth_time_s.unwrap_or(0.0);
    codec.double(&mut above.filament_mm_per_s);
    for seconds in [&mut advance.seconds, &mut above.seconds, &mut smooth_time_s] {
        codec.seconds(seconds);
    }
    advance.above = (above.filament_mm_per_s > 0.0).then_some(above);
    advance.smooth_time_s = (smooth_time_s > 0.0).then_some(smooth_time_s);
}

/// Passes the selected tool, the offset of the further one, and the values of the one that rests.
fn pass_tools(tools: &mut ToolBox, codec: &mut Codec<'_, '_>) {
    let flags = tools
        .tools
        .iter()
        .rev()
        .fold(0, |flags, tool| flags << 2 | u32::from(tool.retracted) << 1 | u32::from(tool.drawn_back));
    let resting_flow = tools.tools.iter().enumerate().find(|(tool, _)| *tool != usize::from(tools.selected));
    let resting_flow = resting_flow.map_or(100, |(_, tool)| tool.flow_percent);
    let kept = codec.word(u32::from(tools.selected) | (flags & 0xff) << 8 | u32::from(resting_flow) << 16);
    tools.selected = if kept & 0xff < MAX_TOOLS as u32 { kept as u8 } else { 0 };
    let (mut flags, resting_flow) = (kept >> 8, (kept >> 16) as u16);
    for (number, tool) in tools.tools.iter_mut().enumerate() {
        (tool.drawn_back, tool.retracted, flags) = (flags & 1 == 1, flags & 2 == 2, flags >> 2);
        if number > 0 {
            tool.offset_10nm.iter_mut().for_each(|length| codec.int(length));
        }
        if number != usize::from(tools.selected) {
            let mut steps = tool.steps_per_mm.hundred_thousandths();
            codec.int(&mut steps);
            tool.steps_per_mm = StepsPerMm::clamped(steps);
            tool.flow_percent = resting_flow;
            pass_advance(&mut tool.advance, codec);
        }
    }
}

fn pass_modal(modal: &mut Modal, place_10nm: &mut [i64; 3], codec: &mut Codec<'_, '_>) {
    let mut inches = modal.units == Units::Inches;
    let flags = [
        &mut inches,
        &mut modal.relative,
        &mut modal.relative_extruder,
        &mut modal.retracted,
        &mut modal.soft_limits,
        &mut modal.cold_extrusion_allowed,
        &mut modal.follows_bed,
    ];
    let mut bits = codec.word(flags.iter().rev().fold(0, |bits, flag| bits << 1 | u32::from(**flag)));
    for flag in flags {
        (*flag, bits) = (bits & 1 == 1, bits >> 1);
    }
    modal.units = if inches { Units::Inches } else { Units::Millimetres };
    let two = codec.word(u32::from(modal.feed_percent) | u32::from(modal.flow_percent) << 16);
    (modal.feed_percent, modal.flow_percent) = (two as u16, (two >> 16) as u16);
    modal.kept_feed_percent = codec.word(u32::from(modal.kept_feed_percent)) as u16;
    for value in [&mut modal.feed_10nm_per_min, &mut modal.extruder_10nm] {
        *value = codec.long(*value as u64) as i64;
    }
    for of_axes in [place_10nm, &mut modal.machine_10nm, &mut modal.offset_10nm, &mut modal.home_offset_10nm] {
        of_axes.iter_mut().for_each(|length| codec.int(length));
    }
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
        codec.int(value);
    }
}

/// Writes fields, or reads them: one order for both.
struct Codec<'a, 'b> {
    /// Output when writing.
    out: Option<&'a mut Kept>,
    /// Bytes still to be read.
    bytes: &'b [u8],
    /// True if the bytes have ended too early.
    is_short: bool,
}

impl Codec<'_, '_> {
    /// Writes a value and returns it, or returns the one that is read.
    #[inline(never)]
    fn word(&mut self, value: u32) -> u32 {
        if let Some(out) = &mut self.out {
            self.is_short |= out.extend_from_slice(&value.to_le_bytes()).is_err();
            return value;
        }
        match self.bytes.split_first_chunk() {
            Some((first, rest)) => {
                self.bytes = rest;
                u32::from_le_bytes(*first)
            }
            None => {
                self.is_short = true;
                value
            }
        }
    }

    /// A length or speed of a machine, which has 32 bits: up to 21 m.
    fn int(&mut self, value: &mut i64) {
        *value = i64::from(self.word(*value as u32) as i32);
    }

    #[inline(never)]
    fn long(&mut self, value: u64) -> u64 {
        u64::from(self.word(value as u32)) | u64::from(self.word((value >> 32) as u32)) << 32
    }

    /// Up to two seconds, to a nanosecond: no command has more decimals.
    fn seconds(&mut self, value: &mut f64) {
        *value = f64::from(self.word(libm::round(*value * 1e9) as u32)) / 1e9;
    }

    fn double(&mut self, value: &mut f64) {
        *value = f64::from_bits(self.long(value.to_bits()));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
