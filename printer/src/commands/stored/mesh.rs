//! The measured bed in a memory: entries of eight bytes each, beside those of the settings.
//!
//! | index | bytes |
//! |---|---|
//! | 0 | X and Y of the first point, units of 10 nm: two i32 |
//! | 1 | spacing along X and along Y, units of 10 nm: two i32 |
//! | 2 | points along X and along Y, one byte each; two of 0; the height up to which Z follows, units of 10 nm: i32 |
//! | 3 to 59 | heights, row by row, um: four i16 each |

use ferrostep_planner::surface::{MAX_MESH_POINTS, Mesh, MeshGrid, MeshInterpolation};
use ferrostep_settings::{Entry, Record, RecordWriter, SLOT_BYTES, id_of};

use super::{PartsOf, Stored};
use crate::commands::bed::MAX_HEIGHT_10NM;
use crate::ports::{Motion, Ports, Replies, SettingsMemory};
use crate::printer::Printer;

/// Name of a mesh in a memory.
pub(super) const MESH: u16 = id_of("bed_mesh");

/// Number of entries before the heights.
const HEAD: u8 = 3;

/// Largest height of a point, um.
const MAX_HEIGHT_UM: i16 = (MAX_HEIGHT_10NM / 100) as i16;

/// The height entries of a grid: each entry's index and its four points; the last points may be
/// beyond the grid.
fn entries_of([columns, rows]: [u8; 2]) -> impl Iterator<Item = (u8, [[u8; 2]; 4])> {
    let (columns, rows) = (u16::from(columns).max(1), u16::from(rows));
    let place = move |number: u16| [(number % columns) as u8, (number / columns) as u8];
    (HEAD..)
        .zip((0..columns * rows).step_by(4))
        .map(move |(index, first)| (index, [0, 1, 2, 3].map(|at| place(first + at))))
}

fn two([low, high]: [i32; 2]) -> [u8; 8] {
    (u64::from(high as u32) << 32 | u64::from(low as u32)).to_le_bytes()
}

fn of_two(bytes: [u8; 8]) -> [i32; 2] {
    let both = u64::from_le_bytes(bytes);
    [both as i32, (both >> 32) as i32]
}

/// Adds a mesh whose points all have heights; `false` if the record is full.
fn add_mesh(mesh: &Mesh, fade_10nm: i32, record: &mut RecordWriter) -> bool {
    let mut add = |index: u8, bytes: [u8; 8]| record.add(Entry { id: MESH, index, value: f64::from_le_bytes(bytes) });
    let grid = mesh.grid();
    let points = i32::from(u16::from_le_bytes(grid.points));
    let is_whole = add(0, two(grid.from_10nm)) && add(1, two(grid.spacing_10nm)) && add(2, two([points, fade_10nm]));
    is_whole
        && entries_of(grid.points).all(|(index, points)| {
            let mut bytes = [0; 8];
            for (height, point) in bytes.as_chunks_mut::<2>().0.iter_mut().zip(points) {
                *height = mesh.height_um(point).unwrap_or_default().to_le_bytes();
            }
            add(index, bytes)
        })
}

/// Numbers of points of a mesh, if this entry holds them.
pub(super) fn points(entry: Entry) -> Option<[u8; 2]> {
    let [columns, rows, ..] = entry.value.to_le_bytes();
    (entry.index == 2).then_some([columns, rows])
}

/// Copies a stored mesh into one without points. Returns the height to which Z follows it, units of
/// 10 nm; `None` if the mesh is incomplete, or higher than a bed can be.
fn read_mesh(record: Record<'_>, mesh: &mut Mesh, interpolation: MeshInterpolation) -> Option<i32> {
    let bytes_of = |index: u8| {
        let mut entries = record.entries();
        entries.find(|entry| entry.id == MESH && entry.index == index).map(|entry| entry.value.to_le_bytes())
    };
    let [points, fade_10nm] = of_two(bytes_of(2)?);
    let [columns, rows, ..] = points.to_le_bytes();
    let grid =
        MeshGrid { from_10nm: of_two(bytes_of(0)?), spacing_10nm: of_two(bytes_of(1)?), points: [columns, rows] };
    let is_count = |count: &u8| (2..=MAX_MESH_POINTS).contains(&usize::from(*count));
    if !grid.points.iter().all(is_count) || grid.spacing_10nm.iter().any(|spacing| *spacing <= 0) || fade_10nm < 0 {
        return None;
    }
    mesh.begin(&grid, interpolation);
    for (index, points) in entries_of(grid.points) {
        let bytes = bytes_of(index)?;
        for (height, point) in bytes.as_chunks::<2>().0.iter().zip(points) {
            let height_um = i16::from_le_bytes(*height);
            let is_of_grid = mesh.set_height_um(point, height_um);
            if is_of_grid && !(-MAX_HEIGHT_UM..=MAX_HEIGHT_UM).contains(&height_um) {
                return None;
            }
        }
    }
    Some(fade_10nm)
}

impl<P: Ports> Printer<'_, P> {
    /// Adds the mesh, if all its points have heights; `false` if the record is full.
    #[inline(never)]
    pub(super) fn add_mesh(&mut self, record: &mut RecordWriter) -> bool {
        if !self.has_bed() {
            return true;
        }
        let fade_10nm = self.interpreter.modal.mesh_fade_10nm as i32;
        let add = |mesh: &mut Mesh| !mesh.is_complete() || add_mesh(mesh, fade_10nm, record);
        self.motion.mesh(add).unwrap_or(true)
    }

    /// Reads the stored mesh, which Z does not follow before M420 S1. An incomplete mesh is refused
    /// with a message.
    #[inline(never)]
    pub(super) fn load_mesh(&mut self, memory: &dyn SettingsMemory, stored: &Stored<PartsOf<P>>) {
        if !self.has_bed() {
            return;
        }
        self.forget_mesh();
        if stored.mesh.is_none() {
            return;
        }
        let mut slot = [0; SLOT_BYTES];
        let Ok(Some(bytes)) = memory.load(&mut slot) else { return };
        let Ok(record) = Record::read(bytes, self.profile.name) else { return };
        let interpolation = self.profile.mesh.map(|settings| settings.interpolation).unwrap_or_default();
        match self.motion.mesh(|mesh| read_mesh(record, mesh, interpolation)).flatten() {
            Some(fade_10nm) => self.interpreter.modal.mesh_fade_10nm = fade_10nm.into(),
            None => {
                self.forget_mesh();
                let text = "echo:settings: the stored mesh is not whole and not used: G29 and M500 replace it";
                self.replies.say(format_args!("{text}"));
            }
        }
    }

    /// Reports the present mesh for M503, in a comment.
    #[inline(never)]
    pub(super) fn report_stored_mesh(&mut self) {
        let points = self.motion.mesh(|mesh| mesh.is_complete().then(|| mesh.grid().points)).flatten();
        if let (true, Some([columns, rows])) = (self.has_bed(), points) {
            self.replies
                .say(format_args!("echo:; Bed Leveling: a mesh of {columns} x {rows} points (M420 V prints it)"));
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The points of a grid, in order.
    fn points_of([columns, rows]: [u8; 2]) -> impl Iterator<Item = [u8; 2]> {
        (0..rows).flat_map(move |row| (0..columns).map(move |column| [column, row]))
    }

    fn mesh_of(grid: MeshGrid, heights_um: &[i16]) -> Mesh {
        let mut mesh = Mesh::NONE;
        mesh.begin(&grid, MeshInterpolation::Bilinear);
        for (point, height) in points_of(grid.points).zip(heights_um) {
            assert!(mesh.set_height_um(point, *height));
        }
        assert!(mesh.is_complete());
        mesh
    }

    fn heights(mesh: &Mesh) -> Vec<Option<i16>> {
        points_of(mesh.grid().points).map(|point| mesh.height_um(point)).collect()
    }

    fn record_of(mesh: &Mesh, fade_10nm: i32) -> RecordWriter {
        let mut record = RecordWriter::new("bed");
        assert!(add_mesh(mesh, fade_10nm, &mut record));
        record
    }

    #[test]
    fn the_largest_fits_beside_settings() {
        let grid = MeshGrid { from_10nm: [0; 2], spacing_10nm: [1; 2], points: [MAX_MESH_POINTS as u8; 2] };
        let record = record_of(&mesh_of(grid, &[1; 225]), 0);
        assert_eq!(Record::read(record.bytes(), "bed").unwrap().entries().count(), 60);
    }

    proptest! {
        #[test]
        fn a_mesh_comes_back(
            from_10nm in any::<[i32; 2]>(),
            spacing_10nm in [1..i32::MAX, 1..i32::MAX],
            points in [2..=15_u8, 2..=15_u8],
            heights_um in proptest::collection::vec(-MAX_HEIGHT_UM..=MAX_HEIGHT_UM, 225),
            fade_10nm in 0..i32::MAX,
            interpolation in proptest::sample::select(&[MeshInterpolation::Bilinear, MeshInterpolation::Bicubic][..]),
        ) {
            let mesh = mesh_of(MeshGrid { from_10nm, spacing_10nm, points }, &heights_um);
            let record = record_of(&mesh, fade_10nm);
            let mut read = Mesh::NONE;
            let found = read_mesh(Record::read(record.bytes(), "bed").unwrap(), &mut read, interpolation);
            prop_assert_eq!((found, read.grid()), (Some(fade_10nm), mesh.grid()));
            prop_assert_eq!(heights(&read), heights(&mesh));
        }

        /// A mesh is read whole or not at all, whatever is stored under its name.
        #[test]
        fn what_is_damaged_is_no_mesh(
            head in any::<[[i32; 2]; 2]>(),
            points in [0..20_u8, 0..20_u8],
            fade_10nm in any::<i32>(),
            rest in proptest::collection::vec((0..70_u8, any::<[u8; 8]>()), 0..75),
        ) {
            let mut record = RecordWriter::new("bed");
            let points = i32::from(u16::from_le_bytes(points));
            let head = [(0, two(head[0])), (1, two(head[1])), (2, two([points, fade_10nm]))];
            for (index, bytes) in head.into_iter().chain(rest) {
                record.add(Entry { id: MESH, index, value: f64::from_le_bytes(bytes) });
            }
            let mut mesh = Mesh::NONE;
            if read_mesh(Record::read(record.bytes(), "bed").unwrap(), &mut mesh, MeshInterpolation::Bicubic).is_some() {
                prop_assert!(mesh.is_complete());
            }
        }

        /// A missing entry is noticed.
        #[test]
        fn a_mesh_without_one_entry_is_none(points in [2..=15_u8, 2..=15_u8], missing in any::<prop::sample::Index>()) {
            let grid = MeshGrid { from_10nm: [0; 2], spacing_10nm: [100; 2], points };
            let whole = record_of(&mesh_of(grid, &[-7; 225]), 0);
            let entries: Vec<Entry> = Record::read(whole.bytes(), "bed").unwrap().entries().collect();
            let missing = missing.index(entries.len());
            let mut record = RecordWriter::new("bed");
            for (_, entry) in entries.into_iter().enumerate().filter(|(index, _)| *index != missing) {
                record.add(entry);
            }
            let found =
                read_mesh(Record::read(record.bytes(), "bed").unwrap(), &mut Mesh::NONE.clone(), MeshInterpolation::Bicubic);
            prop_assert_eq!(found, None);
        }
    }
}
