//! Hand-made prepared jobs that `preprocess` would never write.

use ferrostep_gpre::compact::FrameWriter;
use ferrostep_gpre::{Coordinate, Encoding, EntrySpeed, Header, Item, ModalState, PreparedMove, SquaredSpeed};
use ferrostep_planner::PLANNER_VERSION;

/// A job of moves along X, with these lengths in mm and planned speeds, on a machine that is homed
/// first. Each is a frame.
pub fn job(profile_hash: u64, moves: &[(i64, EntrySpeed)]) -> Vec<u8> {
    let mut frames = Vec::new();
    let mut writer = FrameWriter::new([0; 3], ModalState::START);
    writer.add(&Item::Command { line: 1, text: "G28" }, &mut frames);
    writer.close(&mut frames);
    let mut target = [Coordinate::default(); 3];
    for (line, &(length_mm, entry)) in (2..).zip(moves) {
        let Some(x) = target[0].advanced((length_mm * 100_000) as i32) else { panic!("{length_mm} mm leave the 5 m") };
        target[0] = x;
        let (filament_100pm, feed_mm_per_s) = (0, 100.0);
        let item = PreparedMove { target, filament_100pm, feed_mm_per_s, line, ends_move: true, counts: true, entry };
        writer.add(&Item::Move(&item), &mut frames);
        writer.close(&mut frames);
    }
    let header = Header {
        encoding: Encoding::Compact,
        profile_hash,
        planner_version: PLANNER_VERSION,
        frames: writer.frames(),
        moves: moves.len() as u64,
        motion_ms: 0,
        filament_100pm: 0,
        layers: 0,
        thumbnail: None,
    };
    [header.to_bytes(&[]), frames].concat()
}

/// A speed in mm/s as a file has it.
pub fn given(mm_per_s: f64) -> EntrySpeed {
    EntrySpeed::Given(SquaredSpeed::from_units((mm_per_s * mm_per_s * 12_800_000.0) as u64))
}
