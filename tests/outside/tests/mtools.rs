//! mtools reads what Ferrostep has written to a card, and fsck.fat finds the volume sound.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::io::Read;
use std::path::Path;
use std::process::{Command, Output};

use ferrostep_card::{Answer, CardFailure, CardPort, LocalCard, LongPath, Put, Request};
use ferrostep_testkit::program::{repository, scratch};
use ferrostep_virtual_board::VirtualCard;

type Card = LocalCard<VirtualCard<Vec<u8>>>;

/// The cards, and the starts of their volumes: mtools' name for them, and bytes.
const IMAGES: [(&str, &str, usize); 2] = [("fat16", "", 0), ("fat32", "@@1M", 1 << 20)];

fn ask(card: &Card, request: Request) -> Result<Answer, CardFailure> {
    card.with(&mut |mailbox| mailbox.ask(request.clone()));
    let mut answer = None;
    card.with(&mut |mailbox| answer = mailbox.take_answer());
    answer.expect("the task has run")
}

fn path(text: &str) -> LongPath {
    LongPath::try_from(text).unwrap()
}

fn mounted(name: &str) -> Card {
    let gz = std::fs::File::open(repository().join(format!("printer/card/tests/images/{name}.img.gz"))).unwrap();
    let mut image = Vec::new();
    flate2::read::GzDecoder::new(gz).read_to_end(&mut image).unwrap();
    let card = Card::new(VirtualCard::new(image));
    ask(&card, Request::Mount).unwrap();
    card
}

fn write(card: &Card, file: &str, mut bytes: &[u8]) {
    ask(card, Request::Create(path(file))).unwrap();
    while !bytes.is_empty() {
        let mut put = Put::Wait;
        card.with(&mut |mailbox| put = mailbox.put(&bytes[..bytes.len().min(77)]));
        match put {
            Put::Bytes(length) => bytes = &bytes[length..],
            Put::Wait => {}
            Put::Failed(failure) => panic!("{file}: {failure:?}"),
        }
    }
    ask(card, Request::Finish).unwrap();
}

fn run(program: &str, package: &str, arguments: &[&str]) -> Output {
    let run = Command::new(program).args(arguments).env("MTOOLS_SKIP_CHECK", "1").output();
    run.unwrap_or_else(|error| panic!("{program}: {error}; install it (Debian: apt-get install {package})"))
}

/// Path of fsck.fat, which is not on the path of a person who is not root.
fn fsck() -> &'static str {
    ["/usr/sbin/fsck.fat", "/sbin/fsck.fat"].into_iter().find(|at| Path::new(at).is_file()).unwrap_or("fsck.fat")
}

#[test]
fn what_is_written_is_read_by_mtools_and_leaves_a_sound_volume() {
    let folder = scratch();
    for (name, at, offset) in IMAGES {
        let card = mounted(name);
        let long: Vec<u8> = (0..40_000_u32).map(|at| ((at * at) >> 8) as u8).collect();
        write(&card, "NEW.GCO", &long);
        write(&card, "/PARTS/new2.g", b"G28\n");
        write(&card, "MANY/EMPTY.GCO", b"");
        // Replaces the file that was written first.
        write(&card, "NEW.GCO", &long[..700]);
        assert_eq!(ask(&card, Request::Delete(path("MANY/GAPS.GCO"))), Ok(Answer::Done));
        assert_eq!(ask(&card, Request::Release), Ok(Answer::Done));

        let written = card.with_slot(|slot| slot.with_image(|image| image.clone()));
        let [whole, volume] = ["whole", "volume"].map(|part| folder.path().join(format!("{name}-{part}.img")));
        std::fs::write(&whole, &written).unwrap();
        let device = format!("{}{at}", whole.display());
        let read = run("mtype", "mtools", &["-i", &device, "::/NEW.GCO"]);
        assert!(read.status.success(), "{read:?}");
        assert_eq!(read.stdout, long[..700]);
        // Without repairing anything, fsck.fat finds nothing lost and nothing shared; only the
        // names of deleted files.
        std::fs::write(&volume, &written[offset..]).unwrap();
        let check = run(fsck(), "dosfstools", &["-n", volume.to_str().unwrap()]);
        let text = String::from_utf8_lossy(&check.stdout);
        assert!(text.contains("files,"), "{name}: {check:?}");
        for bad in ["Reclaim", "share clusters", "bad cluster", "differ", "Cluster chain", "File size is"] {
            assert!(!text.contains(bad), "{name}: {text}");
        }
    }
}
