//! Each board's files: their form and content, as its boot loader or a programmer expects them.

use std::path::Path;

use ferrostep_testkit::boards::{BOARDS, BoardFacts};
use object::{Object, ObjectSection, ObjectSymbol};

use crate::firmware::image::image_of;

/// RAM that every board has.
const RAM: std::ops::Range<u32> = 0x2000_0000..0x2002_0000;

/// The highest interrupt that the firmware uses is TIM5's, 50.
const LAST_USED_INTERRUPT: usize = 50;

fn word(bytes: &[u8], offset: usize) -> u32 {
    u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap())
}

fn flash_of(board: &BoardFacts) -> std::ops::Range<u32> {
    board.image_address..board.flash_end
}

fn read(image: &Path, name: &str) -> Vec<u8> {
    let path = image.with_file_name(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn the_vector_table_is_where_the_boot_loader_jumps() {
    for board in &BOARDS {
        let elf = std::fs::read(image_of(board.name)).unwrap();
        let file = object::File::parse(&*elf).unwrap();
        let table = file.section_by_name(".vector_table").unwrap();
        assert_eq!(table.address(), u64::from(board.image_address), "{}", board.name);
        // VTOR has no bits for less than the table's size, rounded up to a power of two.
        assert!(table.address().is_multiple_of(table.size().next_power_of_two()), "{}", board.name);
        let words = table.data().unwrap();
        let stack = word(words, 0);
        assert!(RAM.contains(&(stack - 4)) && stack.is_multiple_of(8), "{}: stack {stack:#x}", board.name);
        let text = file.section_by_name(".text").unwrap();
        let text = text.address() as u32..(text.address() + text.size()) as u32;
        let mut handlers = 0;
        for entry in 1..words.len() / 4 {
            let handler = word(words, 4 * entry);
            // Reserved entries are 0; bit 0 of all others says Thumb.
            if handler != 0 {
                assert!(handler & 1 == 1 && text.contains(&handler), "{}: vector {entry} {handler:#x}", board.name);
                handlers += 1;
            }
        }
        assert!(words.len() / 4 > 16 + LAST_USED_INTERRUPT && handlers > LAST_USED_INTERRUPT, "{}", board.name);
    }
}

#[test]
fn everything_fits_the_boards_memory() {
    for board in &BOARDS {
        let elf = std::fs::read(image_of(board.name)).unwrap();
        let file = object::File::parse(&*elf).unwrap();
        let (mut in_flash, mut in_ram) = (0, 0);
        for section in file.sections().filter(|section| section.size() > 0) {
            let object::SectionFlags::Elf { sh_flags, .. } = section.flags() else { panic!("no ELF file") };
            if sh_flags.0 & object::elf::SHF_ALLOC.0 == 0 {
                continue;
            }
            let (start, last) = (section.address() as u32, (section.address() + section.size() - 1) as u32);
            let contains = |memory: &std::ops::Range<u32>| memory.contains(&start) && memory.contains(&last);
            match (contains(&flash_of(board)), contains(&RAM)) {
                (true, false) => in_flash += section.size(),
                (false, true) => in_ram += section.size(),
                _ => panic!("{}: {} at {start:#x} to {last:#x}", board.name, section.name().unwrap()),
            }
        }
        // The smallest flash holds the image, and three twentieths of the smaller RAM are free; 23
        // KiB of RAM more are the stack's.
        assert!((100_000..=480 * 1024).contains(&in_flash), "{}: {in_flash} bytes of flash", board.name);
        assert!((30_000..=128 * 1024 * 17 / 20 - 23 * 1024).contains(&in_ram), "{}: {in_ram} bytes of RAM", board.name);
    }
}

#[test]
fn the_pll_makes_168_mhz_and_48_mhz_from_the_crystal() {
    for board in &BOARDS {
        let elf = std::fs::read(image_of(board.name)).unwrap();
        let file = object::File::parse(&*elf).unwrap();
        let symbol = file.symbols().find(|symbol| symbol.name() == Ok("FERROSTEP_PLL")).unwrap();
        let section = file.section_by_index(symbol.section_index().unwrap()).unwrap();
        let offset = (symbol.address() - section.address()) as usize;
        let words = section.data().unwrap();
        for (index, input_mhz) in [(0, board.crystal_mhz), (1, 16)] {
            let register = word(words, offset + 4 * index);
            // RM0090 7.3.2 and RM0390 6.3.2.
            let (m, n) = (register & 0x3f, register >> 6 & 0x1ff);
            let (p, q) = (2 * (register >> 16 & 0b11) + 2, register >> 24 & 0xf);
            assert_eq!(register >> 22 & 1 == 1, index == 0, "{}: the source", board.name);
            assert_eq!(input_mhz * n, 168 * m * p, "{}: core", board.name);
            assert_eq!(input_mhz * n, 48 * m * q, "{}: USB", board.name);
            assert!((m..=2 * m).contains(&input_mhz), "{}: the PLL's input", board.name);
            assert!((100 * m..=432 * m).contains(&(input_mhz * n)), "{}: the PLL's output", board.name);
        }
    }
}

/// The bytes of an Intel HEX file and the address of the first.
fn bytes_of_hex(text: &str) -> (u32, Vec<u8>) {
    let (mut start, mut upper, mut bytes) = (None, 0, Vec::new());
    for line in text.lines() {
        let digits = line.strip_prefix(':').unwrap();
        let record: Vec<u8> =
            (0..digits.len()).step_by(2).map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap()).collect();
        assert_eq!(record.iter().copied().fold(0, u8::wrapping_add), 0, "the sum of {line}");
        let data = &record[4..record.len() - 1];
        match record[3] {
            0 => {
                let address = upper + u32::from(u16::from_be_bytes([record[1], record[2]]));
                let start = *start.get_or_insert(address);
                assert_eq!(address, start + bytes.len() as u32, "a gap");
                bytes.extend_from_slice(data);
            }
            1 => return (start.unwrap(), bytes),
            4 => upper = u32::from(u16::from_be_bytes([data[0], data[1]])) << 16,
            other => panic!("record {other}"),
        }
    }
    panic!("no end")
}

#[test]
fn all_files_of_a_board_hold_the_same_bytes() {
    for board in &BOARDS {
        let image = image_of(board.name);
        let bytes = read(&image, board.bytes_file);
        let (address, of_hex) = bytes_of_hex(&String::from_utf8(read(&image, "ferrostep.hex")).unwrap());
        assert_eq!(address, board.image_address, "{}", board.name);
        assert!(of_hex == bytes, "{}: the two files differ", board.name);
        let elf = std::fs::read(&image).unwrap();
        let file = object::File::parse(&*elf).unwrap();
        for name in [".vector_table", ".text", ".rodata"] {
            let section = file.section_by_name(name).unwrap();
            let offset = (section.address() - u64::from(address)) as usize;
            let data = section.data().unwrap();
            assert!(bytes[offset..offset + data.len()] == *data, "{}: {name} differs", board.name);
        }
        // No files of another build, which might be flashed by mistake.
        let mut names: Vec<String> = std::fs::read_dir(image.parent().unwrap())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        let mut expected: Vec<&str> =
            [board.bytes_file, "ferrostep.elf", "ferrostep.hex"].into_iter().chain(board.container).collect();
        expected.sort_unstable();
        assert_eq!(names, expected, "{}", board.name);
    }
}

/// A signature of 64 bytes, the SHA-256 of the rest, a header with the image's length first, and
/// the image. It begins where the boot loader has written hash and header to the beginning of a
/// flash sector (Prusa-Firmware-Buddy, `utils/unpack_bbf.py`).
#[test]
fn the_container_holds_the_same_bytes_for_their_link_address() {
    for (board, name) in BOARDS.iter().filter_map(|board| Some((board, board.container?))) {
        let image = image_of(board.name);
        let (file, bytes) = (read(&image, name), read(&image, board.bytes_file));
        assert_eq!(word(&file, 96) as usize, bytes.len(), "{}", board.name);
        assert!(file[576..] == bytes, "{}: the two files differ", board.name);
        let sector = board.image_address - (576 - 64);
        assert!(sector.is_multiple_of(0x2_0000) && sector > 0x0800_0000, "{}: {sector:#x}", board.name);
        // The MINI, and the format's first version.
        assert_eq!(file[111..113], [2, 1], "{}", board.name);
    }
}

/// Version, board and profile in an image, as `strings` shows them without running it; M115 says
/// the same version.
#[test]
fn the_image_names_its_version_board_and_profile() {
    for board in &BOARDS {
        let bytes = read(&image_of(board.name), board.bytes_file);
        let start = bytes.windows(10).position(|window| window == b"ferrostep ").unwrap();
        let text: String = bytes[start..]
            .iter()
            .take_while(|byte| (b' '..=b'~').contains(byte))
            .map(|&byte| char::from(byte))
            .collect();
        let rest = text.strip_prefix(concat!("ferrostep ", env!("CARGO_PKG_VERSION"), " (commit ")).unwrap();
        let (commit, rest) = rest.split_once(") ").unwrap();
        let is_commit = |commit: &str| commit.len() >= 7 && commit.bytes().all(|byte| byte.is_ascii_hexdigit());
        assert!(commit == "unknown" || is_commit(commit.trim_end_matches("-dirty")), "{}: {text}", board.name);
        assert_eq!(rest, format!("{} {}", board.name, board.profile));
    }
}
