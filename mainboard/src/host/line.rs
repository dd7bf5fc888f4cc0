//! A door of this computer to the board's line, for a person or a host such as OctoPrint.
//!
//! Nothing here waits: an emulated board asks between two slices of its time. What is said while no host listens is lost on
//! TCP, as on a wire; a pseudo-terminal keeps what fits, so that a host that opens it soon still reads the `start`.
//!
//! The bytes of a real host come at real times: a run with such a line cannot be repeated exactly.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// What is kept for a host that reads slowly, bytes; the oldest is dropped then.
const MAX_WAITING: usize = 64 * 1024;
/// How much is read at once, bytes.
const MAX_READ: usize = 4096;

/// A line that a host of this computer can open.
#[derive(Debug)]
pub struct Line {
    door: Door,
    waiting: VecDeque<u8>,
    dropped_bytes: u64,
}

#[derive(Debug)]
enum Door {
    Pty { board_end: File, link: PathBuf, name: PathBuf },
    Tcp { listener: TcpListener, client: Option<TcpStream>, address: SocketAddr },
}

impl Line {
    /// A pseudo-terminal, and a symbolic link to it at `link`, which hosts open like a serial port. The link is removed when
    /// the line is dropped; one whose terminal is gone is replaced.
    ///
    /// # Errors
    /// Something is at `link` already, or this computer gives no pseudo-terminal.
    pub fn pty(link: &Path) -> Result<Self, String> {
        let shown = link.display();
        if std::fs::symlink_metadata(link).is_ok() {
            let stale = std::fs::symlink_metadata(link).is_ok_and(|it| it.is_symlink()) && !link.exists();
            if !stale {
                return Err(format!("{shown} is in use: name another path, or end the program that has it"));
            }
            std::fs::remove_file(link).map_err(|error| format!("{shown}: an old link cannot be removed: {error}"))?;
        }
        let (board_end, name) =
            open_terminal().map_err(|error| format!("{shown}: there is no pseudo-terminal: {error}"))?;
        std::os::unix::fs::symlink(&name, link)
            .map_err(|error| format!("{shown} cannot be made: {error}; name a path in a folder that you may write"))?;
        Ok(Self::with(Door::Pty { board_end, link: link.to_owned(), name }))
    }

    /// A TCP port of this computer, not of the network (127.0.0.1). One host at a time; 0 takes any free port.
    ///
    /// # Errors
    /// The port is in use, or not allowed.
    pub fn tcp(port: u16) -> Result<Self, String> {
        let listen = || -> io::Result<(TcpListener, SocketAddr)> {
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        match listen() {
            Ok((listener, address)) => Ok(Self::with(Door::Tcp { listener, client: None, address })),
            Err(error) if error.kind() == ErrorKind::AddrInUse => {
                Err(format!("port {port} is in use: name another one, or end the program that has it"))
            }
            Err(error) => Err(format!("port {port} cannot be opened: {error}; name one above 1023")),
        }
    }

    fn with(door: Door) -> Self {
        Self { door, waiting: VecDeque::new(), dropped_bytes: 0 }
    }

    /// What a host is to open: a path, or address and port.
    #[must_use]
    pub fn address(&self) -> String {
        match &self.door {
            Door::Pty { link, .. } => link.display().to_string(),
            Door::Tcp { address, .. } => address.to_string(),
        }
    }

    /// Whether a host has the line open now.
    pub fn connected(&mut self) -> bool {
        match &mut self.door {
            Door::Pty { board_end, .. } => !hung_up(board_end),
            Door::Tcp { listener, client, .. } => {
                accept(listener, client);
                client.is_some()
            }
        }
    }

    /// What the host sent since the last call; empty if nothing.
    ///
    /// # Errors
    /// The line is broken for good. A host that goes is no error.
    pub fn read(&mut self) -> io::Result<Vec<u8>> {
        self.flush()?;
        let mut bytes = [0; MAX_READ];
        let count = match &mut self.door {
            Door::Pty { board_end, .. } => match board_end.read(&mut bytes) {
                Err(error) if nobody(&error) => 0,
                other => other?,
            },
            Door::Tcp { listener, client, .. } => {
                accept(listener, client);
                let Some(stream) = client else { return Ok(Vec::new()) };
                match stream.read(&mut bytes) {
                    Err(error) if error.kind() == ErrorKind::WouldBlock => 0,
                    Ok(count) if count > 0 => count,
                    _gone => {
                        *client = None;
                        self.waiting.clear();
                        0
                    }
                }
            }
        };
        Ok(bytes[..count].to_vec())
    }

    /// Sends bytes to the host; what it does not take yet is kept and sent by later calls of this or of [`Line::read`].
    ///
    /// # Errors
    /// The line is broken for good.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if matches!(self.door, Door::Tcp { .. }) && !self.connected() {
            self.dropped_bytes += bytes.len() as u64;
            return Ok(());
        }
        self.waiting.extend(bytes);
        self.flush()?;
        let surplus = self.waiting.len().saturating_sub(MAX_WAITING);
        self.waiting.drain(..surplus);
        self.dropped_bytes += surplus as u64;
        Ok(())
    }

    /// Bytes that no host read.
    #[must_use]
    pub fn dropped_bytes(&self) -> u64 {
        self.dropped_bytes
    }

    fn flush(&mut self) -> io::Result<()> {
        while !self.waiting.is_empty() {
            let (bytes, _) = self.waiting.as_slices();
            let written = match &mut self.door {
                Door::Pty { board_end, .. } => match board_end.write(bytes) {
                    Err(error) if nobody(&error) => return Ok(()),
                    other => other?,
                },
                Door::Tcp { client, .. } => {
                    let Some(stream) = client else { return Ok(()) };
                    match stream.write(bytes) {
                        Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                        Ok(written) => written,
                        Err(_gone) => {
                            *client = None;
                            self.waiting.clear();
                            return Ok(());
                        }
                    }
                }
            };
            if written == 0 {
                return Ok(());
            }
            self.waiting.drain(..written);
        }
        Ok(())
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Door::Pty { link, name, .. } = &self.door
            && std::fs::read_link(link).is_ok_and(|target| target == *name)
        {
            // Nothing can be done about a link that stays: the next line replaces it.
            let _ = std::fs::remove_file(link);
        }
    }
}

/// The board's end of a new terminal, raw and non-blocking, and the name of the host's end.
fn open_terminal() -> io::Result<(File, PathBuf)> {
    let board_end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&board_end)?;
    unlockpt(&board_end)?;
    let name = ptsname(&board_end, Vec::new())?;
    let name = PathBuf::from(std::ffi::OsStr::from_bytes(name.to_bytes()));
    // Settings of this end are those of the terminal (tty_ioctl(4)); raw before anybody opens it, lest it echoes.
    let mut settings = tcgetattr(&board_end)?;
    settings.make_raw();
    tcsetattr(&board_end, OptionalActions::Now, &settings)?;
    rustix::io::ioctl_fionbio(&board_end, true)?;
    Ok((File::from(board_end), name))
}

/// Whether an error only says that there is nothing to do, or that no host has the terminal open (EIO).
fn nobody(error: &io::Error) -> bool {
    error.kind() == ErrorKind::WouldBlock || error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error())
}

/// Whether the last host has closed the terminal. Until the first one opens it, it counts as open.
fn hung_up(board_end: &File) -> bool {
    let mut ends = [PollFd::new(board_end, PollFlags::empty())];
    let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut ends, Some(&at_once)).is_ok() && ends[0].revents().contains(PollFlags::HUP)
}

/// Takes the next host if none is connected.
fn accept(listener: &TcpListener, client: &mut Option<TcpStream>) {
    if client.is_none()
        && let Ok((stream, _)) = listener.accept()
        && stream.set_nonblocking(true).is_ok()
    {
        // A line of G-code is one small packet: it is to leave at once.
        let _ = stream.set_nodelay(true);
        *client = Some(stream);
    }
}

#[cfg(test)]
mod tests;
