use std::net::TcpListener;

use super::*;

/// An emulator with a script: each line is the expected packet of the debugger and the reply.
fn conversation(lines: &'static [(&'static str, &'static str)], folder: &Path, arguments: &str) -> Result<(), String> {
    converse(lines, folder, arguments).or_else(|broken| broken.at_end(false))
}

fn converse(lines: &'static [(&'static str, &'static str)], folder: &Path, arguments: &str) -> Result<(), Broken> {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::scope(|scope| {
        let emulator = scope.spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut heard = String::new();
            for (asked, answer) in lines {
                let wanted = packet(asked);
                while !heard.contains(&wanted) {
                    let mut byte = [0];
                    stream.read_exact(&mut byte).unwrap();
                    heard.push(char::from(byte[0]));
                }
                heard.clear();
                stream.write_all(format!("+{}", packet(answer)).as_bytes()).unwrap();
            }
        });
        let served = serve(address, folder, arguments, &[0x0800_0010, 0x0800_0020], HARD_FAULT);
        emulator.join().unwrap();
        served
    })
}

const HELLO: (&str, &str) = ("qSupported:swbreak+;hwbreak+", "PacketSize=1000");

/// The address of the hard fault handler, and the breakpoint there.
const HARD_FAULT: u64 = 0x0800_0100;
const AT_HARD_FAULT: (&str, &str) = ("Z1,8000100,2", "OK");

#[test]
fn a_packet_ends_with_its_checksum() {
    assert_eq!(packet(""), "$#00");
    assert_eq!(packet("OK"), "$OK#9a");
}

#[test]
fn a_file_is_opened_and_read() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a"), "hi").unwrap();
    let lines = &[
        HELLO,
        ("?", "S05"),
        AT_HARD_FAULT,
        ("c", "Fopen,20000000/2,0,1a4"),
        ("m20000000,1", "61"),
        ("F3", "Fread,3,20000100,10"),
        ("M20000100,2:6869", "OK"),
        ("F2", "Fread,3,20000100,10"),
        ("F0", "Flseek,3,0,0"),
        ("F-1,270f", "O6f"),
    ];
    // The unexpected last reply ends the connection.
    let error = conversation(lines, folder.path(), "").unwrap_err();
    assert!(error.contains("debugger"), "{error}");
}

#[test]
fn files_outside_the_folder_cannot_be_opened() {
    let lines = &[
        HELLO,
        ("?", "S05"),
        AT_HARD_FAULT,
        ("c", "Fopen,20000000/4,0,1a4"),
        ("m20000000,3", "2e2e2f"),
        ("F-1,2", "W00"),
    ];
    assert_eq!(conversation(lines, Path::new("/tmp"), ""), Ok(()));
}

#[test]
fn the_command_line_reaches_the_program() {
    let lines = &[
        HELLO,
        ("?", "S05"),
        AT_HARD_FAULT,
        ("Z1,8000010,2", "OK"),
        ("Z1,8000020,2", "OK"),
        // Another call, which the emulator handles.
        ("c", "T05hwbreak:;"),
        ("pf", "20000008"),
        ("p0", "05000000"),
        ("p1", "00010020"),
        ("c", "T05hwbreak:;"),
        ("pf", "10000008"),
        ("p0", "15000000"),
        ("p1", "00010020"),
        ("z1,8000010,2", "OK"),
        ("z1,8000020,2", "OK"),
        ("m20000100,8", "0002002050000000"),
        ("M20000200,4:72756e00", "OK"),
        ("M20000104,4:03000000", "OK"),
        ("P0=00000000", "OK"),
        ("Pf=12000008", "OK"),
        ("c", "W00"),
    ];
    assert_eq!(conversation(lines, Path::new("."), "run"), Ok(()));
}

#[test]
fn an_emulator_may_be_gone_at_the_end_of_the_program_and_not_before() {
    // It closes without the packet that says the end.
    let lines = &[HELLO, ("?", "S05"), AT_HARD_FAULT, ("c", "O6f")];
    let broken = || converse(lines, Path::new("."), "").unwrap_err();
    assert_eq!(broken().at_end(true), Ok(()));
    let error = broken().at_end(false).unwrap_err();
    assert!(error.contains("lost the emulator"), "{error}");
}

#[test]
fn a_connection_that_is_reset_is_not_a_fault_of_the_program() {
    let reset = || Broken::from(io::Error::from(io::ErrorKind::ConnectionReset));
    assert_eq!(reset().at_end(true), Ok(()));
    assert!(reset().at_end(false).is_err());
    assert!(Broken::from(unexpected("E01")).at_end(true).is_err());
}

#[test]
fn a_stop_outside_the_calls_is_an_error() {
    let lines =
        &[HELLO, ("?", "S05"), AT_HARD_FAULT, ("c", "S05"), ("pf", "40000008"), ("p0", "07000000"), ("p1", "00000000")];
    let error = conversation(lines, Path::new("."), "").unwrap_err();
    assert!(error.contains("0x08000040"), "{error}");
}

#[test]
fn a_hard_fault_is_an_error_with_its_place() {
    let lines = &[
        HELLO,
        ("?", "S05"),
        AT_HARD_FAULT,
        ("c", "T05hwbreak:;"),
        ("pf", "00010008"),
        ("pd", "00100020"),
        ("m20001018,4", "34120008"),
    ];
    let error = conversation(lines, Path::new("."), "").unwrap_err();
    assert!(error.contains("a hard fault at 0x08001234"), "{error}");
}

#[test]
fn the_hard_fault_handler_is_the_fourth_vector() {
    let table: &[u8] = &[0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 0x35, 0x12, 0, 8];
    assert_eq!(hard_fault(0x0800_8000, [(0x0800_8000, table)].into_iter()), Some(0x0800_1234));
    assert_eq!(hard_fault(0x0800_8000, [(0x0800_7ffc, table), (0x0800_8000, &table[..15])].into_iter()), None);
}

#[test]
fn calls_are_found_at_aligned_halfwords_only() {
    let bytes: &[u8] = &[0xab, 0xbe, 0, 0xab, 0xbe, 0, 0xab, 0xbe, 0xab];
    assert_eq!(calls([(0x0800_0000, bytes)].into_iter()), [0x0800_0000, 0x0800_0006]);
}
