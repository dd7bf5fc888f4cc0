//! The page's server in front of a served printer.
#![allow(clippy::unwrap_used, reason = "without the page no test can say anything")]

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::Value;

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(120);

/// A page's server, and its token.
#[derive(Clone, Debug)]
pub struct Page {
    url: String,
    /// Host and port.
    pub address: String,
    /// Token that every request has to name.
    pub token: String,
}

impl Page {
    /// The page with this address.
    ///
    /// # Panics
    /// The address is not a page's.
    pub fn at(url: &str) -> Self {
        let (address, token) = url.strip_prefix("http://").and_then(|rest| rest.split_once("/#")).unwrap();
        Self { url: url.to_owned(), address: address.to_owned(), token: token.to_owned() }
    }

    /// Waits for the printer: the page is there before its line to it is open.
    ///
    /// # Panics
    /// The line stays closed.
    pub fn wait_until_connected(&self) {
        self.look_until(|state| state["activity"] != "disconnected");
    }

    /// Address of the page, with the token.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Sends bytes; returns the whole answer. The server may answer, and close, before it
    /// has all of them.
    ///
    /// # Panics
    /// The server does not answer.
    pub fn raw(&self, bytes: &[u8]) -> String {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let _ = stream.write_all(bytes);
        let _ = stream.shutdown(std::net::Shutdown::Write);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8(answer).unwrap()
    }

    /// Asks with the token; returns status and body.
    ///
    /// # Panics
    /// The server does not answer.
    pub fn ask(&self, method: &str, path: &str, body: &[u8]) -> (u16, String) {
        let Self { address, token, .. } = self;
        let length = body.len();
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: {address}\r\nOrigin: http://{address}\r\nAuthorization: Bearer {token}\r\n\
             X-Name: part.gcode\r\nContent-Length: {length}\r\n\r\n"
        );
        let answer = self.raw(&[head.as_bytes(), body].concat());
        let (head, body) = answer.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{method} {path}: {answer:?}"));
        (status(head).unwrap(), body.to_owned())
    }

    /// Asks for something to be done.
    ///
    /// # Panics
    /// The page refuses it.
    #[track_caller]
    pub fn wish(&self, path: &str, body: &[u8]) {
        assert_eq!(self.ask("POST", path, body), (200, "ok\n".to_owned()), "{path}");
    }

    /// State that the page shows.
    ///
    /// # Panics
    /// The page refuses the request.
    pub fn state(&self) -> Value {
        let (status, body) = self.ask("GET", "/state?after=0", b"");
        assert_eq!(status, 200, "{body}");
        serde_json::from_str(&body).unwrap()
    }

    /// Asks for the state until it fits; returns it.
    ///
    /// # Panics
    /// The state does not fit in time.
    #[track_caller]
    pub fn look_until(&self, is_so: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + PATIENCE;
        loop {
            let state = self.state();
            if is_so(&state) {
                return state;
            }
            assert!(Instant::now() < end, "it does not become so: {state:#}");
        }
    }
}

/// The status of an answer; `None`: the connection was closed without one.
pub fn status(answer: &str) -> Option<u16> {
    answer.split(' ').nth(1)?.parse().ok()
}
