//! Files that the command writes: each has its name only when it is whole.

mod unfinished;

use std::fmt;
use std::fs::{self, File, FileType, Metadata};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

/// What may be at an output's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accepted {
    /// A file, or nothing yet.
    File,
    /// A pipe or a character device, too: the output is written in one go, from its beginning to its end.
    FileOrStream,
}

/// A file that must not be written over.
#[derive(Clone, Copy, Debug)]
pub struct Protected<'a> {
    /// Its name.
    pub path: &'a Path,
    /// What it is, for the message: "the profile".
    pub what: &'static str,
}

/// Why an output cannot be written.
#[derive(Debug)]
pub struct OutputError {
    path: PathBuf,
    reason: String,
}

impl OutputError {
    /// An output of this name, and why.
    pub fn new(path: &Path, reason: impl fmt::Display) -> Self {
        Self { path: path.to_path_buf(), reason: reason.to_string() }
    }
}

impl fmt::Display for OutputError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: cannot be written: {}", crate::terminal::name(&self.path), self.reason)
    }
}

impl std::error::Error for OutputError {}

/// Where the bytes go.
#[derive(Debug)]
enum Sink {
    /// A file beside the one that it will replace.
    Part(NamedTempFile),
    /// A pipe or a device.
    Stream(File),
}

/// An output that is being written. Dropped before [`Self::keep`], or ended by a signal, it leaves nothing behind, and what
/// had its name before stays.
#[derive(Debug)]
pub struct Output {
    /// The name as given.
    path: PathBuf,
    /// What the name leads to, links followed.
    target: PathBuf,
    sink: Option<Sink>,
}

impl Output {
    /// Begins an output. A link is written through: what it leads to is replaced.
    ///
    /// # Errors
    /// The name leads to what is not accepted or is protected, or nowhere, or its folder cannot be written.
    pub fn create(path: &Path, accepted: Accepted, protected: &[Protected<'_>]) -> Result<Self, OutputError> {
        let refuse = |reason: String| OutputError::new(path, reason);
        let existing = fs::metadata(path).ok();
        if let Some(same) = protected.iter().find(|file| is_same(path, existing.as_ref(), file.path)) {
            return Err(refuse(format!("it is {}, expected another name", same.what)));
        }
        let Some(existing) = existing else {
            if let Ok(target) = fs::read_link(path) {
                let target = crate::terminal::name(&target);
                return Err(refuse(format!(
                    "it is a link to {target}, which does not exist: remove the link, or make its target"
                )));
            }
            return Self::begin(path, path.to_path_buf(), None);
        };
        let kind = existing.file_type();
        if kind.is_file() {
            if existing.permissions().readonly() {
                return Err(refuse("it is read-only, expected another name, or leave to write to it".to_owned()));
            }
            let target = path.canonicalize().map_err(|error| refuse(error.to_string()))?;
            return Self::begin(path, target, Some(existing));
        }
        if accepted == Accepted::FileOrStream && is_stream(kind) {
            let stream = File::options().write(true).open(path).map_err(|error| refuse(error.to_string()))?;
            return Ok(Self { path: path.to_path_buf(), target: path.to_path_buf(), sink: Some(Sink::Stream(stream)) });
        }
        Err(refuse(format!("it is {}, expected the name of a file", kind_name(kind))))
    }

    /// Opens the part: a new file with a name that is free, in the same folder, so that it can be renamed.
    fn begin(path: &Path, target: PathBuf, replaced: Option<Metadata>) -> Result<Self, OutputError> {
        let refuse = |error: io::Error| OutputError::new(path, error);
        let name = target.file_name().ok_or_else(|| OutputError::new(path, "it names no file"))?;
        let folder = folder_of(&target);
        let mut prefix = std::ffi::OsString::from(".");
        // Names may be as long as the file system has them: room for what makes this one its own.
        prefix.push(name.to_string_lossy().chars().take(40).collect::<String>());
        prefix.push(".");
        let mut builder = Builder::new();
        builder.prefix(&prefix).suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Like any new file's, not private as a temporary one's; the process's mask applies.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let part = unfinished::begin(|| builder.tempfile_in(folder)).map_err(refuse)?;
        let output = Self { path: path.to_path_buf(), target: target.clone(), sink: Some(Sink::Part(part)) };
        if let (Some(replaced), Some(Sink::Part(part))) = (replaced, &output.sink) {
            part.as_file().set_permissions(replaced.permissions()).map_err(refuse)?;
        }
        Ok(output)
    }

    /// What the name leads to, links followed; to protect it from being written over.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// An error while this output was written, with its name.
    pub fn failed(&self, error: io::Error) -> OutputError {
        OutputError::new(&self.path, error)
    }

    /// The output is whole: it gets its name, in place of what had it before.
    ///
    /// # Errors
    /// It cannot be renamed, or the stream takes no more; nothing is left behind then.
    pub fn keep(mut self) -> Result<(), OutputError> {
        let outcome = match self.sink.take() {
            Some(Sink::Part(part)) => unfinished::keep(part, &self.target),
            Some(Sink::Stream(mut stream)) => stream.flush(),
            None => Ok(()),
        };
        outcome.map_err(|error| OutputError::new(&self.path, error))
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

/// The folder of a file; a bare name's is the present one.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Whether an output's name leads to this file, which need not exist yet. Neither is opened: of a pipe that alone would take.
fn is_same(path: &Path, existing: Option<&Metadata>, other: &Path) -> bool {
    let resolved = |path: &Path| match (path.canonicalize(), folder_of(path).canonicalize(), path.file_name()) {
        (Ok(resolved), ..) => resolved,
        (_, Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_path_buf(),
    };
    // Devices may be read and written at once.
    let is_file = existing.is_none_or(Metadata::is_file);
    let same_file = match (existing, fs::metadata(other)) {
        (Some(existing), Ok(other)) => has_same_number(existing, &other),
        _ => false,
    };
    is_file && (same_file || resolved(path) == resolved(other))
}

/// Whether both are one file under perhaps two names (hard links).
#[cfg(unix)]
fn has_same_number(one: &Metadata, other: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Whether both are one file under perhaps two names: here only the names tell.
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

/// What is at a name where a file should be.
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
