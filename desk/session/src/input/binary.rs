//! Binary G-code: its metadata, and its G-code as text.

use std::fmt;
use std::io::{self, Read, Seek, SeekFrom};
use std::rc::Rc;

use ferrostep_binary_gcode::{BlockKind, Decoder, Progress, Selection, ThumbnailFormat, entries, seconds};
use ferrostep_gpre::Thumbnail;
use ferrostep_host::printable::one_line;
use serde::Serialize;

use super::InputError;
use super::place::Place;
use super::sliced_for::SlicedFor;
use crate::duration::hms;

/// Bytes decoded at once.
const PORTION_BYTES: usize = 64 * 1024;

/// A slicer's figures of its job.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SlicerFigures {
    /// The slicer and its version.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub producer: Option<String>,
    /// The printer that it sliced for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub printer_model: Option<String>,
    /// The slicer's estimate of the printing time, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<u32>,
    /// Filament, of all extruders together, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filament_mm: Option<f64>,
}

impl SlicerFigures {
    /// Takes in a block of metadata. The first of two equal keys counts.
    fn read(&mut self, text: &str) {
        for (key, value) in entries(text) {
            let value = value.trim();
            match key.trim() {
                "Producer" => keep(&mut self.producer, || Some(value.to_owned())),
                "printer_model" => keep(&mut self.printer_model, || Some(value.to_owned())),
                "estimated printing time (normal mode)" => keep(&mut self.time_s, || seconds(value)),
                "filament used [mm]" => keep(&mut self.filament_mm, || sum(value)),
                _ => {}
            }
        }
        let is_said = |text: &String| !text.is_empty();
        self.producer = self.producer.take().filter(is_said);
        self.printer_model = self.printer_model.take().filter(is_said);
    }
}

fn keep<T>(place: &mut Option<T>, value: impl FnOnce() -> Option<T>) {
    if place.is_none() {
        *place = value();
    }
}

/// The sum of numbers with commas in between, one for each extruder.
fn sum(numbers: &str) -> Option<f64> {
    numbers.split(',').map(|number| number.trim().parse::<f64>().ok().filter(|number| number.is_finite())).sum()
}

/// The contents of a file besides its G-code.
#[derive(Debug, Default)]
pub struct Description {
    /// The slicer's figures.
    pub figures: SlicerFigures,
    /// The printer that it was sliced for.
    pub sliced_for: SlicedFor,
    /// The pictures.
    pub thumbnails: Vec<(Thumbnail, Vec<u8>)>,
}

impl Description {
    /// Reads a whole file and compares the checksums of all its blocks.
    pub(super) fn of(file: impl Read + Seek) -> Result<Self, InputError> {
        let mut description = Self::default();
        let mut blocks = Blocks::new(file, Selection::DESCRIPTION);
        let mut portion = vec![0; PORTION_BYTES];
        let mut open: Option<(BlockKind, u64, Vec<u8>)> = None;
        loop {
            match blocks.advance(&mut portion)? {
                Progress::More => {}
                Progress::Contents(kind, length) => {
                    let contents = portion.get(..length).unwrap_or_default();
                    let offset = blocks.decoder.block_offset();
                    match &mut open {
                        Some((last, block, bytes)) if (*last, *block) == (kind, offset) => {
                            bytes.extend_from_slice(contents);
                        }
                        _ => {
                            description.keep(open.replace((kind, offset, contents.to_vec())));
                        }
                    }
                }
                Progress::End => {
                    description.keep(open);
                    return Ok(description);
                }
            }
        }
    }

    fn keep(&mut self, block: Option<(BlockKind, u64, Vec<u8>)>) {
        match block {
            Some((BlockKind::Thumbnail { format, width, height }, _, bytes)) => {
                let format = match format {
                    ThumbnailFormat::Png => ferrostep_gpre::ThumbnailFormat::Png,
                    ThumbnailFormat::Jpeg => ferrostep_gpre::ThumbnailFormat::Jpeg,
                    ThumbnailFormat::Qoi => ferrostep_gpre::ThumbnailFormat::Qoi,
                };
                let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
                self.thumbnails.push((Thumbnail { format, width, height, length }, bytes));
            }
            Some((_, _, text)) => {
                let text = String::from_utf8_lossy(&text);
                self.figures.read(&text);
                text.lines().for_each(|setting| self.sliced_for.take(setting));
            }
            None => {}
        }
    }
}

impl fmt::Display for Description {
    /// A line for each entry.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SlicerFigures { producer, printer_model, time_s, filament_mm } = &self.figures;
        let text = |text: &Option<String>| text.as_deref().map_or("not said".to_owned(), |text| one_line(text).into());
        let time = time_s.map_or("not said".to_owned(), |seconds| format!("{}, by the slicer", hms(seconds.into())));
        let filament = filament_mm.map_or("not said".to_owned(), |mm| format!("{:.3} m, by the slicer", mm / 1000.0));
        writeln!(out, "encoding     binary G-code, all checksums right")?;
        writeln!(out, "slicer       {}", text(producer))?;
        writeln!(out, "printer      {}", text(printer_model))?;
        writeln!(out, "time         {time}")?;
        writeln!(out, "filament     {filament}")?;
        for (picture, _) in &self.thumbnails {
            let Thumbnail { format, width, height, length } = picture;
            writeln!(out, "thumbnail    {format:?}, {width} x {height}, {length} bytes")?;
        }
        if self.thumbnails.is_empty() { writeln!(out, "thumbnail    none") } else { Ok(()) }
    }
}

/// The selected blocks of a file, read in portions.
struct Blocks<R> {
    file: R,
    decoder: Decoder,
    /// The bytes of the file that were read last.
    portion: Vec<u8>,
    /// Their place in the file.
    from: u64,
}

impl<R: Read + Seek> Blocks<R> {
    fn new(file: R, selection: Selection) -> Self {
        Self { file, decoder: Decoder::new(selection), portion: Vec::new(), from: 0 }
    }

    /// Decodes bytes of the file, as [`Decoder::advance`] does.
    fn advance(&mut self, output: &mut [u8]) -> Result<Progress, InputError> {
        let position = self.decoder.position();
        let ahead = position.checked_sub(self.from).and_then(|bytes| usize::try_from(bytes).ok());
        if ahead.is_none_or(|ahead| ahead >= self.portion.len()) {
            self.portion.clear();
            self.from = self.file.seek(SeekFrom::Start(position))?;
            (&mut self.file).take(PORTION_BYTES as u64).read_to_end(&mut self.portion)?;
        }
        let ahead = usize::try_from(position - self.from).unwrap_or(usize::MAX);
        let bytes = self.portion.get(ahead..).unwrap_or_default();
        self.decoder.advance(bytes, output).map_err(InputError::Binary)
    }
}

/// The G-code of a file, as text.
pub(super) struct GcodeText<R> {
    blocks: Blocks<R>,
    /// Counter of the file's bytes.
    place: Rc<Place>,
}

impl<R: Read + Seek> GcodeText<R> {
    /// Starts at a file's first block.
    pub(super) fn new(file: R, place: Rc<Place>) -> Self {
        place.fetched.set(0);
        Self { blocks: Blocks::new(file, Selection::GCODE), place }
    }
}

impl<R: Read + Seek> Read for GcodeText<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            let progress = self.blocks.advance(buffer);
            self.place.fetched.set(self.blocks.decoder.position());
            match progress {
                Ok(Progress::More) => {}
                Ok(Progress::Contents(_, length)) => return Ok(length),
                Ok(Progress::End) => return Ok(0),
                Err(InputError::Read(error)) => return Err(error),
                Err(error) => return Err(io::Error::new(io::ErrorKind::InvalidData, error)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures() {
        let mut figures = SlicerFigures::default();
        figures.read("Producer=PrusaSlicer 2.9.2\nfilament used [mm]=1.5, 2.25\nprinter_model=\n");
        figures.read("printer_model=MINI\nfilament used [mm]=9\nestimated printing time (normal mode)=1h 1s\nfoo\n");
        let expected = SlicerFigures {
            producer: Some("PrusaSlicer 2.9.2".to_owned()),
            printer_model: Some("MINI".to_owned()),
            time_s: Some(3601),
            filament_mm: Some(3.75),
        };
        assert_eq!(figures, expected);
        figures = SlicerFigures::default();
        figures.read("filament used [mm]=much\nestimated printing time (normal mode)=soon\n");
        assert_eq!(figures, SlicerFigures::default());
    }
}
