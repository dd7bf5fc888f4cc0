//! Measures how far a job has been read, as a share of its file.

use std::cell::Cell;
use std::io::{self, BufRead, Read};
use std::rc::Rc;

/// Bytes of a job's file on their way: fetched, unpacked, and taken by the reader of lines.
///
/// Buffers hold tens of kilobytes, which of a packed file may be all of it: only the taken bytes
/// have been executed. Their share of the file is known from the size that gzip writes at its end;
/// where that is not the size of all, from the share of the bytes that were fetched for them.
#[derive(Debug, Default)]
pub struct Place {
    /// Size of the file, bytes; 0 for a pipe.
    pub(super) size: Cell<u64>,
    /// Bytes that will come of it, as gzip's last four bytes say, less multiples of 4 GiB; 0 if
    /// they say nothing.
    pub(super) unpacked_size: Cell<u64>,
    /// Bytes of the file that have been unpacked; of plain text all that have been read.
    pub(super) fetched: Cell<u64>,
    /// Bytes that came of them.
    pub(super) unpacked: Cell<u64>,
    /// Bytes of those that were taken.
    pub(super) taken: Cell<u64>,
}

impl Place {
    /// The share of the file that was taken, 0 to 1; `None` for a pipe, which has no size.
    pub fn share(&self) -> Option<f64> {
        let size = self.size.get();
        let unpacked_size = self.unpacked_size.get();
        // The last four bytes of a file of several parts are the size of the last part.
        if size > 0 && unpacked_size >= size && self.unpacked.get() <= unpacked_size {
            return Some((self.taken.get() as f64 / unpacked_size as f64).min(1.0));
        }
        let taken = self.taken.get() as f64 / self.unpacked.get().max(1) as f64;
        (size > 0).then(|| (self.fetched.get() as f64 / size as f64 * taken).min(1.0))
    }

    /// Notes that bytes were taken.
    pub(super) fn take(&self, bytes: usize) {
        self.taken.set(self.taken.get() + bytes as u64);
    }

    /// Notes that taken bytes were put back.
    pub(super) fn put_back(&self, bytes: usize) {
        self.taken.set(self.taken.get().saturating_sub(bytes as u64));
    }
}

/// Counts bytes that pass into one of the counts of a place.
pub(super) struct Counting<R> {
    pub(super) inner: R,
    pub(super) place: Rc<Place>,
    pub(super) count: fn(&Place) -> &Cell<u64>,
}

impl<R> Counting<R> {
    fn add(&self, bytes: usize) {
        let count = (self.count)(&self.place);
        count.set(count.get() + bytes as u64);
    }
}

impl<R: Read> Read for Counting<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.add(read);
        Ok(read)
    }
}

impl<R: BufRead> BufRead for Counting<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, bytes: usize) {
        self.inner.consume(bytes);
        self.add(bytes);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::Input;
    use super::*;

    /// Reads an example as a job does; the share must follow the text.
    #[track_caller]
    fn follows(name: &str, tolerance: f64) {
        let path = format!("{}/../../examples/{name}", env!("CARGO_MANIFEST_DIR"));
        let mut all = Vec::new();
        Input::open(path.as_ref()).unwrap().read_to_end(&mut all).unwrap();
        let mut input = Input::open(path.as_ref()).unwrap();
        let place = input.place();
        let mut portion = [0; 4096];
        let mut taken = 0;
        loop {
            let length = input.read(&mut portion).unwrap();
            taken += length;
            let (share, expected) = (place.share().unwrap(), taken as f64 / all.len() as f64);
            assert!((share - expected).abs() <= tolerance, "{name}: {share} after {expected}");
            if length == 0 {
                break;
            }
        }
        assert_eq!(place.share(), Some(1.0), "{name}");
    }

    #[test]
    fn the_share_of_text_is_exact() {
        follows("cube.gcode", 1e-3);
    }

    #[test]
    fn the_share_of_text_packed_by_gzip_is_exact() {
        follows("supports.gcode.gz", 1e-9);
        follows("cube-cura.gcode.gz", 1e-9);
    }

    /// The parts of a file are compressed unequally well.
    #[test]
    fn the_share_of_binary_gcode_is_nearly_so() {
        follows("cube.bgcode", 0.1);
    }

    #[test]
    fn a_pipe_has_no_share() {
        let input = Input::new(Box::new(&b"G28\n"[..]), None).unwrap();
        assert_eq!(input.place().share(), None);
    }
}
