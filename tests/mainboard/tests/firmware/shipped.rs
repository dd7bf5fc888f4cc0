//! The files for boot loaders and programmers: the board starts from them, and they
//! contain their version.

use ferrostep_testkit::boards::BOARDS;

use crate::firmware::bench::Bench;
use crate::firmware::foreign_code::{PROGRAM, STAND_STILL, load};
use crate::firmware::images::image_of;

/// The register with the address of the vector table (PM0214, 4.4.4).
const VTOR: u32 = 0xe000_ed08;

/// An unused word of RAM.
const FOUND: u32 = PROGRAM - 8;

/// `ldr r0, [r1]; str r0, [r2]`.
const COPY: [u16; 2] = [0x6808, 0x6010];

#[test]
fn the_plain_bytes_start_and_report_their_version() {
    for board in &BOARDS {
        let bytes = image_of(board.name).with_file_name(board.bytes_file);
        let content = std::fs::read(&bytes).unwrap();
        let start = content.windows(10).position(|window| window == b"ferrostep ").unwrap();
        let text: String =
            content[start..].iter().map(|&byte| char::from(byte)).take_while(|one| !one.is_control()).collect();
        let (version, rest) = text.strip_prefix("ferrostep ").unwrap().split_once(" (commit ").unwrap();
        let (commit, _) = rest.split_once(") ").unwrap();

        let mut bench = Bench::switch_on_from(board, &bytes);
        bench.host.connect().unwrap();
        let line = bench.host.ask("M115", "FIRMWARE_NAME").unwrap();
        let expected = format!("FIRMWARE_NAME:Ferrostep {version} (commit {commit}) PROTOCOL_VERSION:");
        assert!(line.starts_with(&expected), "{}: {line}", board.name);
    }
}

/// The core uses this image's vector table, whatever the boot loader's was.
#[test]
fn the_core_uses_the_image_s_own_vector_table() {
    for board in &BOARDS {
        let mut bench = Bench::boot_patched(board);
        bench.execute(&[&load(1, VTOR)[..], &load(2, FOUND), &COPY, &[STAND_STILL]].concat());
        assert_eq!(bench.word(FOUND), board.image_address, "{}", board.name);
    }
}
