#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fs::OpenOptions;
use std::time::{Duration, Instant};

use super::*;

fn path(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("ferrostep-host-line-{name}-{}", std::process::id()))
}

/// Reads until this many bytes have arrived, at most 5 s.
fn read_all(line: &mut Line, count: usize) -> Vec<u8> {
    let end = Instant::now() + Duration::from_secs(5);
    let mut bytes = Vec::new();
    while bytes.len() < count && Instant::now() < end {
        bytes.extend(line.read(MAX_READ).unwrap());
        std::thread::sleep(Duration::from_millis(1));
    }
    bytes
}

fn becomes(line: &mut Line, connected: bool) -> bool {
    let end = Instant::now() + Duration::from_secs(5);
    while line.connected() != connected && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(1));
    }
    line.connected() == connected
}

#[test]
fn a_terminal_passes_bytes_unchanged() {
    let link = path("raw");
    let mut line = Line::pty(&link).unwrap();
    assert_eq!(line.address(), link.display().to_string());
    line.write(b"start\n").unwrap();
    let mut host = OpenOptions::new().read(true).write(true).open(&link).unwrap();
    let mut heard = [0; 6];
    host.read_exact(&mut heard).unwrap();
    assert_eq!(&heard, b"start\n", "no carriage return is added");
    let all: Vec<u8> = (0..=255).collect();
    host.write_all(&all).unwrap();
    assert_eq!(read_all(&mut line, 256), all);
    assert!(line.read(MAX_READ).unwrap().is_empty(), "the terminal echoes nothing and does not block");
    assert!(line.connected());
    drop(host);
    assert!(becomes(&mut line, false));
    assert!(line.read(MAX_READ).unwrap().is_empty());
    line.write(b"unread\n").unwrap();
    let _host = OpenOptions::new().read(true).write(true).open(&link).unwrap();
    assert!(becomes(&mut line, true), "the next host finds it again");
    drop(line);
    assert!(std::fs::symlink_metadata(&link).is_err(), "the link is removed");
}

#[test]
fn a_path_in_use_is_refused_by_name_and_a_stale_link_is_replaced() {
    let link = path("used");
    let line = Line::pty(&link).unwrap();
    let refusal = Line::pty(&link).unwrap_err();
    assert!(refusal.contains(&link.display().to_string()) && refusal.contains("in use"), "{refusal}");
    drop(line);
    std::os::unix::fs::symlink("/nowhere/pts", &link).unwrap();
    drop(Line::pty(&link).unwrap());
    let refusal = Line::pty(Path::new("/nowhere/line")).unwrap_err();
    assert!(refusal.contains("/nowhere/line"), "{refusal}");
}

#[test]
fn an_unread_terminal_keeps_the_latest_bytes() {
    let link = path("full");
    let mut line = Line::pty(&link).unwrap();
    for _ in 0..64 {
        line.write(&[b'x'; 4096]).unwrap();
    }
    assert!(line.dropped_bytes() > 0 && line.waiting.len() <= MAX_WAITING);
}

#[test]
fn tcp_serves_one_host_at_a_time() {
    let mut line = Line::tcp(0).unwrap();
    line.write(b"lost").unwrap();
    assert_eq!(line.dropped_bytes(), 4);
    for _ in 0..2 {
        let mut host = TcpStream::connect(line.address()).unwrap();
        assert!(becomes(&mut line, true));
        line.write(b"ok\n").unwrap();
        let mut heard = [0; 3];
        host.read_exact(&mut heard).unwrap();
        assert_eq!(&heard, b"ok\n");
        host.write_all(b"M105\n").unwrap();
        assert_eq!(read_all(&mut line, 5), b"M105\n");
        drop(host);
        assert!(read_all(&mut line, 0).is_empty());
        let end = Instant::now() + Duration::from_secs(5);
        while line.connected() && Instant::now() < end {
            assert!(line.read(MAX_READ).unwrap().is_empty());
        }
        assert!(!line.connected());
    }
}

#[test]
fn a_port_in_use_is_refused_by_number() {
    let line = Line::tcp(0).unwrap();
    let port: u16 = line.address().rsplit(':').next().unwrap().parse().unwrap();
    let refusal = Line::tcp(port).unwrap_err();
    assert!(refusal.contains(&port.to_string()) && refusal.contains("in use"), "{refusal}");
}
