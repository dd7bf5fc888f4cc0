//! Answers.

use std::io::{self, Write};

/// An answer to a request.
#[derive(Debug)]
pub struct Answer {
    /// HTTP status.
    pub status: u16,
    kind: &'static str,
    policy: Option<&'static str>,
    /// The address of the new resource.
    location: Option<String>,
    body: Vec<u8>,
}

impl Answer {
    /// A sentence.
    pub fn text(status: u16, text: impl Into<String>) -> Self {
        let mut text = text.into();
        text.push('\n');
        Self { status, kind: "text/plain; charset=utf-8", policy: None, location: None, body: text.into_bytes() }
    }

    /// Done.
    pub fn done() -> Self {
        Self::text(200, "ok")
    }

    /// Data.
    pub const fn json(body: Vec<u8>) -> Self {
        Self { status: 200, kind: "application/json", policy: None, location: None, body }
    }

    /// Something was made: data about it, and its address, which has no control characters.
    pub const fn created(body: Vec<u8>, location: String) -> Self {
        Self { status: 201, kind: "application/json", policy: None, location: Some(location), body }
    }

    /// The page, with its content security policy.
    pub fn page(page: &'static str, policy: &'static str) -> Self {
        let body = page.as_bytes().to_vec();
        Self { status: 200, kind: "text/html; charset=utf-8", policy: Some(policy), location: None, body }
    }

    /// Writes it. The connection ends with it.
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

/// A status in words.
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
