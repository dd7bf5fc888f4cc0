//! HTTP server: each connection has a thread, one request and one answer.

use std::io::{self, Read};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::deadline::Deadline;
use crate::guard::{Names, Token};
use crate::printer::Printer;
use crate::request::Request;
use crate::routes::Room;

/// Maximum time to read what a refused client still sends, so that it can read the reason.
const DRAIN: Duration = Duration::from_secs(1);

/// Maximum number of bytes read from a refused client.
const MAX_DRAINED_BYTES: u64 = 1024 * 1024;

/// Pause after the system could not accept a connection, for example because too many files are
/// open.
const RECOVERY: Duration = Duration::from_millis(50);

/// Limits of the server.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Maximum number of simultaneous connections; further ones are closed.
    pub connections: usize,
    /// Maximum size of an upload, bytes.
    pub upload_bytes: u64,
    /// Maximum time of a request's head, of a short body, and of an answer.
    pub request: Duration,
    /// Maximum time of an upload.
    pub upload: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 64,
            upload_bytes: 256 * 1024 * 1024,
            request: Duration::from_secs(10),
            upload: Duration::from_secs(600),
        }
    }
}

/// Running server. The server ends when this value is dropped; answers under way continue within
/// their time limits.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    token: Token,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves a printer's page at an address; port 0 takes any free port. `key` is the slicers'
    /// key; without one, slicers on this computer need no key and others are refused.
    ///
    /// # Errors
    /// The address is in use or does not belong to this computer.
    pub fn start(
        address: SocketAddr,
        printer: impl Printer,
        limits: Limits,
        key: Option<Token>,
    ) -> Result<Self, String> {
        let bind = || -> io::Result<(TcpListener, SocketAddr)> {
            let listener = TcpListener::bind(address)?;
            let bound = listener.local_addr()?;
            Ok((listener, bound))
        };
        let (listener, bound) = bind().map_err(|error| match error.kind() {
            io::ErrorKind::AddrInUse => {
                format!("--web {address}: in use: choose another port, or end the program that uses it")
            }
            _ => format!("--web {address}: {error}; write an address of this computer, such as 127.0.0.1:8790"),
        })?;
        let token = Token::random()?;
        let (names, upload) = (Names::new(bound), Mutex::new(()));
        let room = Arc::new(Room { printer, token: token.clone(), key, names, limits, upload });
        let ends = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&ends);
        let thread = thread::Builder::new().name("web".to_owned()).spawn(move || accept(&listener, &room, &ended));
        let thread = thread.map_err(|error| format!("no thread for the page's server: {error}"))?;
        Ok(Self { address: bound, token, ends, thread: Some(thread) })
    }

    /// Returns the address at which the server listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the page's URL with the token, for a person. The token is in the fragment, which no
    /// browser sends to a server.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/#{}", self.address, self.token.text())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        // Connect once to end the wait for a connection.
        let mut own = self.address;
        if own.ip().is_unspecified() {
            own.set_ip(if own.is_ipv4() { [127, 0, 0, 1].into() } else { std::net::Ipv6Addr::LOCALHOST.into() });
        }
        if TcpStream::connect_timeout(&own, DRAIN).is_ok()
            && let Some(thread) = self.thread.take()
        {
            let _ = thread.join();
        }
    }
}

/// Accepts connections until the server ends.
fn accept<P: Printer>(listener: &TcpListener, room: &Arc<Room<P>>, ends: &AtomicBool) {
    let open = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        if ends.load(Ordering::Relaxed) {
            return;
        }
        let Ok(stream) = stream else {
            thread::sleep(RECOVERY);
            continue;
        };
        let place = Place::take(&open);
        if place.others >= room.limits.connections {
            // Close without an answer: writing one could block on its reader.
            continue;
        }
        let room = Arc::clone(room);
        // The connection is closed if no thread can be started.
        let _ = thread::Builder::new().name("web client".to_owned()).spawn(move || {
            serve(&stream, &room);
            drop(place);
        });
    }
}

/// Place of a connection among the open ones.
struct Place {
    open: Arc<AtomicUsize>,
    /// Number of connections that were already open.
    others: usize,
}

impl Place {
    fn take(open: &Arc<AtomicUsize>) -> Self {
        Self { open: Arc::clone(open), others: open.fetch_add(1, Ordering::Relaxed) }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.open.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Serves a connection: one request, one answer.
fn serve<P: Printer>(stream: &TcpStream, room: &Room<P>) {
    let time = room.limits.request;
    // Send a small answer at once.
    let _ = stream.set_nodelay(true);
    let answer = match Request::read(&mut Deadline::new(stream, time)) {
        Ok(None) => return,
        Ok(Some(request)) => room.answer(&request, stream),
        Err(answer) => Err(answer),
    };
    let (answer, is_refused) = match answer {
        Ok(answer) => (answer, false),
        Err(answer) => (answer, true),
    };
    if answer.write(&mut Deadline::new(stream, time)).is_ok() && is_refused {
        drain(stream);
    }
}

/// Reads what a refused client still sends: if the connection were closed before that, the client's
/// system would discard the answer.
fn drain(stream: &TcpStream) {
    if stream.shutdown(Shutdown::Write).is_ok() {
        let _ = io::copy(&mut Deadline::new(stream, DRAIN).take(MAX_DRAINED_BYTES), &mut io::sink());
    }
}
