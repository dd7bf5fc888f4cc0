//! Images made by other programs, and a printer's side of the mailbox.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::io::Read;
use std::path::Path;

use ferrostep_card::{
    Answer, CardFailure, CardPort, ListFrom, ListOptions, LocalCard, LongPath, OpenedFile, Put, Request, Taken,
};
use ferrostep_virtual_board::VirtualCard;

pub type Card = LocalCard<VirtualCard<Vec<u8>>>;

pub const IMAGES: [&str; 2] = ["fat16", "fat32"];

pub fn image(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/images/{name}.img.gz"));
    let mut image = Vec::new();
    flate2::read::GzDecoder::new(std::fs::File::open(path).unwrap()).read_to_end(&mut image).unwrap();
    image
}

pub fn ask(card: &Card, request: Request) -> Result<Answer, CardFailure> {
    card.with(&mut |mailbox| mailbox.ask(request.clone()));
    let mut answer = None;
    card.with(&mut |mailbox| answer = mailbox.take_answer());
    answer.expect("the task has run")
}

pub fn path(text: &str) -> LongPath {
    LongPath::try_from(text).unwrap()
}

pub fn mounted(name: &str) -> Card {
    let card = Card::new(VirtualCard::new(image(name)));
    assert_eq!(ask(&card, Request::Mount), Ok(Answer::Done));
    card
}

/// Returns all lines of the list.
pub fn list(card: &Card, options: ListOptions) -> Result<Vec<String>, CardFailure> {
    let mut lines = Vec::new();
    let mut from = ListFrom::Start;
    loop {
        let Answer::Page { more } = ask(card, Request::List(options, from))? else { panic!("a page") };
        card.with(&mut |mailbox| lines.extend(mailbox.page().lines().map(str::to_string)));
        if !more {
            return Ok(lines);
        }
        from = ListFrom::Next;
    }
}

/// The open file.
pub fn opened(card: &Card) -> OpenedFile {
    let mut opened = None;
    card.with(&mut |mailbox| opened = mailbox.opened().cloned());
    opened.unwrap()
}

/// Reads to the end.
pub fn take_all(card: &Card) -> Result<Vec<u8>, CardFailure> {
    let mut bytes = Vec::new();
    take_rest(card, &mut bytes).map(|()| bytes)
}

/// Reads to the end, or up to a failure.
pub fn take_rest(card: &Card, bytes: &mut Vec<u8>) -> Result<(), CardFailure> {
    let mut chunk = [0; 100];
    loop {
        let mut taken = Taken::Wait;
        card.with(&mut |mailbox| taken = mailbox.take(&mut chunk));
        match taken {
            Taken::Bytes(length) => bytes.extend(&chunk[..length]),
            Taken::Wait => {}
            Taken::End => return Ok(()),
            Taken::Failed(failure) => return Err(failure),
        }
    }
}

pub fn read(card: &Card, file: &str) -> Result<Vec<u8>, CardFailure> {
    ask(card, Request::Open(path(file)))?;
    take_all(card)
}

pub fn write(card: &Card, file: &str, mut bytes: &[u8]) -> Result<(), CardFailure> {
    ask(card, Request::Create(path(file)))?;
    while !bytes.is_empty() {
        let mut put = Put::Wait;
        card.with(&mut |mailbox| put = mailbox.put(&bytes[..bytes.len().min(77)]));
        match put {
            Put::Bytes(length) => bytes = &bytes[length..],
            Put::Wait => {}
            Put::Failed(failure) => return Err(failure),
        }
    }
    ask(card, Request::Finish).map(|_| ())
}

/// Content of the long files that `make.sh` writes.
pub fn lines_file() -> Vec<u8> {
    (1..=400).flat_map(|number| format!("G1 X{number} Y10 F3000\n").into_bytes()).collect()
}

/// SplitMix64: the same numbers for the same seed.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    }

    pub fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }
}
