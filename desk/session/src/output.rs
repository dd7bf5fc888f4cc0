//! Output files: each is written under a temporary name and renamed when it is complete.

mod parts;
#[cfg(unix)]
mod signals;
mod unfinished;

use std::fmt;
use std::fs::{self, File, FileType, Metadata};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

/// The kinds of files to which an output's name may lead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accepted {
    /// A regular file, existing or new.
    File,
    /// A file, a pipe or a character device: this output is written from beginning to end
    /// without seeking.
    FileOrStream,
}

/// A file that the output must not replace.
#[derive(Clone, Copy, Debug)]
pub struct Protected<'a> {
    /// Path of the file.
    pub path: &'a Path,
    /// Description of the file for the error message: "the profile".
    pub what: &'static str,
}

/// Reason for which an output cannot be written.
#[derive(Debug)]
pub struct OutputError {
    path: PathBuf,
    reason: String,
}

impl OutputError {
    /// The error for the output at `path`.
    pub fn new(path: &Path, reason: impl fmt::Display) -> Self {
        Self { path: path.to_path_buf(), reason: reason.to_string() }
    }
}

impl fmt::Display for OutputError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: cannot be written: {}", ferrostep_host::printable::name(&self.path), self.reason)
    }
}

impl std::error::Error for OutputError {}

/// The place of the bytes.
#[derive(Debug)]
enum Sink {
    /// A temporary file in the folder of the final one.
    Part(NamedTempFile),
    /// A pipe or a device.
    Stream(File),
}

/// An output that is being written. If it is dropped before [`Self::keep`], or a signal ends the
/// process, the temporary file is removed and an existing file of that name stays unchanged.
#[derive(Debug)]
pub struct Output {
    /// The name as given.
    path: PathBuf,
    /// The path with links followed.
    target: PathBuf,
    sink: Option<Sink>,
}

impl Output {
    /// Opens an output. Through a link, the file that it leads to is replaced.
    ///
    /// # Errors
    /// The path leads to a file of another kind, to a protected file, or through a broken link, or
    /// its folder is not writable.
    pub fn create(path: &Path, accepted: Accepted, protected: &[Protected<'_>]) -> Result<Self, OutputError> {
        let refuse = |reason: String| OutputError::new(path, reason);
        let existing = fs::metadata(path).ok();
        if let Some(same) = protected.iter().find(|file| is_same(path, existing.as_ref(), file.path)) {
            return Err(refuse(format!("this is {}: choose another name for the output", same.what)));
        }
        let Some(existing) = existing else {
            if let Ok(target) = fs::read_link(path) {
                let target = ferrostep_host::printable::name(&target);
                return Err(refuse(format!(
                    "this is a link to {target}, which does not exist: remove the link, or create its target"
                )));
            }
            return Self::begin(path, path.to_path_buf(), None);
        };
        let kind = existing.file_type();
        if kind.is_file() {
            if existing.permissions().readonly() {
                return Err(refuse("the file is read-only: choose another name, or make it writable".to_owned()));
            }
            let target = path.canonicalize().map_err(|error| refuse(error.to_string()))?;
            return Self::begin(path, target, Some(existing));
        }
        if accepted == Accepted::FileOrStream && is_stream(kind) {
            let stream = File::options().write(true).open(path).map_err(|error| refuse(error.to_string()))?;
            return Ok(Self { path: path.to_path_buf(), target: path.to_path_buf(), sink: Some(Sink::Stream(stream)) });
        }
        Err(refuse(format!("this is {}: give the name of a file", kind_name(kind))))
    }

    /// Creates the temporary file, in the same folder so that it can be renamed.
    fn begin(path: &Path, target: PathBuf, replaced: Option<Metadata>) -> Result<Self, OutputError> {
        let refuse = |error: io::Error| OutputError::new(path, without_part_name(&error));
        let name = target.file_name().ok_or_else(|| OutputError::new(path, "the path has no file name"))?;
        let folder = folder_of(&target);
        let mut prefix = std::ffi::OsString::from(".");
        // File systems limit the length of a name: leave room for the random part.
        prefix.push(name.to_string_lossy().chars().take(40).collect::<String>());
        prefix.push(".");
        let mut builder = Builder::new();
        builder.prefix(&prefix).suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The permissions of any new file, minus the process's mask, and not the private ones
            // of a temporary file.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let part = unfinished::begin(|| builder.tempfile_in(folder)).map_err(refuse)?;
        let output = Self { path: path.to_path_buf(), target: target.clone(), sink: Some(Sink::Part(part)) };
        if let (Some(replaced), Some(Sink::Part(part))) = (replaced, &output.sink) {
            part.as_file().set_permissions(replaced.permissions()).map_err(refuse)?;
        }
        Ok(output)
    }

    /// The path with links followed, to protect it from other outputs.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// The error for this output, from an error while it was written.
    pub fn failed(&self, error: io::Error) -> OutputError {
        OutputError::new(&self.path, error)
    }

    /// Completes the output: renames it to its final name, replacing an existing file.
    ///
    /// # Errors
    /// The rename or the last write fails; the temporary file is removed then.
    pub fn keep(mut self) -> Result<(), OutputError> {
        let outcome = match self.sink.take() {
            // On the disk before it replaces another file: a power cut must not leave an empty one.
            Some(Sink::Part(part)) => {
                let written = part.as_file().sync_all();
                written.and_then(|()| unfinished::keep(part, &self.target))
            }
            Some(Sink::Stream(mut stream)) => stream.flush(),
            None => Ok(()),
        };
        outcome.map_err(|error| OutputError::new(&self.path, error))
    }

    /// Flushes a buffered output and completes it.
    ///
    /// # Errors
    /// As [`Self::keep`].
    pub fn keep_buffered(out: BufWriter<Self>) -> Result<(), OutputError> {
        match out.into_inner() {
            Ok(out) => out.keep(),
            Err(error) => {
                let (error, out) = error.into_parts();
                Err(out.get_ref().failed(error))
            }
        }
    }

    fn file(&mut self) -> io::Result<&mut File> {
        match &mut self.sink {
            Some(Sink::Part(part)) => Ok(part.as_file_mut()),
            Some(Sink::Stream(stream)) => Ok(stream),
            None => Err(io::ErrorKind::NotConnected.into()),
        }
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Some(Sink::Part(part)) = self.sink.take() {
            unfinished::discard(part);
        }
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file()?.flush()
    }
}

impl Seek for Output {
    fn seek(&mut self, place: SeekFrom) -> io::Result<u64> {
        self.file()?.seek(place)
    }
}

/// The operating system's reason, without the temporary file's name that tempfile adds.
fn without_part_name(error: &io::Error) -> String {
    let text = error.to_string();
    text.rsplit_once(" at path \"").map_or(text.clone(), |(reason, _)| reason.to_owned())
}

/// The folder of a file; for a bare name the working folder.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Returns true if an output's name leads to this file, which need not exist yet. Opens neither:
/// opening a pipe consumes from it.
fn is_same(path: &Path, existing: Option<&Metadata>, other: &Path) -> bool {
    let resolved = |path: &Path| match (path.canonicalize(), folder_of(path).canonicalize(), path.file_name()) {
        (Ok(resolved), ..) => resolved,
        (_, Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_path_buf(),
    };
    // A device may be input and output at once.
    let is_file = existing.is_none_or(Metadata::is_file);
    let same_file = match (existing, fs::metadata(other)) {
        (Some(existing), Ok(other)) => has_same_number(existing, &other),
        _ => false,
    };
    is_file && (same_file || resolved(path) == resolved(other))
}

/// Returns true if both are the same file, by device and inode (hard links too).
#[cfg(unix)]
fn has_same_number(one: &Metadata, other: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Returns false: without inodes only the paths can be compared.
#[cfg(not(unix))]
fn has_same_number(_: &Metadata, _: &Metadata) -> bool {
    false
}

#[cfg(unix)]
fn is_stream(kind: FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_fifo() || kind.is_char_device()
}

#[cfg(not(unix))]
fn is_stream(_: FileType) -> bool {
    false
}

/// The kind of a directory entry that is not a regular file, in words.
fn kind_name(kind: FileType) -> &'static str {
    if kind.is_dir() {
        return "a folder";
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_socket() {
            return "a socket";
        }
        if kind.is_fifo() {
            return "a pipe";
        }
    }
    "a device"
}
