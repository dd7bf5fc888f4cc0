//! The place of a print on its card, and power cuts while it is written.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use ferrostep_card::{Answer, CardFailure, CardPort, KEPT_BYTES, KEPT_NAME, ListOptions, Request};
use ferrostep_hal_shim::card::CardError;
use ferrostep_random_cases::{Share, share_of};
use ferrostep_virtual_board::{CardFault, VirtualCard};

use crate::common::{self, Card, IMAGES, Random, ask, image, list, mounted, opened, path, read, take_all};

const FILE: &str = "PARTS/ONE.GCO";

fn keep(card: &Card, place: &[u8]) {
    card.with(&mut |mailbox| {
        mailbox.kept_mut().clear();
        mailbox.kept_mut().extend_from_slice(place).unwrap();
        mailbox.keep();
    });
    let mut failure = None;
    card.with(&mut |mailbox| failure = mailbox.take_keep_failure());
    assert_eq!(failure, None);
}

/// Place that the card keeps after the power has come back.
fn kept(card: &Card) -> Result<Vec<u8>, CardFailure> {
    card.with_slot(|slot| {
        slot.pull();
        slot.insert();
    });
    ask(card, Request::Mount)?;
    ask(card, Request::OpenKept)?;
    assert_eq!(opened(card).short.as_str(), "/PARTS/ONE.GCO");
    let mut place = Vec::new();
    card.with(&mut |mailbox| place = mailbox.kept().to_vec());
    Ok(place)
}

fn begun(name: &str) -> Card {
    let card = mounted(name);
    ask(&card, Request::Open(path(FILE))).unwrap();
    assert_eq!(ask(&card, Request::BeginKeeping { fresh: true }), Ok(Answer::Done));
    card
}

fn bytes(card: &Card) -> Vec<u8> {
    card.with_slot(|slot| slot.with_image(|image| image.clone()))
}

fn place(random: &mut Random) -> Vec<u8> {
    (0..=random.below(KEPT_BYTES as u64 - 1)).map(|_| random.next() as u8).collect()
}

#[test]
fn the_print_is_found_with_its_place() {
    for name in IMAGES {
        let card = begun(name);
        let whole = read(&mounted(name), FILE).unwrap();
        assert_eq!(take_all(&card).unwrap(), whole, "the print is read on");
        assert_eq!(kept(&card), Err(CardFailure::NothingKept));
        ask(&card, Request::Open(path(FILE))).unwrap();
        assert_eq!(ask(&card, Request::BeginKeeping { fresh: false }), Ok(Answer::Done));
        keep(&card, b"somewhere");
        let before = bytes(&card);
        keep(&card, b"elsewhere");
        let after = bytes(&card);
        let changed: Vec<usize> = (0..after.len() / 512)
            .filter(|block| before[block * 512..][..512] != after[block * 512..][..512])
            .collect();
        assert_eq!(changed.len(), 1, "one block, neither table nor folder");
        assert_eq!(kept(&card).unwrap(), b"elsewhere");
        assert_eq!(take_all(&card).unwrap(), whole, "it is open");
        // The print ends.
        keep(&card, b"");
        assert_eq!(kept(&card), Err(CardFailure::NothingKept));
        let files = list(&card, ListOptions::default()).unwrap();
        assert!(!files.iter().any(|line| line.contains("FERROSTP")), "{files:?}");
        assert_eq!(files, list(&mounted(name), ListOptions::default()).unwrap());
    }
}

#[test]
fn another_file_is_not_gone_on_with() {
    for (contents, failure) in [(None, CardFailure::NotFound), (Some(&b"G28\n"[..]), CardFailure::OtherFile)] {
        let card = begun("fat16");
        keep(&card, b"somewhere");
        ask(&card, Request::Close).unwrap();
        match contents {
            None => {
                ask(&card, Request::Delete(path(FILE))).unwrap();
            }
            Some(contents) => common::write(&card, FILE, contents).unwrap(),
        }
        assert_eq!(ask(&card, Request::OpenKept), Err(failure));
    }
    // A file of the same length with another beginning.
    let card = begun("fat16");
    keep(&card, b"somewhere");
    let whole = read(&mounted("fat16"), FILE).unwrap();
    let mut other = whole.clone();
    other[3] ^= 1;
    common::write(&card, FILE, &other).unwrap();
    assert_eq!(ask(&card, Request::OpenKept), Err(CardFailure::OtherFile));
}

/// A cut at every byte of a block that is being written, over many saves. After the cut come the
/// old block, noise, or nothing readable. A run tries a share of the bytes; cuts before the first
/// and after the last byte are always tried.
#[test]
fn a_cut_at_any_byte_of_a_save_leaves_the_old_place_or_the_new_one() {
    const SAVES: u64 = 100;
    /// Cuts after 0 to 512 bytes, with and without noise.
    const CUTS: u64 = 2 * 513;
    let card = begun("fat16");
    let mut random = Random::new(1);
    keep(&card, b"first");
    let (mut old, mut before) = (b"first".to_vec(), bytes(&card));
    let (mut cuts, mut new_ones) = (0, 0);
    for save in 0..SAVES {
        ask(&card, Request::Open(path(FILE))).unwrap();
        ask(&card, Request::BeginKeeping { fresh: false }).unwrap();
        let new = place(&mut random);
        keep(&card, &new);
        let after = bytes(&card);
        let block = (0..after.len() / 512).find(|block| before[block * 512..][..512] != after[block * 512..][..512]);
        let block = block.unwrap() * 512..block.unwrap() * 512 + 512;
        for cut in (0..2).chain(CUTS - 2..CUTS).chain(share_of(CUTS)) {
            let (written, noise) = ((cut / 2) as usize, cut % 2 == 1);
            let mut spoilt = before[block.clone()].to_vec();
            if noise {
                let mut random = Random::new(save * CUTS + cut);
                spoilt.iter_mut().for_each(|byte| *byte = random.next() as u8);
            }
            spoilt[..written].copy_from_slice(&after[block.clone()][..written]);
            card.with_slot(|slot| slot.with_image(|image| image[block.clone()].copy_from_slice(&spoilt)));
            let found = kept(&card).unwrap();
            assert!(found == old || found == new, "save {save}, cut after {written} bytes: {found:?}");
            let is_whole = spoilt == after[block.clone()];
            assert_eq!(found == new, is_whole, "save {save}, cut after {written} bytes");
            cuts += 1;
            new_ones += u32::from(is_whole);
        }
        // The state after a cut that the card's own checksum notices.
        let number = (block.start / 512) as u32;
        card.with_slot(|slot| slot.set_fault(Some(CardFault::Unreadable(number..number + 1))));
        assert_eq!(kept(&card).unwrap(), old, "save {save}: unreadable");
        cuts += 1;
        card.with_slot(|slot| slot.set_fault(None));
        // The next save begins after a cut, with the spoilt block.
        card.with_slot(|slot| slot.with_image(|image| image[block.clone()].fill(0xFF)));
        ask(&card, Request::Open(path(FILE))).unwrap();
        ask(&card, Request::BeginKeeping { fresh: false }).unwrap();
        keep(&card, &new);
        assert_eq!(kept(&card).unwrap(), new);
        (old, before) = (new, bytes(&card));
    }
    assert!(cuts >= 100_000 || !Share::of_this_run().is_all(), "{cuts}");
    assert!(new_ones > 0);
    println!("{cuts} cuts");
}

/// The file is created once for each card. A cut at each of the blocks that are written for it
/// leaves a card whose files are as they were, and the next print creates it.
#[test]
fn a_cut_while_the_file_is_created_harms_no_other_file() {
    for name in IMAGES {
        let sound = image(name);
        let whole = read(&mounted(name), FILE).unwrap();
        let files = list(&mounted(name), ListOptions::default()).unwrap();
        let card = Card::new(VirtualCard::new(sound.clone()));
        let mut cuts = 0;
        for accesses in 0.. {
            card.with_slot(|slot| {
                slot.set_fault(None);
                slot.insert_other(sound.clone());
            });
            ask(&card, Request::Mount).unwrap();
            ask(&card, Request::Open(path(FILE))).unwrap();
            card.with_slot(|slot| slot.set_fault(Some(CardFault::PulledAfter(accesses))));
            let begun = ask(&card, Request::BeginKeeping { fresh: true });
            card.with_slot(|slot| {
                slot.set_fault(None);
                slot.pull();
                slot.insert();
            });
            ask(&card, Request::Mount).unwrap();
            assert_eq!(list(&card, ListOptions::default()).unwrap(), files, "{name}: {accesses}");
            assert_eq!(read(&card, FILE).unwrap(), whole, "{name}: {accesses}");
            assert_eq!(ask(&card, Request::OpenKept), Err(CardFailure::NothingKept), "{name}: {accesses}");
            ask(&card, Request::Open(path(FILE))).unwrap();
            ask(&card, Request::BeginKeeping { fresh: true }).unwrap();
            keep(&card, b"somewhere");
            assert_eq!(kept(&card).unwrap(), b"somewhere", "{name}: {accesses}");
            cuts += 1;
            if begun.is_ok() {
                break;
            }
        }
        assert!(cuts > 10, "{name}: {cuts}");
    }
}

#[test]
fn a_card_that_cannot_be_written_says_so_and_is_read_on() {
    let card = begun("fat16");
    keep(&card, b"somewhere");
    card.with_slot(|slot| slot.set_fault(Some(CardFault::Unwritable)));
    card.with(&mut |mailbox| {
        mailbox.kept_mut().clear();
        mailbox.kept_mut().extend_from_slice(b"elsewhere").unwrap();
        mailbox.keep();
    });
    let mut failure = None;
    card.with(&mut |mailbox| failure = mailbox.take_keep_failure());
    assert_eq!(failure, Some(CardFailure::Slot(CardError::Silent)));
    card.with_slot(|slot| slot.set_fault(None));
    assert_eq!(take_all(&card).unwrap(), read(&mounted("fat16"), FILE).unwrap());
    assert_eq!(kept(&card).unwrap(), b"somewhere");
    assert!(read(&card, KEPT_NAME).is_ok());
}
