//! A TCP connection to a printer or its server.

use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Time limit for connecting to one address.
const CONNECT: Duration = Duration::from_secs(10);

/// Connects to the first address of a host (`NAME:PORT`) that answers.
///
/// # Errors
/// The name is unknown, or no address answers; then the error is that of the last address.
pub fn connect(host: &str) -> io::Result<TcpStream> {
    let mut failed = io::Error::from(io::ErrorKind::AddrNotAvailable);
    for address in host.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => return Ok(stream),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}
