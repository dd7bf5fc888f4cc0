//! Cards with bytes changed at random, and cards that are pulled out at any instant.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use ferrostep_card::{Answer, CardFailure, CardPort, ListOptions, Request, Taken};
use ferrostep_hal_shim::card::CardError;
use ferrostep_random_cases::share_of;
use ferrostep_virtual_board::{CardFault, VirtualCard};

use crate::common::{self, Card, IMAGES, Random, ask, image, lines_file, list, mounted, path, read, take_rest, write};

/// Blocks that a task may need: as many as a list may.
const MAX_ACCESSES: u64 = 65_536 + 10_000;

/// Does every task: each ends soon, whatever the card holds.
fn use_everything(card: &Card) {
    let tasks: [&dyn Fn(); 10] = [
        &|| {
            let _ = ask(card, Request::Mount);
        },
        &|| drop(list(card, ListOptions { long: true, time: true })),
        &|| {
            let _ = read(card, "PARTS/DEEP/TWO.GCO");
        },
        &|| {
            let _ = read(card, "Parts of the machine/Left side/Bracket, thick.gcode");
        },
        &|| {
            let _ = read(card, "MANY/GAPS.GCO");
        },
        &|| {
            let _ = ask(card, Request::LongPath(path("PARTSO~1/LEFTSI~1/BRACKE~1.GCO")));
        },
        &|| {
            let _ = ask(card, Request::Delete(path("MANY/GAPS.GCO")));
        },
        &|| assert!(matches!(write(card, "PARTS/NEW.GCO", &[b'x'; 3000]), Ok(()) | Err(_))),
        &|| {
            let _ = ask(card, Request::Open(path("PARTS/ONE.GCO")));
            let _ = ask(card, Request::BeginKeeping { fresh: true });
            card.with(&mut |mailbox| {
                let _ = mailbox.kept_mut().extend_from_slice(b"place");
                mailbox.keep();
            });
            let _ = ask(card, Request::OpenKept);
        },
        &|| {
            let _ = ask(card, Request::Release);
        },
    ];
    for (index, task) in tasks.iter().enumerate() {
        let before = card.with_slot(VirtualCard::accesses);
        task();
        let accesses = card.with_slot(VirtualCard::accesses) - before;
        assert!(accesses < MAX_ACCESSES, "task {index}: {accesses} accesses");
    }
}

/// Blocks of an image that hold anything except file contents: damage to them does most harm.
fn structures(image: &[u8], whole: bool) -> Vec<usize> {
    let start = if whole { 0 } else { 2048 };
    (0..image.len() / 512)
        .filter(|&block| block <= start + 40 || image[block * 512..][..512].windows(3).any(|bytes| bytes == b"GCO"))
        .collect()
}

#[test]
fn damaged_volumes_neither_panic_nor_hang() {
    // 10,000 in all. The larger image takes longer to copy.
    for (name, whole, seeds) in [("fat16", true, 9000), ("fat32", false, 1000)] {
        let sound = image(name);
        let blocks = structures(&sound, whole);
        let card = Card::new(VirtualCard::new(sound.clone()));
        let (mut tried, mut mounted) = (0, 0);
        for seed in share_of(seeds) {
            tried += 1;
            let mut random = Random::new(seed);
            let mut places = Vec::new();
            card.with_slot(|slot| {
                slot.with_image(|image| {
                    for _ in 0..=random.below(8) {
                        let block = blocks[random.below(blocks.len() as u64) as usize];
                        let place = block * 512 + random.below(512) as usize;
                        places.push(block);
                        image[place] = random.next() as u8;
                    }
                });
                slot.pull();
                slot.insert();
            });
            mounted += usize::from(ask(&card, Request::Mount).is_ok());
            use_everything(&card);
            card.with_slot(|slot| slot.with_image(|image| image.copy_from_slice(&sound)));
        }
        assert!(mounted > tried / 4, "{name}: {mounted} of {tried} could be mounted at all");
    }
}

/// Chains on which `next_cluster` of embedded-sdmmc panics, and rings of clusters.
#[test]
fn known_traps_are_refused() {
    // A folder that contains itself, and one whose chain is a ring.
    for name in IMAGES {
        let start = if name == "fat32" { 2048 } else { 0 };
        let mut bytes = image(name);
        let boot = bytes[start * 512..][..512].to_vec();
        let table = (start + usize::from(u16::from_le_bytes([boot[14], boot[15]]))) * 512;
        // All clusters point to the next but one, which points back.
        let width = if name == "fat32" { 4 } else { 2 };
        for cluster in 3..4000 {
            let to = (cluster as u32 ^ 1).to_le_bytes();
            bytes[table + cluster * width..][..width].copy_from_slice(&to[..width]);
        }
        let card = Card::new(VirtualCard::new(bytes));
        use_everything(&card);

        // Half of a surrogate pair at the beginning of every part of a name, cluster
        // numbers of 32 bits.
        let mut bytes = image(name);
        for slot in (start * 512..bytes.len() - 32).step_by(32) {
            let is_name = bytes[slot + 11] == 0x0F && bytes[slot + 12] == 0;
            if is_name && (1..0x60).contains(&bytes[slot]) {
                bytes[slot + 1..slot + 3].copy_from_slice(&[0x00, 0xDC]);
            } else if &bytes[slot + 8..slot + 11] == b"GCO" || bytes[slot + 11] == 0x10 {
                bytes[slot + 20..slot + 22].copy_from_slice(&[0xFF, 0xFF]);
            }
        }
        use_everything(&Card::new(VirtualCard::new(bytes)));
    }
}

#[test]
fn a_pulled_card_loses_nothing_of_what_was_read() {
    let whole = lines_file();
    for name in IMAGES {
        let card = mounted(name);
        for seed in 0..1000 {
            let mut random = Random::new(seed);
            ask(&card, Request::Mount).unwrap();
            ask(&card, Request::Open(path("MANY/GAPS.GCO"))).unwrap();
            let mut bytes: Vec<u8> = Vec::new();
            let mut pulls = 0;
            card.with_slot(|slot| slot.set_fault(Some(CardFault::PulledAfter(random.below(20) as u32))));
            while let Err(failure) = take_rest(&card, &mut bytes) {
                pulls += 1;
                assert_eq!(failure, CardFailure::Slot(CardError::Missing));
                assert!(ask(&card, Request::Reopen).is_err(), "the card is not there");
                card.with_slot(VirtualCard::insert);
                if random.below(2) == 0 {
                    ask(&card, Request::Mount).unwrap();
                }
                assert_eq!(ask(&card, Request::Reopen), Ok(Answer::Done));
                if random.below(2) == 0 {
                    card.with_slot(|slot| slot.set_fault(Some(CardFault::PulledAfter(random.below(20) as u32 + 8))));
                }
            }
            assert_eq!(bytes, whole, "{name}: seed {seed}");
            assert!(pulls > 0 || card.with_slot(VirtualCard::accesses) > 0);
            card.with_slot(|slot| slot.set_fault(None));
        }
    }
}

#[test]
fn another_file_of_the_same_name_is_not_gone_on_with() {
    let reopened = |change: &dyn Fn(&mut Vec<u8>), taken: usize| {
        let card = mounted("fat16");
        ask(&card, Request::Open(path("ACUBEW~1.GCO"))).unwrap();
        let mut chunk = vec![0; 100];
        for _ in 0..taken {
            card.with(&mut |mailbox| assert!(matches!(mailbox.take(&mut chunk), Taken::Bytes(_))));
        }
        card.with_slot(|slot| {
            slot.pull();
            slot.with_image(change);
            slot.insert();
        });
        while let Ok(bytes) = common::take_all(&card) {
            assert!(bytes.is_empty(), "at most what was read ahead");
        }
        ask(&card, Request::Reopen)
    };
    let file = b"G1 X1 Y10 F3000\nG1 X2 Y10";
    let change_text = |image: &mut Vec<u8>| {
        let at = image.windows(file.len()).position(|bytes| bytes == file).unwrap();
        image[at + 4] = b'7';
    };
    let change_size = |image: &mut Vec<u8>| {
        let at = image.windows(11).position(|bytes| bytes == b"ACUBEW~1GCO").unwrap();
        image[at + 28] ^= 1;
    };
    assert_eq!(reopened(&|_| {}, 20), Ok(Answer::Done));
    assert_eq!(reopened(&change_text, 20), Err(CardFailure::OtherFile));
    assert_eq!(reopened(&change_size, 20), Err(CardFailure::OtherFile));
    assert_eq!(reopened(&|image| image.fill(0), 20), Err(CardFailure::NoVolume));
}

#[test]
fn a_bad_contact_is_tried_again() {
    let card = mounted("fat32");
    ask(&card, Request::Open(path("MANY/GAPS.GCO"))).unwrap();
    card.with_slot(|slot| slot.set_fault(Some(CardFault::FailingReads(2))));
    assert_eq!(common::take_all(&card).unwrap(), lines_file());
    ask(&card, Request::Open(path("MANY/GAPS.GCO"))).unwrap();
    card.with_slot(|slot| slot.set_fault(Some(CardFault::FailingReads(3))));
    assert_eq!(common::take_all(&card), Err(CardFailure::Slot(CardError::Garbled)));
    assert_eq!(ask(&card, Request::Reopen), Ok(Answer::Done));
    assert_eq!(common::take_all(&card).unwrap().len() % 512, lines_file().len() % 512);
}

#[test]
fn damaged_data_and_bad_blocks_end_a_task() {
    for name in IMAGES {
        let card = mounted(name);
        let sound = image(name);
        for seed in share_of(if name == "fat16" { 500 } else { 50 }) {
            let mut random = Random::new(seed);
            let first = random.below(6000) as u32;
            let blocks = first..first + random.below(200) as u32;
            let fault = if seed % 2 == 0 { CardFault::Unreadable(blocks) } else { CardFault::Corrupted(blocks) };
            card.with_slot(|slot| slot.set_fault(Some(fault)));
            use_everything(&card);
            card.with_slot(|slot| {
                slot.set_fault(None);
                slot.insert_other(sound.clone());
            });
        }
    }
}

/// A list is complete, or reports a block that could not be read; and an existing file is not taken
/// for missing. embedded-sdmmc takes a chain of clusters whose next number cannot be read for one
/// that ends there.
#[test]
fn a_block_that_cannot_be_read_shortens_no_list() {
    // The volume's beginning, its table of clusters and its first folders.
    for (name, blocks) in [("fat16", [0..300, 0..0]), ("fat32", [2_048..2_100, 3_000..3_300])] {
        let card = mounted(name);
        let options = ListOptions { long: false, time: false };
        let sound = common::list(&card, options).unwrap();
        let mut failed = 0;
        for block in blocks.into_iter().flatten() {
            assert_eq!(ask(&card, Request::Mount), Ok(Answer::Done));
            card.with_slot(|slot| slot.set_fault(Some(CardFault::Unreadable(block..block + 1))));
            match common::list(&card, options) {
                Ok(lines) => assert_eq!(lines, sound, "{name}, block {block}"),
                Err(failure) => {
                    assert_eq!(failure, CardFailure::Slot(CardError::Garbled), "{name}, block {block}");
                    failed += 1;
                }
            }
            let again = ask(&card, Request::Mount);
            let opened = again.and_then(|_| ask(&card, Request::Open(path("MANY/GAPS.GCO"))));
            assert!(!matches!(opened, Err(CardFailure::NotFound)), "{name}, block {block}");
            card.with_slot(|slot| slot.set_fault(None));
        }
        assert!(failed >= 3, "{name}: {failed} blocks were needed");
    }
}
