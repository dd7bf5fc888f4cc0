//! Routes each request to its answer. All paths are listed here; none is looked up in the file
//! system.

use std::io::Read;
use std::net::TcpStream;
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::Duration;

use serde::Serialize;

use crate::answer::Answer;
use crate::console::ConsoleLine;
use crate::control::Control;
use crate::deadline::{Deadline, is_slow};
use crate::guard::{Names, Token};
use crate::page;
use crate::printer::{Printer, Refusal, State};
use crate::request::Request;
use crate::server::Limits;
use crate::upload;

/// Maximum length of a console line or a control, bytes.
const MAX_LINE_BYTES: u64 = 256;

/// State shared by all requests.
pub struct Room<P> {
    pub printer: P,
    pub token: Token,
    /// Slicers' key, if a person has chosen one.
    pub key: Option<Token>,
    pub names: Names,
    pub limits: Limits,
    /// Held while a file arrives: one upload at a time.
    pub upload: Mutex<()>,
}

/// State of a printer and the new lines of its console.
#[derive(Serialize)]
struct Look {
    #[serde(flatten)]
    state: State,
    console: Vec<ConsoleLine>,
}

impl<P: Printer> Room<P> {
    /// Answers a request. `stream` holds the rest of its body.
    ///
    /// # Errors
    /// The answer that refuses the request.
    pub fn answer(&self, request: &Request, stream: &TcpStream) -> Result<Answer, Answer> {
        if !request.host.as_deref().is_some_and(|host| self.names.is_host(host)) {
            return Err(Answer::text(
                403,
                "this server has another address: use the one that `ferrostep serve` has printed",
            ));
        }
        if request.origin.as_deref().is_some_and(|origin| !self.names.is_origin(origin)) {
            return Err(Answer::text(403, "a page of another site asks: refused"));
        }
        let (method, path) = (request.method.as_str(), request.path.as_str());
        if path == "/" {
            return if method == "GET" {
                Ok(page::page())
            } else {
                Err(Answer::text(405, "the page is only read (GET)"))
            };
        }
        if request.fetch_site.as_deref().is_some_and(|site| site != "same-origin" && site != "none") {
            return Err(Answer::text(403, "a page of another site asks: refused"));
        }
        if let Some(path) = path.strip_prefix("/api/") {
            return self.slicer(request, path, stream);
        }
        if !request.token.as_deref().is_some_and(|token| self.token.is(token.as_bytes())) {
            return Err(Answer::text(
                401,
                "the token is missing or wrong: open the address that `ferrostep serve` has printed, up to its end",
            ));
        }
        match (method, path) {
            ("GET", "/state") => self.look(request.number("after").unwrap_or(0)),
            ("POST", "/line") => self.line(request, stream),
            ("POST", "/control") => self.control(request, stream),
            ("POST", "/job") => self.job(request, stream),
            ("POST", "/start") => done(self.printer.start()),
            ("POST", "/pause") => done(self.printer.pause()),
            ("POST", "/resume") => done(self.printer.resume()),
            ("POST", "/cancel") => done(self.printer.cancel()),
            ("POST", "/stop") => done(self.printer.stop()),
            (_, "/state" | "/line" | "/control" | "/job" | "/start" | "/pause" | "/resume" | "/cancel" | "/stop") => {
                Err(Answer::text(405, "/state is read by GET, the rest is POST"))
            }
            _ => Err(Answer::text(404, "there is no page of this name")),
        }
    }

    fn look(&self, after: u64) -> Result<Answer, Answer> {
        let look = Look { state: self.printer.state(), console: self.printer.console(after) };
        let body = serde_json::to_vec(&look).map_err(|error| Answer::text(500, error.to_string()))?;
        Ok(Answer::json(body))
    }

    fn line(&self, request: &Request, stream: &TcpStream) -> Result<Answer, Answer> {
        let line = String::from_utf8(self.short_body(request, stream)?);
        let line = line.map_err(|_| Answer::text(400, "the line is not text"))?;
        done(self.printer.send_line(line.trim()))
    }

    fn control(&self, request: &Request, stream: &TcpStream) -> Result<Answer, Answer> {
        let control = Control::read(&self.short_body(request, stream)?).map_err(|why| Answer::text(400, why))?;
        done(self.printer.control(control))
    }

    /// Reads a body of one line.
    fn short_body(&self, request: &Request, stream: &TcpStream) -> Result<Vec<u8>, Answer> {
        let length = length(request, MAX_LINE_BYTES, "a line")?;
        let mut line = Vec::new();
        let read = body(request, stream, length, self.limits.request)?.read_to_end(&mut line);
        read.map_err(|error| match is_slow(&error) {
            true => Answer::text(408, "the line did not come in time"),
            false => Answer::text(400, format!("the line did not come whole: {error}")),
        })?;
        if line.len() as u64 != length {
            return Err(Answer::text(400, "the line is cut off"));
        }
        Ok(line)
    }

    fn job(&self, request: &Request, stream: &TcpStream) -> Result<Answer, Answer> {
        let length = length(request, self.limits.upload_bytes, "a file")?;
        if length == 0 {
            return Err(Answer::text(400, "the file is empty"));
        }
        let _alone = self.begin_upload()?;
        let mut body = body(request, stream, length, self.limits.upload)?;
        let upload = upload::receive(&mut body, length, request.name.as_deref())?;
        done(self.printer.upload(upload))
    }

    /// Begins an upload if the printer would accept it. While the returned guard is held, no other
    /// upload can begin.
    ///
    /// # Errors
    /// Another file is arriving, or one is being printed.
    pub fn begin_upload(&self) -> Result<MutexGuard<'_, ()>, Answer> {
        let alone = match self.upload.try_lock() {
            Ok(alone) => alone,
            Err(TryLockError::Poisoned(alone)) => alone.into_inner(),
            Err(TryLockError::WouldBlock) => {
                return Err(Answer::text(409, "another file is being uploaded: wait for its end"));
            }
        };
        refused(self.printer.may_upload())?;
        Ok(alone)
    }
}

/// Turns a printer's refusal into an answer.
pub fn refused(outcome: Result<(), Refusal>) -> Result<(), Answer> {
    outcome.map_err(|refusal| Answer::text(409, refusal.0))
}

fn done(outcome: Result<(), Refusal>) -> Result<Answer, Answer> {
    refused(outcome).map(|()| Answer::done())
}

/// Returns the length of a request's body, if it is within a limit, bytes.
pub fn length(request: &Request, limit: u64, what: &str) -> Result<u64, Answer> {
    let length = request.length.ok_or_else(|| Answer::text(411, "Content-Length is missing"))?;
    if length > limit {
        return Err(Answer::text(413, format!("{what} may have {limit} bytes, this one has {length}")));
    }
    Ok(length)
}

/// Returns a reader of a request's body, which must arrive within `time`.
pub fn body<'a>(
    request: &'a Request,
    stream: &'a TcpStream,
    length: u64,
    time: Duration,
) -> Result<impl Read + Send + 'a, Answer> {
    let mut rest = Deadline::new(stream, time);
    if request.expects_continue {
        let go_on = std::io::Write::write_all(&mut rest, b"HTTP/1.1 100 Continue\r\n\r\n");
        go_on.map_err(|error| Answer::text(400, error.to_string()))?;
    }
    Ok(request.body_start.as_slice().chain(rest).take(length))
}
