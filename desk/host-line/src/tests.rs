#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fs::OpenOptions;
use std::time::{Duration, Instant};

use super::*;

fn path(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("ferrostep-host-line-{name}-{}", std::process::id()))
}

/// Maximum wait for anything: only a fault takes that long.
const PATIENCE: Duration = Duration::from_secs(60);

/// Polls until the condition holds.
#[track_caller]
fn wait_until(mut is_there: impl FnMut() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !is_there() {
        assert!(Instant::now() < end, "it does not come");
        std::thread::yield_now();
    }
}

/// Reads until this many bytes have arrived.
#[track_caller]
fn read_all(line: &mut Line, count: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    wait_until(|| {
        bytes.extend(line.read(MAX_READ).unwrap());
        bytes.len() >= count
    });
    bytes
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
    assert!(!line.take_departure());
    drop(host);
    wait_until(|| !line.connected());
    assert!(line.take_departure() && !line.take_departure());
    assert!(line.read(MAX_READ).unwrap().is_empty());
    line.write(b"unread\n").unwrap();
    let _host = OpenOptions::new().read(true).write(true).open(&link).unwrap();
    // The next host can open the terminal again.
    wait_until(|| line.connected());
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
        wait_until(|| line.connected());
        line.write(b"ok\n").unwrap();
        let mut heard = [0; 3];
        host.read_exact(&mut heard).unwrap();
        assert_eq!(&heard, b"ok\n");
        host.write_all(b"M105\n").unwrap();
        assert_eq!(read_all(&mut line, 5), b"M105\n");
        assert!(!line.take_departure());
        drop(host);
        wait_until(|| {
            assert!(line.read(MAX_READ).unwrap().is_empty());
            !line.connected()
        });
        assert!(line.take_departure() && !line.take_departure());
    }
}

/// A new host that connects at once does not hide that the previous one has left.
#[test]
fn the_next_tcp_host_is_told_from_the_one_before() {
    let mut line = Line::tcp(0).unwrap();
    let mut first = TcpStream::connect(line.address()).unwrap();
    first.write_all(b"half").unwrap();
    assert_eq!(read_all(&mut line, 4), b"half");
    drop(first);
    let mut next = TcpStream::connect(line.address()).unwrap();
    next.write_all(b"next").unwrap();
    let mut bytes = Vec::new();
    wait_until(|| {
        bytes.extend(line.read(MAX_READ).unwrap());
        assert!(bytes.is_empty() || line.has_departed);
        bytes.len() == 4
    });
    assert_eq!(bytes, b"next");
}

#[test]
fn a_port_in_use_is_refused_by_number() {
    let line = Line::tcp(0).unwrap();
    let port: u16 = line.address().rsplit(':').next().unwrap().parse().unwrap();
    let refusal = Line::tcp(port).unwrap_err();
    assert!(refusal.contains(&port.to_string()) && refusal.contains("in use"), "{refusal}");
}

#[test]
fn a_host_within_the_program_speaks_and_goes() {
    let (mut line, mut host) = Line::pair().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut beside = Line::pty(&folder.path().join("port")).unwrap();
    // A terminal whose host has left does not hide another line's data.
    drop(std::fs::OpenOptions::new().read(true).write(true).open(beside.address()).unwrap());
    wait_until(|| !beside.connected());
    host.write_all(b"M105\n").unwrap();
    Line::wait_any(&[&beside, &line], PATIENCE);
    assert_eq!(line.read(MAX_READ).unwrap(), b"M105\n");
    line.write(b"ok\n").unwrap();
    let mut heard = [0; 3];
    host.read_exact(&mut heard).unwrap();
    assert_eq!((&heard, line.connected()), (b"ok\n", true));
    drop(host);
    assert!(line.read(MAX_READ).unwrap().is_empty());
    assert!(line.take_departure() && !line.connected());
    line.write(b"start\n").unwrap();
    assert_eq!(line.waiting(), 0);
}
