//! Motor drivers on the emulator's second serial line, USART2: what the image sends comes back, and model chips reply.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;

use ferrostep_hal_shim::virtual_board::DriverChip;

/// Bytes of a datagram that asks, and of one that writes.
const LENGTHS: [usize; 2] = [4, 8];

/// Starts four chips, addresses 0 to 3, on a line that the emulator connects to; returns the port of it.
pub(super) fn start() -> io::Result<u16> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let port = listener.local_addr()?.port();
    // It ends with the emulator, or with this process.
    thread::spawn(move || listener.accept().and_then(|(line, _)| serve(line)));
    Ok(port)
}

fn serve(mut line: TcpStream) -> io::Result<()> {
    line.set_nodelay(true)?;
    let mut chips = [0, 1, 2, 3].map(DriverChip::new);
    let (mut heard, mut byte) = (Vec::new(), [0]);
    while line.read(&mut byte)? > 0 {
        line.write_all(&byte)?;
        heard.extend(byte);
        let writes = heard.get(2).is_some_and(|register| register & 0x80 != 0);
        if heard.len() == LENGTHS[usize::from(writes)] {
            for reply in chips.iter_mut().filter_map(|chip| chip.hear(&heard)) {
                line.write_all(&reply)?;
            }
            heard.clear();
        }
    }
    Ok(())
}
