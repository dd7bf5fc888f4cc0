//! A GET request to a printer's server in the local network, and its answer.

use std::fmt;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::str::FromStr;
use std::time::{Duration, Instant};

use ferrostep_host::connection::connect;
use ferrostep_host::printable::one_line;

/// Largest answer, bytes. A configuration with all its macros has a tenth.
const MAX_BYTES: usize = 8 << 20;

/// Maximum length of a response's head, bytes, and maximum number of its headers.
const MAX_HEAD_BYTES: usize = 64 << 10;
const MAX_HEADERS: usize = 100;

/// The longest time of a whole answer.
const PATIENCE: Duration = Duration::from_secs(20);

/// Longest time of one read; a longer wait repeats it.
const READ: Duration = Duration::from_millis(100);

/// Port of `http` without a number.
const HTTP_PORT: u16 = 80;

/// The address of a server: `http://HOST` or `http://HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Url {
    /// Host, with brackets around an IPv6 address.
    host: String,
    port: u16,
}

impl FromStr for Url {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const EXPECTED: &str = "expected http://HOST or http://HOST:PORT, for example http://printer.local:7125";
        let lower = text.to_ascii_lowercase();
        if lower.starts_with("https://") {
            return Err("https is not supported: Moonraker answers in the local network by http, at port 7125: \
                        http://HOST:7125; or copy printer.cfg and import the file"
                .to_owned());
        }
        let Some(rest) = lower.strip_prefix("http://") else { return Err(EXPECTED.to_owned()) };
        let rest = rest.strip_suffix('/').unwrap_or(rest);
        if rest.contains(['/', '?', '#']) {
            return Err(format!("{EXPECTED}, without what follows"));
        }
        let is_address = rest.starts_with('[') && rest.ends_with(']');
        let (host, port) = match rest.rsplit_once(':').filter(|_| !is_address) {
            Some((host, port)) => (host, port.parse().map_err(|_| EXPECTED.to_owned())?),
            None => (rest, HTTP_PORT),
        };
        let is_bare = |host: &str| !host.contains([':', '[', ']']);
        let inner = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
        let is_host = inner.map_or(is_bare(host), |inner| inner.contains(':'));
        let is_written = |char: char| char.is_alphanumeric() || ['.', '-', '_', ':', '[', ']', '%'].contains(&char);
        if host.is_empty() || port == 0 || !is_host || !host.chars().all(is_written) {
            return Err(EXPECTED.to_owned());
        }
        Ok(Self { host: host.to_owned(), port })
    }
}

impl fmt::Display for Url {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "http://{}", self.host)?;
        if self.port == HTTP_PORT { Ok(()) } else { write!(out, ":{}", self.port) }
    }
}

/// The key by which a server knows its user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ApiKey(String);

impl FromStr for ApiKey {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_key = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_graphic());
        is_key.then(|| Self(text.to_owned())).ok_or_else(|| "expected letters and digits without blanks".to_owned())
    }
}

/// An answer.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Answer {
    /// The status, 200 for a good one.
    pub status: u16,
    /// Address to which the server redirects its client.
    pub location: Option<String>,
    /// The body, with the parts of a chunked one put together.
    pub body: Vec<u8>,
}

/// Asks a server for a path, with a key if it wants one.
///
/// # Errors
/// The server does not accept the connection, is silent, or its answer is not HTTP or too long.
pub(crate) fn get(url: &Url, path: &str, key: Option<&ApiKey>) -> Result<Answer, String> {
    let Url { host, port } = url;
    let mut stream = connect(&format!("{host}:{port}")).map_err(|error| {
        let hint = if *port == HTTP_PORT { "; Moonraker itself answers at port 7125" } else { "" };
        format!("nothing answers at {host}:{port} ({error}): is the printer on, and the address right{hint}?")
    })?;
    let lost = |error: io::Error| format!("the connection is lost: {error}");
    stream.set_read_timeout(Some(READ)).map_err(lost)?;
    stream.set_write_timeout(Some(PATIENCE)).map_err(lost)?;
    let key = key.map_or_else(String::new, |ApiKey(key)| format!("X-Api-Key: {key}\r\n"));
    let request = format!(
        "GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nAccept: application/json\r\nUser-Agent: ferrostep\r\n{key}Connection: \
         close\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).map_err(lost)?;
    let begin = Instant::now();
    read_answer(stream, || begin.elapsed() > PATIENCE)
}

/// Reads an answer. `is_late` says that no more time is left.
fn read_answer(stream: impl Read, is_late: impl FnMut() -> bool) -> Result<Answer, String> {
    let mut stream = BufReader::new(Timed { stream, is_late, left: MAX_BYTES });
    let mut head = Vec::new();
    loop {
        let read = read_line(&mut stream, &mut head)?;
        if head.len() > MAX_HEAD_BYTES {
            return Err("the answer is not HTTP: its head has no end".to_owned());
        }
        if read == 0 {
            return Err("the connection ends before the answer does: try again".to_owned());
        }
        if !head.starts_with(b"HTTP/") && head.len() >= 5 {
            return Err("the answer is not HTTP: is this the address of a web server?".to_owned());
        }
        if head.ends_with(b"\n\r\n") || head.ends_with(b"\n\n") {
            break;
        }
    }
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut response = httparse::Response::new(&mut headers);
    let is_whole = response.parse(&head).map_err(|error| format!("the answer is not HTTP: {error}"))?.is_complete();
    let Some(status) = response.code.filter(|_| is_whole) else {
        return Err("the answer is not HTTP: its head is not whole".to_owned());
    };
    let header = |name: &str| {
        let found = response.headers.iter().find(|header| header.name.eq_ignore_ascii_case(name))?;
        Some(String::from_utf8_lossy(found.value).trim().to_ascii_lowercase())
    };
    if let Some(packed) = header("Content-Encoding").filter(|encoding| encoding != "identity") {
        return Err(format!("the answer is packed ({}), which was not asked for", one_line(&packed)));
    }
    let body = if header("Transfer-Encoding").is_some_and(|encoding| encoding.contains("chunked")) {
        read_chunks(&mut stream)?
    } else {
        let length = match header("Content-Length") {
            Some(text) => {
                Some(text.parse::<u64>().map_err(|_| "the answer's Content-Length is not a number".to_owned())?)
            }
            None => None,
        };
        let mut body = Vec::new();
        stream.by_ref().take(length.unwrap_or(u64::MAX)).read_to_end(&mut body).map_err(failed)?;
        if length.is_some_and(|length| (body.len() as u64) < length) {
            return Err("the connection ends before the answer does: try again".to_owned());
        }
        body
    };
    Ok(Answer { status, location: header("Location"), body })
}

/// Reads the body of an answer in chunks, each with its size in a line before it.
fn read_chunks(stream: &mut impl BufRead) -> Result<Vec<u8>, String> {
    let mut body = Vec::new();
    loop {
        let mut line = Vec::new();
        read_line(stream, &mut line)?;
        let Ok(httparse::Status::Complete((_, size))) = httparse::parse_chunk_size(&line) else {
            return Err("the answer's parts have no sizes: try again".to_owned());
        };
        if size == 0 {
            return Ok(body);
        }
        let before = body.len();
        stream.take(size).read_to_end(&mut body).map_err(failed)?;
        let mut end = Vec::new();
        read_line(stream, &mut end)?;
        if ((body.len() - before) as u64) < size || !matches!(end.as_slice(), b"\r\n" | b"\n") {
            return Err("the connection ends before the answer does: try again".to_owned());
        }
    }
}

/// Appends a line with its end; the number of bytes, 0 at the end of the answer.
fn read_line(stream: &mut impl BufRead, line: &mut Vec<u8>) -> Result<usize, String> {
    stream.take(MAX_HEAD_BYTES as u64).read_until(b'\n', line).map_err(failed)
}

/// Describes why the answer is not whole.
fn failed(error: io::Error) -> String {
    match error.kind() {
        io::ErrorKind::TimedOut => {
            format!("no whole answer within {} s: is the printer's computer overloaded? Try again", PATIENCE.as_secs())
        }
        io::ErrorKind::FileTooLarge => {
            format!("the answer is larger than {} MiB, which no configuration is", MAX_BYTES >> 20)
        }
        _ => format!("the connection is lost: {error}"),
    }
}

/// The bytes of a stream, as long as there is time, and up to a number.
struct Timed<S, L> {
    stream: S,
    is_late: L,
    left: usize,
}

impl<S: Read, L: FnMut() -> bool> Read for Timed<S, L> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        loop {
            if (self.is_late)() {
                return Err(io::ErrorKind::TimedOut.into());
            }
            match self.stream.read(bytes) {
                Ok(read) => {
                    self.left = self.left.checked_sub(read).ok_or(io::ErrorKind::FileTooLarge)?;
                    return Ok(read);
                }
                Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => {}
                Err(error) => return Err(error),
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn answer(text: &str) -> Result<Answer, String> {
        read_answer(text.as_bytes(), || false)
    }

    #[test]
    fn addresses_have_a_host_and_a_port() {
        for (text, shown) in [
            ("http://printer.local", "http://printer.local"),
            ("HTTP://Printer.local:7125/", "http://printer.local:7125"),
            ("http://[fe80::1]:7125", "http://[fe80::1]:7125"),
            ("http://[::1]", "http://[::1]"),
            ("http://10.0.0.7:80", "http://10.0.0.7"),
        ] {
            assert_eq!(text.parse::<Url>().unwrap().to_string(), shown);
        }
        for text in [
            "",
            "printer.local",
            "ftp://printer",
            "http://",
            "http://:80",
            "http://host:",
            "http://host:0",
            "http://host:70000",
            "http://host/printer",
            "http://host?x",
            "http://a b",
            "http://user@host",
            "http://::1",
            "http://host\r\nX: y",
        ] {
            let error = text.parse::<Url>().unwrap_err();
            assert!(error.contains("expected http://HOST"), "{text:?}: {error}");
        }
        assert!("https://host".parse::<Url>().unwrap_err().contains("http://HOST:7125"));
    }

    #[test]
    fn bodies_are_read_by_length_by_chunks_and_to_the_end() {
        for text in [
            "HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nhello and more",
            "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n2;x=y\r\nhe\r\n3\r\nllo\r\n0\r\n\r\n",
            "HTTP/1.0 200 OK\n\nhello",
        ] {
            let answer = answer(text).unwrap();
            assert_eq!((answer.status, answer.body.as_slice()), (200, b"hello".as_slice()), "{text:?}");
        }
        let moved = answer("HTTP/1.1 301 Moved\r\nLocation: https://x/\r\nContent-Length: 0\r\n\r\n").unwrap();
        assert_eq!((moved.status, moved.location.as_deref()), (301, Some("https://x/")));
    }

    #[test]
    fn what_is_no_whole_answer_is_refused() {
        for (text, expected) in [
            ("", "ends before"),
            ("HTTP/1.1 200 OK\r\n", "ends before"),
            ("HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\nhello", "ends before"),
            ("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n9\r\nhello", "ends before"),
            ("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\nhello", "no sizes"),
            ("HTTP/1.1 200 OK\r\nContent-Length: -1\r\n\r\n", "not a number"),
            ("HTTP/1.1 200 OK\r\nContent-Encoding: gzip\r\n\r\n", "packed"),
            ("HTTP/1.1 abc\r\n\r\n", "not HTTP"),
            ("ok T:20.0\n", "not HTTP"),
        ] {
            let error = answer(text).unwrap_err();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
        let endless = io::repeat(b'x');
        let head = b"HTTP/1.1 200 OK\r\n\r\n".as_slice();
        assert!(read_answer(head.chain(endless), || false).unwrap_err().contains("larger than 8 MiB"));
        assert!(read_answer(b"HTTP/".chain(io::repeat(b'x')), || false).unwrap_err().contains("no end"));
    }

    /// A server that is silent for now.
    struct Silent;

    impl Read for Silent {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(io::ErrorKind::WouldBlock.into())
        }
    }

    #[test]
    fn a_server_that_answers_too_slowly_is_left() {
        let mut looks = 0;
        let head = b"HTTP/1.1 200 OK\r\n".as_slice();
        let late = || {
            looks += 1;
            looks > 10
        };
        assert!(read_answer(head.chain(Silent), late).unwrap_err().starts_with("no whole answer within 20 s"));
    }
}
