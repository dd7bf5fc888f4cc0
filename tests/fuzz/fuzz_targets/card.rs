//! A memory card with bytes changed at will: whatever it holds, every task ends within its budget,
//! and none panics.
#![no_main]

use std::io::Read;
use std::sync::OnceLock;

use ferrostep_card::{Answer, CardFailure, CardPort, ListFrom, ListOptions, LocalCard, Put, Request, Taken};
use ferrostep_virtual_board::VirtualCard;
use libfuzzer_sys::fuzz_target;

type Card = LocalCard<VirtualCard<Vec<u8>>>;

/// Blocks that a task may read and write: those of the longest list.
const MAX_ACCESSES: u64 = 65_536 + 10_000;

fn sound() -> &'static [u8] {
    static IMAGE: OnceLock<Vec<u8>> = OnceLock::new();
    IMAGE.get_or_init(|| {
        let mut image = Vec::new();
        let packed = include_bytes!("../../../printer/card/tests/images/fat16.img.gz");
        flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut image).unwrap();
        image
    })
}

fn ask(card: &Card, request: Request) -> Result<Answer, CardFailure> {
    let before = card.with_slot(VirtualCard::accesses);
    card.with(&mut |mailbox| mailbox.ask(request.clone()));
    let mut answer = None;
    card.with(&mut |mailbox| answer = mailbox.take_answer());
    assert!(card.with_slot(VirtualCard::accesses) - before < MAX_ACCESSES);
    answer.expect("the task has run")
}

fn list(card: &Card) {
    let options = ListOptions { long: true, time: true };
    let mut page = ask(card, Request::List(options, ListFrom::Start));
    for _ in 0..5000 {
        if !matches!(page, Ok(Answer::Page { more: true })) {
            return;
        }
        page = ask(card, Request::List(options, ListFrom::Next));
    }
    panic!("the list does not end");
}

fn read(card: &Card, path: &str) {
    if ask(card, Request::Open(path.try_into().unwrap())).is_err() {
        return;
    }
    let mut chunk = [0; 512];
    for _ in 0..20_000 {
        let mut taken = Taken::End;
        card.with(&mut |mailbox| taken = mailbox.take(&mut chunk));
        if matches!(taken, Taken::End | Taken::Failed(_)) {
            return;
        }
    }
    panic!("the file does not end");
}

// Four bytes are a change: the place among the first 512 KiB, and the new byte.
fuzz_target!(|bytes: &[u8]| {
    let mut image = sound().to_vec();
    for change in bytes.chunks_exact(4) {
        let place = usize::from(change[0]) | usize::from(change[1]) << 8 | usize::from(change[2] & 7) << 16;
        if let Some(byte) = image.get_mut(place) {
            *byte = change[3];
        }
    }
    let card = Card::new(VirtualCard::new(image));
    let _ = ask(&card, Request::Mount);
    list(&card);
    for path in ["PARTS/DEEP/TWO.GCO", "Parts of the machine/Left side/Bracket, thick.gcode", "MANY/GAPS.GCO"] {
        read(&card, path);
    }
    let _ = ask(&card, Request::Delete("MANY/GAPS.GCO".try_into().unwrap()));
    if ask(&card, Request::Create("PARTS/NEW.GCO".try_into().unwrap())).is_ok() {
        let mut put = Put::Wait;
        for _ in 0..8 {
            card.with(&mut |mailbox| put = mailbox.put(&[b'x'; 300]));
        }
        let _ = ask(&card, Request::Finish);
    }
    let _ = ask(&card, Request::Release);
});
