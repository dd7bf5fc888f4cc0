//! Conversations cut into packets at random.

use proptest::collection::vec;
use proptest::prelude::*;

use crate::usb::broken::heard;
use crate::usb::device::Device;
use crate::usb::host::PACKET_BYTES;

/// The next action of a host.
#[derive(Clone, Debug)]
enum Step {
    /// Sends this many of the remaining bytes in one packet; a packet may be empty.
    Send(usize),
    /// Resets the bus in the middle of anything.
    Reset,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    vec(prop_oneof![20 => (0..=PACKET_BYTES).prop_map(Step::Send), 1 => Just(Step::Reset)], 1..60)
}

/// Lines of a host that might be commands; without numbers.
fn lines() -> impl Strategy<Value = Vec<String>> {
    vec("[A-MO-Z][A-MO-Z0-9 .]{0,80}", 1..40)
}

proptest! {
    /// Lines arrive whole or not at all, wherever packets and connections end.
    #[test]
    fn lines_arrive_in_packets_of_any_size(lines in lines(), steps in steps()) {
        let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
        let device = Device::new();
        let mut host = device.host();
        host.plug_in();
        let (mut rest, mut session, mut expected) = (text.as_bytes(), Vec::new(), Vec::new());
        let mut received = Vec::new();
        for step in steps {
            match step {
                Step::Send(length) => {
                    let packet;
                    (packet, rest) = rest.split_at(length.min(rest.len()));
                    prop_assert!(host.send_packet(packet));
                    session.extend_from_slice(packet);
                }
                Step::Reset => {
                    expected.push(std::mem::take(&mut session));
                    host.plug_in();
                }
            }
            received.extend(device.take_received());
        }
        // Shows that a line is broken off, if one is.
        host.plug_in();
        host.send(b"END\n");
        received.extend(device.take_received());
        expected.push(session);
        expected.push(b"END\n".to_vec());
        let mut whole = Vec::new();
        for session in expected {
            let text = String::from_utf8(session).unwrap();
            let end = text.rfind('\n').map_or(0, |end| end + 1);
            whole.extend(text[..end].lines().map(|line| Some(line.trim().to_owned())));
            if end < text.len() {
                whole.push(None);
            }
        }
        // Blank lines have no answer.
        whole.retain(|line| line.as_deref() != Some(""));
        let trimmed: Vec<_> =
            heard(&received).into_iter().map(|line| line.map(|text| text.trim().to_owned())).collect();
        prop_assert_eq!(trimmed, whole);
        prop_assert_eq!(device.dropped(), 0);
    }

    /// Replies of any length arrive whole and in order, a transfer ends with a packet that is not
    /// full, and whatever was not read in time is counted.
    #[test]
    fn replies_arrive_however_they_are_read(
        steps in vec(prop_oneof![3 => (0..200usize).prop_map(Some), 1 => Just(None)], 1..80),
    ) {
        let device = Device::new();
        let mut host = device.host();
        host.plug_in();
        host.set_open(true);
        let (mut said, mut lines) = (Vec::new(), Vec::new());
        for (number, step) in steps.into_iter().enumerate() {
            match step {
                Some(length) => {
                    let line = format!("ok {number} {}", "x".repeat(length));
                    device.reply(&line);
                    said.push(line);
                }
                None => lines.extend(host.read_lines()),
            }
        }
        lines.extend(host.read_lines());
        device.reply("end");
        lines.extend(host.read_lines());
        said.push("end".to_owned());
        let mut left = said.iter();
        for line in lines {
            if let Some(dropped) = line.strip_prefix("echo:usb: nobody read, ") {
                let dropped: usize = dropped.strip_suffix(" lines dropped").unwrap().parse().unwrap();
                prop_assert!(dropped > 0);
                prop_assert!(left.nth(dropped - 1).is_some());
            } else {
                prop_assert_eq!(Some(&line), left.next());
            }
        }
        prop_assert_eq!(left.next(), None, "a line was lost and not counted");
    }

    /// The packets of one reply: full ones and a last one that is not.
    #[test]
    fn a_transfer_ends_with_a_packet_that_is_not_full(length in 0..1000usize) {
        let device = Device::new();
        let mut host = device.host();
        host.plug_in();
        host.set_open(true);
        device.reply("x".repeat(length));
        let packets: Vec<usize> =
            std::iter::from_fn(|| host.read_packet()).map(|packet| packet.len()).collect();
        let (last, full) = packets.split_last().unwrap();
        // The first packet goes as soon as there is something to send, so it may be a short one.
        prop_assert_eq!(packets.iter().sum::<usize>(), length + 1);
        prop_assert!(*last < PACKET_BYTES, "{packets:?}");
        prop_assert!(full.iter().all(|&packet| packet == PACKET_BYTES), "{packets:?}");
    }

    /// Requests and bytes, however nonsensical, cause neither a panic nor silence.
    #[test]
    fn a_senseless_host_does_no_harm(
        requests in vec((any::<[u8; 4]>(), any::<u16>(), 0..300usize), 0..30),
        bytes in vec(any::<u8>(), 0..500),
    ) {
        let device = Device::new();
        let mut host = device.host();
        host.plug_in();
        for ([kind, number, low, high], index, length) in requests {
            // Another address or configuration would be obeyed.
            if kind & 0x60 == 0 && matches!(number, 5 | 9) {
                continue;
            }
            host.try_request([kind, number, low, high], index, length);
            host.send(&bytes);
        }
        host.plug_in();
        host.set_open(true);
        device.take_received();
        device.take_emergencies();
        host.send(b"M105\n");
        prop_assert!(device.take_received().ends_with(b"M105\n"));
        device.reply("ok");
        prop_assert!(host.read_lines().contains(&"ok".to_owned()));
    }
}
