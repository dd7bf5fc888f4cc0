//! The server: connections, each with a thread, a request and an answer.

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

/// Longest time for what a refused client still sends, so that it can read why.
const DRAIN: Duration = Duration::from_secs(1);

/// Maximum number of bytes read of it.
const MAX_DRAINED_BYTES: u64 = 1024 * 1024;

/// A pause after the system could not accept a connection: out of files, for one.
const RECOVERY: Duration = Duration::from_millis(50);

/// The server's limits.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Maximum number of connections at once; more are closed.
    pub connections: usize,
    /// Largest upload.
    pub upload_bytes: u64,
    /// Longest time of a request's head, of a short body, and of an answer.
    pub request: Duration,
    /// Longest time of an upload.
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

/// A running server. It ends when this is dropped; answers under way continue for as long as their
/// limits let them.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    token: Token,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves a printer's page at an address; port 0 takes a free one. `key`: the key of slicers;
    /// without it those of this computer need none, and others are refused.
    ///
    /// # Errors
    /// The address is in use or not this computer's.
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

    /// The address that it listens at.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// The page's address with the token, for a person. The token is in the fragment, which no
    /// browser sends to a server.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/#{}", self.address, self.token.text())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        // A connection ends the wait for one.
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

/// Accepts connections until it is to end.
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
            // Closed without a word: a word could wait for its reader.
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

/// A connection's place among those that are open.
struct Place {
    open: Arc<AtomicUsize>,
    /// Number of connections that were open before.
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
    // A small answer should leave at once.
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

/// Reads what a refused client still sends: if the connection were closed on it, the client's
/// system would throw the answer away.
fn drain(stream: &TcpStream) {
    if stream.shutdown(Shutdown::Write).is_ok() {
        let _ = io::copy(&mut Deadline::new(stream, DRAIN).take(MAX_DRAINED_BYTES), &mut io::sink());
    }
}
