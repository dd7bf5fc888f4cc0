//! Tests clients that are slow, too many, or connected twice.
#![allow(clippy::unwrap_used)]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Mutex;
use std::time::Duration;

use ferrostep_web::{Activity, ConsoleLine, Control, Limits, Printer, Refusal, Server, State, Upload};

/// Printer that records the lines and files it receives.
#[derive(Default)]
struct Noting(Mutex<Vec<String>>);

impl Noting {
    fn note(&self, what: &str) -> Result<(), Refusal> {
        self.0.lock().unwrap().push(what.to_owned());
        Ok(())
    }
}

impl Printer for &'static Noting {
    fn state(&self) -> State {
        let machine = self.0.lock().unwrap().join(",");
        State {
            machine,
            activity: Activity::Idle,
            owner: None,
            heat: None,
            position_mm: None,
            job: None,
            message: None,
        }
    }

    fn console(&self, _: u64) -> Vec<ConsoleLine> {
        Vec::new()
    }

    fn send_line(&self, line: &str) -> Result<(), Refusal> {
        self.note(line)
    }

    fn control(&self, control: Control) -> Result<(), Refusal> {
        self.note(&control.lines().join(";"))
    }

    fn may_upload(&self) -> Result<(), Refusal> {
        Ok(())
    }

    fn upload(&self, upload: Upload) -> Result<(), Refusal> {
        self.note(&format!("{} {}", upload.name, upload.bytes))
    }

    fn start(&self) -> Result<(), Refusal> {
        self.note("start")
    }

    fn pause(&self) -> Result<(), Refusal> {
        self.note("pause")
    }

    fn resume(&self) -> Result<(), Refusal> {
        self.note("resume")
    }

    fn cancel(&self) -> Result<(), Refusal> {
        self.note("cancel")
    }

    fn stop(&self) -> Result<(), Refusal> {
        Err(Refusal("the line is not open".to_owned()))
    }
}

const SHORT: Limits = Limits {
    connections: 3,
    upload_bytes: 1000,
    request: Duration::from_millis(300),
    upload: Duration::from_millis(300),
};

fn serve(limits: Limits) -> (Server, &'static Noting) {
    let printer: &'static Noting = Box::leak(Box::default());
    (Server::start("127.0.0.1:0".parse().unwrap(), printer, limits, None).unwrap(), printer)
}

/// Reads the whole answer; empty if the connection is closed without one.
fn heard(mut stream: TcpStream) -> String {
    let mut answer = Vec::new();
    // A connection that is closed at once may be reset.
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8(answer).unwrap()
}

fn ask(address: SocketAddr, request: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    let _ = stream.write_all(request.as_bytes());
    heard(stream)
}

fn head(server: &Server, method: &str, path: &str, length: usize) -> String {
    let token = server.url().split_once('#').unwrap().1.to_owned();
    format!(
        "{method} {path} HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {token}\r\nContent-Length: {length}\r\n\r\n",
        server.address()
    )
}

#[test]
fn what_is_whole_arrives() {
    let (server, printer) = serve(Limits::default());
    let at = server.address();
    assert!(ask(at, &(head(&server, "POST", "/line", 4) + "M105")).starts_with("HTTP/1.1 200"));
    assert!(ask(at, &(head(&server, "POST", "/job", 4) + "G28\n")).starts_with("HTTP/1.1 200"));
    for path in ["/start", "/pause", "/resume", "/cancel"] {
        assert!(ask(at, &head(&server, "POST", path, 0)).starts_with("HTTP/1.1 200"), "{path}");
    }
    let refused = ask(at, &head(&server, "POST", "/stop", 0));
    assert!(refused.starts_with("HTTP/1.1 409") && refused.contains("the line is not open"), "{refused}");
    assert_eq!(*printer.0.lock().unwrap(), ["M105", "unnamed 4", "start", "pause", "resume", "cancel"]);
    assert!(ask(at, &head(&server, "GET", "/state?after=3", 0)).contains(r#""machine":"M105,unnamed 4"#));
}

#[test]
fn slow_clients_are_dropped() {
    let (server, printer) = serve(SHORT);
    let at = server.address();
    assert_eq!(ask(at, ""), "", "nothing at all");
    assert!(ask(at, "GET / HTTP/1.1\r\nHos").starts_with("HTTP/1.1 408"));
    assert!(ask(at, &(head(&server, "POST", "/line", 10) + "M105")).starts_with("HTTP/1.1 408"));
    assert!(ask(at, &(head(&server, "POST", "/job", 10) + "G28\n")).starts_with("HTTP/1.1 408"));
    assert!(printer.0.lock().unwrap().is_empty());
}

#[test]
fn sizes_have_limits() {
    let (server, printer) = serve(SHORT);
    let at = server.address();
    assert!(ask(at, &(head(&server, "POST", "/line", 300) + &"M".repeat(300))).starts_with("HTTP/1.1 413"));
    assert!(ask(at, &(head(&server, "POST", "/job", 1001) + &"M".repeat(1001))).starts_with("HTTP/1.1 413"));
    assert!(ask(at, &head(&server, "POST", "/job", 0)).starts_with("HTTP/1.1 400"));
    assert!(ask(at, &head(&server, "POST", "/job", usize::MAX)).starts_with("HTTP/1.1 413"));
    assert!(printer.0.lock().unwrap().is_empty());
}

/// Connections beyond the limit are closed; silent clients lose their places.
#[test]
fn places_are_limited_and_come_back() {
    // Long enough for a busy computer to open the connections.
    let (server, _) = serve(Limits { request: Duration::from_secs(3), ..SHORT });
    let at = server.address();
    let silent: Vec<TcpStream> = (0..SHORT.connections).map(|_| TcpStream::connect(at).unwrap()).collect();
    assert_eq!(ask(at, &head(&server, "GET", "/state", 0)), "");
    for stream in silent {
        assert_eq!(heard(stream), "");
    }
    // The thread of the last one may still hold its place for a moment.
    let has_place = |_: &usize| ask(at, &head(&server, "GET", "/state", 0)).starts_with("HTTP/1.1 200");
    assert!((0..10_000).any(|attempt| has_place(&attempt)));
}

#[test]
fn one_file_comes_at_a_time() {
    let (server, printer) = serve(Limits::default());
    let at = server.address();
    let mut slow = TcpStream::connect(at).unwrap();
    // Once the server asks for the body, it has begun to receive it.
    let wait = head(&server, "POST", "/job", 4).replace("\r\n\r\n", "\r\nExpect: 100-continue\r\n\r\n");
    slow.write_all(wait.as_bytes()).unwrap();
    let mut go_on = [0; 25];
    slow.read_exact(&mut go_on).unwrap();
    assert_eq!(&go_on, b"HTTP/1.1 100 Continue\r\n\r\n");
    assert!(ask(at, &(head(&server, "POST", "/job", 4) + "G28\n")).starts_with("HTTP/1.1 409"));
    slow.write_all(b"G28\n").unwrap();
    assert!(heard(slow).starts_with("HTTP/1.1 200"));
    assert_eq!(printer.0.lock().unwrap().len(), 1);
}

#[test]
fn a_server_that_ends_gives_its_port_back() {
    let (server, _) = serve(Limits::default());
    let at = server.address();
    drop(server);
    assert!(TcpStream::connect(at).is_err());
}
