//! Reports of G29, G30, M48 and M420, in Marlin's words.

use core::fmt::Write as _;

use ferrostep_gcode::{Real, Reply};
use ferrostep_planner::surface::Mesh;

use super::{Heights, MM};
use crate::motion::length::mm;
use crate::ports::{Motion, Ports, Replies, Text};
use crate::printer::Printer;

impl<P: Ports> Printer<'_, P> {
    /// Reports the mesh, row by row; no lines without one.
    #[inline(never)]
    pub(super) fn report_mesh(&mut self) {
        let replies = self.replies;
        self.motion.mesh(|mesh| write_mesh(replies, mesh));
    }

    /// Reports whether Z follows the mesh, and the height at which the mesh has faded out.
    #[inline(never)]
    pub(super) fn report_following(&self) {
        let follows = self.interpreter.modal.follows_bed;
        self.replies.say(format_args!("echo:Bed Leveling {}", if follows { "ON" } else { "OFF" }));
        let fade_10nm = self.interpreter.modal.mesh_fade_10nm;
        if fade_10nm == 0 {
            self.replies.send(Reply::Text("echo:Fade Height OFF"));
        } else {
            self.replies.say(format_args!("echo:Fade Height {}", mm(fade_10nm)));
        }
    }

    /// Reports G30, in the G-code's coordinates, and the position afterwards.
    #[inline(never)]
    pub(super) fn report_place(&self, place_10nm: [i64; 2], height_10nm: i64) {
        let [x_10nm, y_10nm] = place_10nm;
        let [x_10nm, y_10nm, _] = self.interpreter.skew.asked([x_10nm, y_10nm, 0]);
        let [of_x, of_y] = self.bed_offset_10nm();
        let [x, y] = [x_10nm + of_x, y_10nm + of_y].map(mm);
        let z = Real::fixed(height_10nm as f64 / MM, 4);
        self.replies.say(format_args!("Bed X: {x} Y: {y} Z: {z}"));
        self.replies.send(Reply::Position(self.position()));
    }

    /// Reports M48.
    #[inline(never)]
    pub(super) fn report_repeatability(&self, heights: &Heights) {
        let [mean, least, most] = [heights.mean_10nm(), heights.least_10nm, heights.most_10nm]
            .map(|height| Real::fixed(height as f64 / MM, 4));
        let range = Real::fixed((heights.most_10nm - heights.least_10nm) as f64 / MM, 4);
        self.replies.say(format_args!("Finished!\nMean: {mean} Min: {least} Max: {most} Range: {range}"));
        let deviation = Real::fixed(f64::from(heights.deviation_10nm()) / MM, 6);
        self.replies.say(format_args!("Standard Deviation: {deviation}"));
    }
}

/// The heights as Marlin prints them, mm.
fn write_mesh(replies: &(impl Replies + ?Sized), mesh: &Mesh) {
    let [columns, rows] = mesh.grid().points;
    if columns == 0 {
        return;
    }
    let mut text = Text::new();
    let _ = text.write_str("Bilinear Leveling Grid:\n ");
    for column in 0..columns {
        let _ = write!(text, "{column:7}");
    }
    replies.send(Reply::Text(&text));
    for row in 0..rows {
        text.clear();
        let _ = write!(text, "{row:2}");
        for column in 0..columns {
            match mesh.height_um([column, row]) {
                Some(height) => {
                    let sign = if height < 0 { '-' } else { '+' };
                    let _ = write!(text, " {sign}{}", Real::fixed(f64::from(height.unsigned_abs()) / 1000.0, 3));
                }
                None => {
                    let _ = text.write_str(" ======");
                }
            }
        }
        replies.send(Reply::Text(&text));
    }
}
