//! `ferrostep serve --web`: the page in front of the virtual board, or of a printer at a port.

use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use ferrostep_host::printer_line::{Address, PrinterLine};
use ferrostep_host_line::Line;
use ferrostep_printer::Profile;
use ferrostep_session::page_host::{self, PageHost, PageSide, Readings, Setup};
use ferrostep_session::serve::{PageLine, State, Status};
use ferrostep_web::{Heat, Limits, Server};

use crate::arguments::ServeArguments;
use crate::terminal::tell;

fn start(arguments: &ServeArguments, address: SocketAddr, host: &Arc<PageHost>) -> Result<Server, String> {
    let limits = Limits { upload_bytes: arguments.web_upload.saturating_mul(1024 * 1024), ..Limits::default() };
    Server::start(address, PageSide(Arc::clone(host)), limits, arguments.key.clone())
}

fn announce(server: &Server, has_key: bool) {
    tell(format_args!("page: {}", server.url()));
    let key = if has_key { "with the key of --key" } else { "without a key, from this computer only (others: --key)" };
    tell(format_args!("slicers: host type OctoPrint, address http://{}, {key}", server.address()));
    if server.address().ip().is_unspecified() {
        tell(format_args!(
            "note: at other computers, write this computer's address in place of {}",
            server.address().ip()
        ));
    }
    if !server.address().ip().is_loopback() {
        tell(
            "note: other computers reach this page, and its token crosses the network readable: whoever reads it controls the printer",
        );
    }
}

/// The page in front of a printer at a port. It returns when the program is to end.
///
/// # Errors
/// The page's address cannot be opened. A port that cannot be opened is tried again, and
/// the page says so.
pub fn before_a_port(
    arguments: &ServeArguments,
    address: SocketAddr,
    port: &Address,
    profile: Profile,
    ends: &Arc<AtomicBool>,
) -> Result<ExitCode, String> {
    let setup = Setup { machine: format!("Printer at {port}"), profile, readings: Readings::Asked, outside: None };
    let host = PageHost::new(setup);
    let server = start(arguments, address, &host)?;
    tell(format_args!("page in front of {port}; Ctrl-C ends it"));
    announce(&server, arguments.key.is_some());
    let connect = || PrinterLine::open(port, arguments.baud).map_err(|error| format!("{port}: {error}; trying again"));
    page_host::run(&host, connect, || ends.load(Ordering::Relaxed));
    host.forget_job();
    if let Some(message) = host.message() {
        tell(message);
    }
    Ok(ExitCode::SUCCESS)
}

/// The page in front of the virtual board.
pub struct VirtualPage {
    host: Arc<PageHost>,
    server: Option<Server>,
    has_key: bool,
    driver: Option<JoinHandle<()>>,
    ends: Arc<AtomicBool>,
}

impl VirtualPage {
    /// Opens the page, and its line to the board. The board's hosts besides it are at `outside`.
    ///
    /// # Errors
    /// The page's address or a line cannot be opened, or a thread cannot be started.
    pub fn open(
        arguments: &ServeArguments,
        address: SocketAddr,
        profile: Profile,
        outside: Option<String>,
        ends: &Arc<AtomicBool>,
    ) -> Result<(Self, PageLine), String> {
        let machine = format!("Virtual printer ({})", profile.name);
        let host = PageHost::new(Setup { machine, profile, readings: Readings::Told, outside });
        let server = start(arguments, address, &host)?;
        let (line, page_end) = Line::pair().map_err(|error| format!("no line for the page: {error}"))?;
        let input = page_end.try_clone().map_err(|error| format!("no line for the page: {error}"))?;
        let mut whole = Some(PrinterLine::over(input, page_end));
        let connect = move || whole.take().ok_or_else(|| "the virtual printer is switched off".to_owned());
        let (driven, ended) = (Arc::clone(&host), Arc::clone(ends));
        let driver = thread::Builder::new().name("page".to_owned());
        let driver = driver.spawn(move || page_host::run(&driven, connect, || ended.load(Ordering::Relaxed)));
        let driver = driver.map_err(|error| format!("no thread for the page: {error}"))?;
        let page_line = PageLine::new(line, host.ownership());
        let (server, driver) = (Some(server), Some(driver));
        let has_key = arguments.key.is_some();
        Ok((Self { host, server, has_key, driver, ends: Arc::clone(ends) }, page_line))
    }

    /// Address of the page.
    pub fn address(&self) -> String {
        self.server.as_ref().map_or_else(String::new, |server| server.address().to_string())
    }

    /// Prints the address for a person.
    pub fn announce(&self) {
        self.server.iter().for_each(|server| announce(server, self.has_key));
    }

    /// Shows the board's state.
    pub fn show(&self, status: &Status) {
        let heat = Heat {
            nozzle_celsius: status.temperatures.nozzle.into(),
            nozzle_target_celsius: status.temperatures.nozzle_target.into(),
            bed_celsius: status.temperatures.bed.into(),
            bed_target_celsius: status.temperatures.bed_target.into(),
            chamber_celsius: status.temperatures.chamber.map(|chamber| chamber.celsius.into()),
            chamber_target_celsius: status.temperatures.chamber.map(|chamber| chamber.target.into()),
        };
        self.host.tell(heat, status.position_mm, status.state == State::Halted);
    }
}

impl Drop for VirtualPage {
    fn drop(&mut self) {
        self.server = None;
        if let Some(driver) = self.driver.take() {
            self.ends.store(true, Ordering::Relaxed);
            // Its thread ends then; one that panicked has.
            let _ = driver.join();
        }
        self.host.forget_job();
    }
}
