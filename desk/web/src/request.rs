//! Reads and parses the head of a request, up to a maximum size; an ambiguous head is refused.

use std::io::Read;

use crate::answer::Answer;
use crate::deadline::is_slow;

/// Maximum size of a head, bytes.
const MAX_HEAD_BYTES: usize = 8 * 1024;

/// Maximum number of header lines.
const MAX_HEADERS: usize = 48;

/// Head of a request, and the part of its body that arrived with it.
#[derive(Debug, Default)]
pub struct Request {
    /// Method, as sent.
    pub method: String,
    /// Target up to a question mark.
    pub path: String,
    /// Text after the question mark.
    pub query: String,
    /// `Host`.
    pub host: Option<String>,
    /// `Origin`.
    pub origin: Option<String>,
    /// `Sec-Fetch-Site`: the browser's statement of the site from which a page sends the request.
    pub fetch_site: Option<String>,
    /// Token in `Authorization: Bearer TOKEN`.
    pub token: Option<String>,
    /// `X-Api-Key`: the key of a slicer.
    pub key: Option<String>,
    /// `Content-Type`.
    pub content_type: Option<String>,
    /// `Content-Length`.
    pub length: Option<u64>,
    /// `X-Name`: the name of an uploaded file, percent-encoded.
    pub name: Option<String>,
    /// True if the client waits for `100 Continue` before it sends its body.
    pub expects_continue: bool,
    /// First bytes of the body.
    pub body_start: Vec<u8>,
}

impl Request {
    /// Reads a head. `Ok(None)` means that the client has left without sending anything.
    ///
    /// # Errors
    /// The answer to input that is not a request, is too long or too slow.
    pub fn read(stream: &mut impl Read) -> Result<Option<Self>, Answer> {
        let mut bytes = Vec::new();
        loop {
            let mut portion = [0; 1024];
            let room = (MAX_HEAD_BYTES - bytes.len()).min(portion.len());
            if room == 0 {
                return Err(Answer::text(431, format!("the header is longer than {MAX_HEAD_BYTES} bytes")));
            }
            let read = match stream.read(&mut portion[..room]) {
                Ok(read) => read,
                Err(error) if is_slow(&error) && !bytes.is_empty() => {
                    return Err(Answer::text(408, "the header did not come in time"));
                }
                Err(_) => return Ok(None),
            };
            if read == 0 {
                return if bytes.is_empty() { Ok(None) } else { Err(Answer::text(400, "the header is cut off")) };
            }
            bytes.extend_from_slice(&portion[..read]);
            if let Some(request) = Self::parse(&bytes)? {
                return Ok(Some(request));
            }
        }
    }

    /// Parses a head; `None` while it is incomplete.
    fn parse(bytes: &[u8]) -> Result<Option<Self>, Answer> {
        let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
        let mut head = httparse::Request::new(&mut headers);
        let length = match head.parse(bytes) {
            Ok(httparse::Status::Complete(length)) => length,
            Ok(httparse::Status::Partial) => return Ok(None),
            Err(httparse::Error::TooManyHeaders) => {
                return Err(Answer::text(431, format!("more than {MAX_HEADERS} header lines")));
            }
            Err(error) => return Err(Answer::text(400, format!("this is not an HTTP request: {error}"))),
        };
        let (path, query) =
            head.path.unwrap_or_default().split_once('?').unwrap_or((head.path.unwrap_or_default(), ""));
        let mut request = Self {
            method: head.method.unwrap_or_default().to_owned(),
            path: path.to_owned(),
            query: query.to_owned(),
            body_start: bytes.get(length..).unwrap_or_default().to_vec(),
            ..Self::default()
        };
        for header in head.headers.iter() {
            request.take(header.name, header.value)?;
        }
        Ok(Some(request))
    }

    /// Stores a header that matters. A header that occurs twice is refused, because it could be
    /// read in two ways.
    fn take(&mut self, name: &str, value: &[u8]) -> Result<(), Answer> {
        let text = || {
            let text = std::str::from_utf8(value).map_err(|_| Answer::text(400, format!("{name} is not text")))?;
            Ok(text.trim().to_owned())
        };
        let set = |place: &mut Option<String>, value: String| match place.replace(value) {
            None => Ok(()),
            Some(_) => Err(Answer::text(400, format!("{name} is given twice"))),
        };
        match name.to_ascii_lowercase().as_str() {
            "host" => set(&mut self.host, text()?),
            "origin" => set(&mut self.origin, text()?),
            "sec-fetch-site" => set(&mut self.fetch_site, text()?),
            "x-name" => set(&mut self.name, text()?),
            "x-api-key" => set(&mut self.key, text()?),
            "content-type" => set(&mut self.content_type, text()?),
            "authorization" => {
                let value = text()?;
                let token = value.strip_prefix("Bearer ").unwrap_or_default().to_owned();
                set(&mut self.token, token)
            }
            "content-length" => {
                let value = text()?;
                // `parse` would accept a sign.
                let length = value.bytes().all(|byte| byte.is_ascii_digit()).then(|| value.parse().ok()).flatten();
                let length = length.ok_or_else(|| Answer::text(400, "Content-Length is not a number of bytes"))?;
                match self.length.replace(length) {
                    None => Ok(()),
                    Some(_) => Err(Answer::text(400, "Content-Length is given twice")),
                }
            }
            "transfer-encoding" => Err(Answer::text(411, "Transfer-Encoding is not supported: send Content-Length")),
            "expect" => {
                self.expects_continue = text()?.eq_ignore_ascii_case("100-continue");
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Returns a number in the query, `KEY=NUMBER`.
    pub fn number(&self, key: &str) -> Option<u64> {
        self.query.split('&').find_map(|pair| pair.strip_prefix(key)?.strip_prefix('=')?.parse().ok())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Option<Request>, u16> {
        Request::read(&mut text.as_bytes()).map_err(|answer| answer.status)
    }

    #[test]
    fn a_head_is_taken_apart() {
        let text =
            "POST /line?after=7 HTTP/1.1\r\nHost: a:1\r\nAUTHORIZATION: Bearer abc\r\nContent-Length: 4\r\n\r\nM105";
        let request = read(text).unwrap().unwrap();
        assert_eq!((request.method.as_str(), request.path.as_str()), ("POST", "/line"));
        assert_eq!(
            (request.host.as_deref(), request.token.as_deref(), request.length),
            (Some("a:1"), Some("abc"), Some(4))
        );
        assert_eq!((request.number("after"), request.body_start.as_slice()), (Some(7), b"M105".as_slice()));
        assert!(read("").unwrap().is_none());
    }

    #[test]
    fn what_is_ambiguous_is_refused() {
        let with = |header: &str| read(&format!("GET / HTTP/1.1\r\n{header}\r\n\r\n")).map(|_| ());
        assert_eq!(with("Host: a"), Ok(()));
        for (header, status) in [
            ("Host: a\r\nHost: b", 400),
            ("Authorization: Bearer a\r\nAuthorization: Bearer b", 400),
            ("Content-Length: 1\r\nContent-Length: 1", 400),
            ("Content-Length: +1", 400),
            ("Content-Length: -1", 400),
            ("Content-Length: 99999999999999999999", 400),
            ("Transfer-Encoding: chunked", 411),
            ("no header", 400),
            ("Host : a", 400),
        ] {
            assert_eq!(with(header), Err(status), "{header}");
        }
        assert_eq!(read("\u{1}\u{2} garbage").map(|_| ()), Err(400));
        assert_eq!(read("GET / HTTP/1.1\r\nHost: a").map(|_| ()), Err(400), "cut off");
        assert_eq!(with(&format!("X: {}", "a".repeat(100_000))), Err(431));
        assert_eq!(with(&"X: a\r\n".repeat(MAX_HEADERS + 1)), Err(431));
    }
}
