//! Prepared jobs made by hand: what `preprocess` would never write.

use ferrostep_gpre::compact::FrameWriter;
use ferrostep_gpre::{Encoding, Header, Item, ModalState, MoveItem, Speed};
use ferrostep_planner::PLANNER_VERSION;

/// A job of moves along X, with these lengths in mm and planned speeds, on a machine that is homed first. Each is a frame.
pub fn job(profile_hash: u64, moves: &[(i64, Speed)]) -> Vec<u8> {
    let mut frames = Vec::new();
    let mut writer = FrameWriter::new([0; 3], ModalState::START);
    writer.add(&Item::Command { line: 1, text: "G28" }, &mut frames);
    writer.close(&mut frames);
    let mut target_10nm = [0; 3];
    for (line, &(length_mm, speed)) in (2..).zip(moves) {
        target_10nm[0] += length_mm * 100_000;
        let (filament_100pm, feed_mm_per_s) = (0, 100.0);
        let item = MoveItem { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move: true, counts: true, speed };
        writer.add(&Item::Move(item), &mut frames);
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
pub fn given(mm_per_s: f64) -> Speed {
    Speed::Given((mm_per_s * mm_per_s * 12_800_000.0) as u64)
}
