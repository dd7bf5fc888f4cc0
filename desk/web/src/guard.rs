//! Access control: the page's token, the slicers' key, and the names by which clients may call the
//! server.

use std::fmt;
use std::fmt::Write;
use std::net::{IpAddr, SocketAddr};

use sha2::{Digest, Sha256};

/// Number of random bytes in a token.
const TOKEN_BYTES: usize = 16;

/// Allowed length of a key that a person chooses, characters.
const KEY_CHARACTERS: std::ops::RangeInclusive<usize> = 8..=128;

/// Secret of the server: the page's token, new at each start, or the slicers' key. Its holder
/// controls the printer.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// Creates a token from the operating system's random numbers.
    ///
    /// # Errors
    /// The operating system provides no random numbers.
    pub fn random() -> Result<Self, String> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes)
            .map_err(|error| format!("the operating system has no random numbers for the page's token: {error}"))?;
        let mut text = String::new();
        for byte in bytes {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        Ok(Self(text))
    }

    /// Creates a token from a key that a person has chosen.
    ///
    /// # Errors
    /// The key is too short, too long, or cannot be sent in a header.
    pub fn chosen(key: &str) -> Result<Self, String> {
        if KEY_CHARACTERS.contains(&key.len()) && key.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Ok(Self(key.to_owned()));
        }
        let (shortest, longest) = KEY_CHARACTERS.into_inner();
        Err(format!("a key has {shortest} to {longest} characters: letters, digits and signs, no spaces"))
    }

    /// Returns the token's text, for the page's URL.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Returns true if this text is the token. The time that this takes reveals nothing about the
    /// token: hashes are compared, and always in full.
    #[must_use]
    pub fn is(&self, text: &[u8]) -> bool {
        let (own, other) = (Sha256::digest(self.0.as_bytes()), Sha256::digest(text));
        own.iter().zip(other.iter()).fold(0, |difference, (own, other)| difference | (own ^ other)) == 0
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Token(..)")
    }
}

/// Names by which clients may call a server, from the address it is bound to. If a web site's name
/// resolves to this computer (DNS rebinding), requests use that name, and so do those of its pages.
#[derive(Clone, Copy, Debug)]
pub struct Names {
    bound: SocketAddr,
}

impl Names {
    /// Creates the names of a server bound to this address.
    pub const fn new(bound: SocketAddr) -> Self {
        Self { bound }
    }

    /// Returns true if a `Host` header names this server: `localhost` or a loopback address, with
    /// the server's port. A server bound to another address also accepts that one; a server bound
    /// to all addresses accepts any address, but no other name. The port may be missing:
    /// PrusaSlicer leaves it out on Windows.
    pub fn is_host(&self, host: &str) -> bool {
        let (name, port) = split(host);
        if port.is_some_and(|port| port.parse() != Ok(self.bound.port())) {
            return false;
        }
        if name.eq_ignore_ascii_case("localhost") {
            return true;
        }
        let name = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        let Ok(address) = name.parse::<IpAddr>() else { return false };
        let bound = self.bound.ip();
        address == bound || address.is_loopback() || bound.is_unspecified()
    }

    /// Returns true if an `Origin` header is that of this server's own page.
    pub fn is_origin(&self, origin: &str) -> bool {
        let is_own_port =
            |host| split(host).1.map_or(self.bound.port() == 80, |port| port.parse() == Ok(self.bound.port()));
        origin.strip_prefix("http://").is_some_and(|host| self.is_host(host) && is_own_port(host))
    }
}

/// Splits a host into its name and its port, if it has one.
fn split(host: &str) -> (&str, Option<&str>) {
    match host.rsplit_once(':') {
        Some((name, port)) if !port.ends_with(']') => (name, Some(port)),
        _ => (host, None),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn only_the_token_is_the_token() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        assert_eq!(one.text().len(), 2 * TOKEN_BYTES);
        assert!(one.is(one.text().as_bytes()));
        for text in ["", other.text(), &one.text()[1..], &format!("{}0", one.text())] {
            assert!(!one.is(text.as_bytes()), "{text}");
        }
        assert!(!format!("{one:?}").contains(one.text()));
    }

    #[test]
    fn a_server_on_loopback_has_loopback_names_only() {
        let names = Names::new("127.0.0.1:8790".parse().unwrap());
        for host in ["127.0.0.1:8790", "localhost:8790", "LOCALHOST:8790", "[::1]:8790", "localhost", "[::1]"] {
            assert!(names.is_host(host), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "127.0.0.1:80",
            "evil.example:8790",
            "localhost.evil.example:8790",
            "192.168.1.5:8790",
            "127.0.0.1:8790.evil.example",
            "127.0.0.1:",
            "::1",
            "127.0.0.1:8790 ",
            "a@127.0.0.1:8790",
        ] {
            assert!(!names.is_host(host), "{host}");
        }
        assert!(names.is_origin("http://localhost:8790"));
        for origin in [
            "null",
            "https://localhost:8790",
            "http://localhost",
            "http://evil.example",
            "http://localhost:8791",
            "localhost:8790",
            "",
        ] {
            assert!(!names.is_origin(origin), "{origin}");
        }
    }

    #[test]
    fn a_server_on_all_addresses_has_addresses_but_no_names() {
        let names = Names::new("0.0.0.0:8790".parse().unwrap());
        assert!(names.is_host("192.168.1.5:8790") && names.is_host("localhost:8790"));
        assert!(!names.is_host("printer.local:8790"));
        let names = Names::new("192.168.1.5:80".parse().unwrap());
        assert!(names.is_host("192.168.1.5") && !names.is_host("192.168.1.6"));
        assert!(names.is_origin("http://192.168.1.5"));
    }

    #[test]
    fn a_key_can_be_sent_in_a_header() {
        assert!(Token::chosen("correct-horse").unwrap().is(b"correct-horse"));
        for key in ["", "short", "with a space", "line\nbreak", "sch\u{fc}ssel-lang", &"k".repeat(129)] {
            assert!(Token::chosen(key).is_err(), "{key}");
        }
    }
}
