//! HTTP answers.

use std::io::{self, Write};

/// Answer to a request.
#[derive(Debug)]
pub struct Answer {
    /// HTTP status.
    pub status: u16,
    kind: &'static str,
    policy: Option<&'static str>,
    /// URL of the newly created resource.
    location: Option<String>,
    body: Vec<u8>,
}

impl Answer {
    /// Creates an answer of plain text, to which a line end is added.
    pub fn text(status: u16, text: impl Into<String>) -> Self {
        let mut text = text.into();
        text.push('\n');
        Self { status, kind: "text/plain; charset=utf-8", policy: None, location: None, body: text.into_bytes() }
    }

    /// Creates the answer `ok` to an action that was carried out.
    pub fn done() -> Self {
        Self::text(200, "ok")
    }

    /// Creates an answer with JSON data.
    pub const fn json(body: Vec<u8>) -> Self {
        Self { status: 200, kind: "application/json", policy: None, location: None, body }
    }

    /// Creates an answer to a request that created a resource: JSON data and the resource's URL,
    /// which must not contain control characters.
    pub const fn created(body: Vec<u8>, location: String) -> Self {
        Self { status: 201, kind: "application/json", policy: None, location: Some(location), body }
    }

    /// Creates an answer with the page and its content security policy.
    pub fn page(page: &'static str, policy: &'static str) -> Self {
        let body = page.as_bytes().to_vec();
        Self { status: 200, kind: "text/html; charset=utf-8", policy: Some(policy), location: None, body }
    }

    /// Writes the answer, after which the connection closes.
    ///
    /// # Errors
    /// The client is gone, or too slow.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let (status, reason) = (self.status, reason(self.status));
        let policy = self.policy.unwrap_or("default-src 'none'; frame-ancestors 'none'");
        let location = self.location.as_ref().map_or_else(String::new, |location| format!("Location: {location}\r\n"));
        let head = format!(
            "HTTP/1.1 {status} {reason}\r\n{location}Content-Type: {}\r\nContent-Length: {}\r\nConnection: close\r\nCache-Control: no-store\r\n\
             Content-Security-Policy: {policy}\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\n\r\n",
            self.kind,
            self.body.len()
        );
        out.write_all(head.as_bytes())?;
        out.write_all(&self.body)?;
        out.flush()
    }
}

/// Returns the reason phrase of a status.
const fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        201 => "Created",
        400 => "Bad Request",
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        409 => "Conflict",
        411 => "Length Required",
        413 => "Content Too Large",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        507 => "Insufficient Storage",
        _ => "Internal Server Error",
    }
}
