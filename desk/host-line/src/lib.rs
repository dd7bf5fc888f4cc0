//! Line of a virtual printer: a pseudo-terminal or TCP port of this computer for a person or a host
//! program such as OctoPrint, or a pair of sockets for a host within the program.
//!
//! No call except [`Line::wait`] and [`Line::wait_any`] blocks: a virtual printer reads and writes
//! between two slices of its time. Like a wire, TCP discards bytes while no host is connected; a
//! pseudo-terminal keeps as many as fit, so that a host that opens it soon afterwards still reads
//! the `start`.
//!
//! A real host sends in real time: a run with such a line is not exactly reproducible.
#![cfg(unix)]

pub mod damage;

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Maximum number of bytes kept for a host that reads slowly; beyond it the oldest lines are
/// dropped.
const MAX_WAITING: usize = 64 * 1024;
/// Maximum number of bytes in one read.
const MAX_READ: usize = 4096;
/// Maximum sleep of [`Line::wait`] while no host has the terminal open; `poll` cannot wait for a
/// host to open it.
const LOOK: Duration = Duration::from_millis(5);

/// Line that a host program on this computer can open.
#[derive(Debug)]
pub struct Line {
    end: End,
    waiting: VecDeque<u8>,
    dropped_bytes: u64,
    /// True if a host had the line open at the last check.
    was_open: bool,
    /// True if a host has left since the last [`Self::take_departure`].
    has_departed: bool,
}

#[derive(Debug)]
enum End {
    Pty {
        board_end: File,
        link: PathBuf,
        name: PathBuf,
    },
    Tcp {
        listener: TcpListener,
        client: Option<TcpStream>,
        address: SocketAddr,
    },
    /// `None` once the host has closed its end.
    Pair(Option<UnixStream>),
}

impl Line {
    /// Opens a pseudo-terminal and creates a symbolic link to it at `link`, which hosts open like a
    /// serial port. The link is removed when the line is dropped; a link to a terminal that no
    /// longer exists is replaced.
    ///
    /// # Errors
    /// Another file is at `link`, or the operating system refuses a pseudo-terminal.
    pub fn pty(link: &Path) -> Result<Self, String> {
        let shown = link.display();
        if std::fs::symlink_metadata(link).is_ok() {
            let stale = std::fs::symlink_metadata(link).is_ok_and(|it| it.is_symlink()) && !link.exists();
            if !stale {
                return Err(format!("{shown} is in use: choose another path, or end the program that uses it"));
            }
            std::fs::remove_file(link).map_err(|error| {
                format!("the old link {shown} cannot be removed: {error}; remove it, or choose another path")
            })?;
        }
        let (board_end, name) = open_terminal().map_err(|error| {
            format!("{shown}: the operating system refuses a pseudo-terminal: {error}; use --tcp PORT")
        })?;
        std::os::unix::fs::symlink(&name, link).map_err(|error| {
            format!("{shown} cannot be created: {error}; choose a path in a folder with write permission")
        })?;
        Ok(Self::with(End::Pty { board_end, link: link.to_owned(), name }))
    }

    /// Listens on a TCP port of this computer only (127.0.0.1), for one host at a time; port 0
    /// takes any free port.
    ///
    /// # Errors
    /// The port is in use, or not permitted.
    pub fn tcp(port: u16) -> Result<Self, String> {
        let listen = || -> io::Result<(TcpListener, SocketAddr)> {
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        match listen() {
            Ok((listener, address)) => Ok(Self::with(End::Tcp { listener, client: None, address })),
            Err(error) if error.kind() == ErrorKind::AddrInUse => {
                Err(format!("port {port} is in use: choose another one, or end the program that uses it"))
            }
            Err(error) => Err(format!("port {port} cannot be opened: {error}; choose one above 1023")),
        }
    }

    /// Creates a line to a host in this program, and returns the host's end with it.
    ///
    /// # Errors
    /// The operating system refuses a pair of sockets.
    pub fn pair() -> io::Result<(Self, UnixStream)> {
        let (board_end, host_end) = UnixStream::pair()?;
        board_end.set_nonblocking(true)?;
        Ok((Self::with(End::Pair(Some(board_end))), host_end))
    }

    fn with(end: End) -> Self {
        Self { end, waiting: VecDeque::new(), dropped_bytes: 0, was_open: false, has_departed: false }
    }

    /// Returns the address that a host opens: a path, or IP address and port.
    #[must_use]
    pub fn address(&self) -> String {
        match &self.end {
            End::Pty { link, .. } => link.display().to_string(),
            End::Tcp { address, .. } => address.to_string(),
            End::Pair(_) => "this program".to_owned(),
        }
    }

    /// Returns true if a host has the line open.
    pub fn connected(&mut self) -> bool {
        match &mut self.end {
            End::Pty { board_end, .. } => {
                let is_open = !hung_up(board_end);
                self.has_departed |= std::mem::replace(&mut self.was_open, is_open) && !is_open;
                is_open
            }
            End::Tcp { listener, client, .. } => {
                accept(listener, client);
                client.is_some()
            }
            End::Pair(host) => host.is_some(),
        }
    }

    /// Returns true if a host has left since the last call: the unfinished line of that host is not
    /// the beginning of the next host's. Bytes returned by the [`Self::read`] that detects the
    /// departure are the next host's. On a terminal only [`Self::connected`] detects a departure,
    /// so a host that leaves and comes back between two checks goes unnoticed.
    pub fn take_departure(&mut self) -> bool {
        std::mem::take(&mut self.has_departed)
    }

    /// Reads the bytes that the host has sent since the last call, at most `max_bytes` and never
    /// more than 4096.
    ///
    /// # Errors
    /// The line is permanently broken. A host that disconnects is not an error.
    pub fn read(&mut self, max_bytes: usize) -> io::Result<Vec<u8>> {
        self.flush()?;
        let mut bytes = [0; MAX_READ];
        let bytes = &mut bytes[..max_bytes.min(MAX_READ)];
        let count = match &mut self.end {
            End::Pty { board_end, .. } => match board_end.read(bytes) {
                Err(error) if is_idle(&error) => {
                    if error.kind() != ErrorKind::WouldBlock {
                        // No host has the terminal open any more: bytes that the last one did not
                        // read are not for the next one.
                        self.waiting.clear();
                    }
                    0
                }
                other => other?,
            },
            End::Tcp { listener, client, .. } => {
                accept(listener, client);
                let Some(stream) = client else { return Ok(Vec::new()) };
                match stream.read(bytes) {
                    Err(error) if error.kind() == ErrorKind::WouldBlock => 0,
                    Ok(count) if count > 0 => count,
                    _gone => {
                        *client = None;
                        self.has_departed = true;
                        self.waiting.clear();
                        0
                    }
                }
            }
            End::Pair(host) => {
                let Some(stream) = host else { return Ok(Vec::new()) };
                match stream.read(bytes) {
                    Err(error) if error.kind() == ErrorKind::WouldBlock => 0,
                    Ok(count) if count > 0 => count,
                    _gone => {
                        *host = None;
                        self.has_departed = true;
                        self.waiting.clear();
                        0
                    }
                }
            }
        };
        Ok(bytes[..count].to_vec())
    }

    /// Sends bytes to the host; bytes that the host does not accept yet are kept for later calls of
    /// this method or of [`Line::read`].
    ///
    /// # Errors
    /// The line is permanently broken. A host that disconnects is not an error.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if !matches!(self.end, End::Pty { .. }) && !self.connected() {
            self.dropped_bytes += bytes.len() as u64;
            return Ok(());
        }
        self.waiting.extend(bytes);
        self.flush()?;
        let surplus = self.waiting.len().saturating_sub(MAX_WAITING);
        // Drop whole lines, so that the next byte begins a line.
        let surplus = match self.waiting.iter().skip(surplus).position(|byte| *byte == b'\n') {
            Some(rest) if surplus > 0 => surplus + rest + 1,
            _ => surplus,
        };
        self.waiting.drain(..surplus);
        self.dropped_bytes += surplus as u64;
        Ok(())
    }

    /// Returns the number of bytes that the host has not accepted yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Waits until the host has sent something, at most for `timeout`; a new host also ends the
    /// wait.
    pub fn wait(&self, timeout: Duration) {
        Self::wait_any(&[self], timeout);
    }

    /// Waits until a host of one of these lines has sent something, at most for `timeout`; a new
    /// host also ends the wait.
    pub fn wait_any(lines: &[&Self], timeout: Duration) {
        let mut sources: Vec<PollFd<'_>> = lines.iter().filter_map(|line| line.end.source()).collect();
        let poll_for = |sources: &mut [PollFd<'_>], timeout: Duration| {
            // An interruption also ends the wait.
            let _ = poll(sources, Timespec::try_from(timeout).ok().as_ref());
        };
        poll_for(&mut sources, timeout);
        // A terminal without a host always reports HUP: wait for the other lines without it, for at
        // most `LOOK`.
        let is_unheard = |source: &PollFd<'_>| {
            source.revents().contains(PollFlags::HUP) && !source.revents().contains(PollFlags::IN)
        };
        if sources.iter().any(is_unheard) && !sources.iter().any(|source| source.revents().contains(PollFlags::IN)) {
            sources.retain(|source| !is_unheard(source));
            match sources.is_empty() {
                true => std::thread::sleep(timeout.min(LOOK)),
                false => poll_for(&mut sources, timeout.min(LOOK)),
            }
        }
    }

    /// Returns the number of bytes that were dropped because no host read them.
    #[must_use]
    pub fn dropped_bytes(&self) -> u64 {
        self.dropped_bytes
    }

    fn flush(&mut self) -> io::Result<()> {
        while !self.waiting.is_empty() {
            let (bytes, _) = self.waiting.as_slices();
            let written = match &mut self.end {
                End::Pty { board_end, .. } => match board_end.write(bytes) {
                    Err(error) if is_idle(&error) => return Ok(()),
                    other => Some(other?),
                },
                End::Tcp { client, .. } => write_to(client, bytes),
                End::Pair(host) => write_to(host, bytes),
            };
            let Some(written) = written else {
                self.has_departed = true;
                self.waiting.clear();
                return Ok(());
            };
            if written == 0 {
                return Ok(());
            }
            self.waiting.drain(..written);
        }
        Ok(())
    }
}

/// Writes to a connected host and returns the number of bytes that it accepted. `None` means that
/// the host has just disconnected.
fn write_to(host: &mut Option<impl Write>, bytes: &[u8]) -> Option<usize> {
    let Some(stream) = host else { return Some(0) };
    match stream.write(bytes) {
        Err(error) if error.kind() == ErrorKind::WouldBlock => Some(0),
        Ok(written) => Some(written),
        Err(_gone) => {
            *host = None;
            None
        }
    }
}

impl End {
    /// Returns the file to wait on until a host sends; `None` if no host ever will.
    fn source(&self) -> Option<PollFd<'_>> {
        let source = match self {
            Self::Pty { board_end, .. } => board_end.as_fd(),
            Self::Tcp { client: Some(stream), .. } => stream.as_fd(),
            Self::Tcp { listener, .. } => listener.as_fd(),
            Self::Pair(host) => host.as_ref()?.as_fd(),
        };
        Some(PollFd::from_borrowed_fd(source, PollFlags::IN))
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let End::Pty { link, name, .. } = &self.end
            && std::fs::read_link(link).is_ok_and(|target| target == *name)
        {
            // If the link cannot be removed, the next line replaces it.
            let _ = std::fs::remove_file(link);
        }
    }
}

/// Opens a terminal: the board's end, raw and non-blocking, and the name of the host's end.
fn open_terminal() -> io::Result<(File, PathBuf)> {
    let board_end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
    // Some systems do not accept this as a flag of the call above.
    rustix::io::fcntl_setfd(&board_end, rustix::io::FdFlags::CLOEXEC)?;
    grantpt(&board_end)?;
    unlockpt(&board_end)?;
    let name = ptsname(&board_end, Vec::new())?;
    let name = PathBuf::from(std::ffi::OsStr::from_bytes(name.to_bytes()));
    // Both ends share their settings (tty_ioctl(4)). Raw mode before a host opens the terminal
    // prevents an echo.
    let mut settings = tcgetattr(&board_end)?;
    settings.make_raw();
    tcsetattr(&board_end, OptionalActions::Now, &settings)?;
    rustix::io::ioctl_fionbio(&board_end, true)?;
    Ok((File::from(board_end), name))
}

/// Returns true if an error only means that no byte is ready, or that no host has the
/// terminal open (EIO).
fn is_idle(error: &io::Error) -> bool {
    error.kind() == ErrorKind::WouldBlock || error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error())
}

/// Returns true if the last host has closed the terminal. A terminal counts as open until the first
/// host opens it.
fn hung_up(board_end: &File) -> bool {
    let mut ends = [PollFd::new(board_end, PollFlags::empty())];
    let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut ends, Some(&at_once)).is_ok() && ends[0].revents().contains(PollFlags::HUP)
}

/// Accepts the next host if none is connected.
fn accept(listener: &TcpListener, client: &mut Option<TcpStream>) {
    if client.is_none()
        && let Ok((stream, _)) = listener.accept()
        && stream.set_nonblocking(true).is_ok()
    {
        // A line of G-code is a small packet that should be sent at once.
        let _ = stream.set_nodelay(true);
        *client = Some(stream);
    }
}

#[cfg(test)]
mod tests;
