//! The host with a minimal device that has no clock.

use super::bus::{Answer, Bus, Kind, Token};
use super::{Errors, FRAME_NS, State, UsbHost};

const MS: u64 = 1_000_000;
const CONFIGURATION: [u8; 67] = [
    9, 2, 67, 0, 2, 1, 0, 0xC0, 50, 9, 4, 0, 0, 1, 2, 2, 1, 0, 5, 0x24, 0, 0x10, 1, 4, 0x24, 2, 2, 5, 0x24, 6, 0, 1, 5,
    0x24, 1, 0, 1, 7, 5, 0x83, 3, 8, 0, 16, 9, 4, 1, 0, 2, 0x0A, 0, 0, 0, 7, 5, 0x81, 2, 64, 0, 0, 7, 5, 0x02, 2, 64,
    0, 0,
];

/// A device that answers immediately.
#[derive(Default)]
struct Fake {
    now_ns: u64,
    pull_up: bool,
    vbus: bool,
    address: u8,
    setup: [u8; 8],
    reply: Vec<u8>,
    reply_toggle: bool,
    setups: Vec<[u8; 8]>,
    /// The events on the bus, with their instants.
    events: Vec<(u64, &'static str)>,
    configuration: Vec<u8>,
    /// Received bytes, and the next expected toggle.
    got: Vec<u8>,
    out_toggle: bool,
    /// Packets to send.
    to_send: Vec<Vec<u8>>,
    in_toggle: bool,
    transactions: Vec<(u64, u8)>,
    silent: bool,
    stalled: bool,
    nak: bool,
}

impl Fake {
    fn new() -> Self {
        Self { pull_up: true, configuration: CONFIGURATION.to_vec(), ..Self::default() }
    }

    fn control(&mut self, kind: &Kind<'_>) -> Answer {
        match kind {
            Kind::Setup(setup) => {
                self.setup = *setup;
                self.setups.push(*setup);
                self.reply_toggle = true;
                let length = usize::from(u16::from_le_bytes([setup[6], setup[7]]));
                self.reply = match (setup[1], setup[3]) {
                    (6, 1) => vec![18, 1, 0, 2, 2, 0, 0, 8, 0x09, 0x12, 1, 0, 0, 1, 0, 2, 0, 1],
                    (6, 2) => self.configuration.clone(),
                    (6, 3) if setup[2] == 0 => vec![4, 3, 9, 4],
                    (6, 3) => vec![6, 3, b'o', 0, b'k', 0],
                    _ => Vec::new(),
                };
                self.reply.truncate(length);
                if setup[..2] == [2, 1] {
                    self.stalled = false;
                    let toggle = if setup[4] & 0x80 != 0 { &mut self.in_toggle } else { &mut self.out_toggle };
                    *toggle = false;
                }
                Answer::Ack
            }
            Kind::Out { .. } => Answer::Ack,
            Kind::In { .. } => {
                if self.setup[..2] == [0, 5] {
                    self.address = self.setup[2];
                }
                let rest = self.reply.split_off(self.reply.len().min(8));
                let bytes = std::mem::replace(&mut self.reply, rest);
                let toggle = self.reply_toggle;
                self.reply_toggle = !toggle;
                Answer::Data { toggle, bytes }
            }
        }
    }
}

impl Bus for Fake {
    fn connected(&mut self) -> bool {
        self.pull_up && self.vbus
    }

    fn set_vbus(&mut self, on: bool) {
        self.vbus = on;
    }

    fn set_reset(&mut self, active: bool) {
        self.address = 0;
        self.in_toggle = false;
        self.out_toggle = false;
        self.events.push((self.now_ns, if active { "reset" } else { "reset ends" }));
    }

    fn suspend(&mut self) {
        self.events.push((self.now_ns, "suspend"));
    }

    fn resume(&mut self) {
        self.events.push((self.now_ns, "resume"));
    }

    fn start_of_frame(&mut self, _frame: u16) {
        self.events.push((self.now_ns, "frame"));
    }

    fn transact(&mut self, token: &Token<'_>) -> Answer {
        if self.silent || token.address != self.address {
            return Answer::Silence;
        }
        self.transactions.push((self.now_ns, token.endpoint));
        match (token.endpoint, &token.kind) {
            (0, kind) => self.control(kind),
            _ if self.stalled => Answer::Stall,
            _ if self.nak => Answer::Nak,
            (2, Kind::Out { toggle, data }) => {
                if *toggle == self.out_toggle {
                    self.out_toggle = !toggle;
                    self.got.extend_from_slice(data);
                }
                Answer::Ack
            }
            (1, Kind::In { acknowledged }) if !self.to_send.is_empty() => {
                let (toggle, bytes) = (self.in_toggle, self.to_send[0].clone());
                if *acknowledged {
                    self.in_toggle = !toggle;
                    self.to_send.remove(0);
                }
                Answer::Data { toggle, bytes }
            }
            _ => Answer::Nak,
        }
    }
}

/// Runs from event to event for this time.
fn run(host: &mut UsbHost, fake: &mut Fake, for_ns: u64) {
    let end_ns = fake.now_ns + for_ns;
    while host.next_event_ns() <= end_ns {
        fake.now_ns = fake.now_ns.max(host.next_event_ns());
        host.advance(fake.now_ns, fake);
    }
    fake.now_ns = end_ns;
    host.advance(end_ns, fake);
}

fn open() -> (UsbHost, Fake) {
    let (mut host, mut fake) = (UsbHost::new(), Fake::new());
    host.plug();
    run(&mut host, &mut fake, 500 * MS);
    assert_eq!(host.state(), State::Open);
    (host, fake)
}

#[test]
fn a_device_is_debounced_and_reset_first() {
    let (mut host, mut fake) = (UsbHost::new(), Fake::new());
    fake.pull_up = false;
    assert_eq!((host.state(), host.next_event_ns()), (State::Unplugged, u64::MAX));
    host.plug();
    run(&mut host, &mut fake, 10 * MS);
    assert_eq!(host.state(), State::Waiting);
    fake.pull_up = true;
    fake.events.clear();
    run(&mut host, &mut fake, 500 * MS);
    let events: Vec<_> = fake.events.iter().filter(|event| event.1 != "frame").collect();
    let start = events[0].0 - 3 * MS;
    assert!(start <= 11 * MS);
    let seen: Vec<_> = events.iter().map(|(at_ns, what)| (at_ns - start, *what)).collect();
    assert_eq!(&seen[..3], [(3 * MS, "suspend"), (100 * MS, "reset"), (150 * MS, "reset ends")]);
    assert_eq!(fake.transactions[0].0 - start, 160 * MS + 3_000, "recovery, and the frame that begins then");
    assert_eq!(seen.iter().filter(|event| event.1 == "reset").count(), 2);
}

#[test]
fn enumeration_follows_the_order_of_a_real_host() {
    let (host, fake) = open();
    let asked: Vec<_> = fake.setups.iter().map(|setup| (setup[1], setup[3], setup[6])).collect();
    assert_eq!(
        asked,
        [
            (6, 1, 8),
            (5, 0, 0),
            (6, 1, 18),
            (6, 2, 9),
            (6, 2, 67),
            (6, 3, 255),
            (6, 3, 255),
            (9, 0, 0),
            (0x20, 0, 7),
            (0x22, 0, 0)
        ]
    );
    assert_eq!(fake.setups[9][2], 3, "DTR and RTS");
    assert_eq!(host.strings(), &[String::new(), "ok".into(), String::new()]);
    assert_eq!(host.device().map(|device| (device.vendor, device.product)), Some((0x1209, 1)));
    assert_eq!(Errors { naks: 0, ..host.errors }, Errors::default());
}

#[test]
fn a_frame_holds_nineteen_packets() {
    let (mut host, mut fake) = open();
    host.timing.nak_retry_ns = 50 * MS;
    run(&mut host, &mut fake, 2 * MS);
    fake.transactions.clear();
    fake.events.clear();
    host.write(&vec![5; 6400]);
    run(&mut host, &mut fake, 10 * MS);
    assert_eq!(fake.got, vec![5; 6400]);
    let frames: Vec<u64> = fake.events.iter().map(|event| event.0).collect();
    assert!(frames.windows(2).all(|pair| pair[1] - pair[0] == FRAME_NS));
    let within = |pair: &[u64]| {
        fake.transactions
            .iter()
            .filter(|(at_ns, endpoint)| *endpoint == 2 && (pair[0]..pair[1]).contains(at_ns))
            .count()
    };
    assert_eq!(frames.windows(2).map(within).max(), Some(19));
}

#[test]
fn both_directions_share_the_bus() {
    let (mut host, mut fake) = open();
    fake.to_send = (0..40).map(|number| vec![number; 64]).collect();
    host.write(&vec![5; 2560]);
    run(&mut host, &mut fake, 10 * MS);
    assert_eq!(fake.got.len(), 2560);
    assert_eq!(host.read(), (0..40).flat_map(|number| vec![number; 64]).collect::<Vec<u8>>());
    assert_eq!(host.read(), [0; 0]);
    assert_eq!(host.unsent(), 0);
}

#[test]
fn lost_handshakes_neither_lose_nor_repeat_bytes() {
    let (mut host, mut fake) = open();
    fake.to_send = vec![vec![1; 3], vec![2; 3]];
    host.lose_handshakes(2);
    host.write(b"abc");
    run(&mut host, &mut fake, 5 * MS);
    assert_eq!(host.read(), [1, 1, 1, 2, 2, 2]);
    assert_eq!(fake.got, b"abc");
    assert_eq!((host.errors.repeated_packets, host.errors.timeouts), (1, 1));
}

#[test]
fn a_halted_endpoint_is_cleared() {
    let (mut host, mut fake) = open();
    fake.to_send = vec![vec![8]];
    host.write(b"ab");
    run(&mut host, &mut fake, 5 * MS);
    assert!(fake.in_toggle && fake.out_toggle, "both are at DATA1");
    fake.stalled = true;
    run(&mut host, &mut fake, 5 * MS);
    assert_eq!(host.errors.stalls, 1);
    assert_eq!(fake.setups.last().map(|setup| (setup[1], setup[4])), Some((1, 0x81)));
    fake.to_send = vec![vec![9]];
    host.write(b"c");
    run(&mut host, &mut fake, 5 * MS);
    assert_eq!(host.read(), [8, 9], "the cleared endpoint begins again with DATA0");
    assert_eq!((&fake.got[..], host.errors.repeated_packets), (&b"abc"[..], 0), "the other goes on");
}

#[test]
fn bytes_written_late_do_not_go_back_in_time() {
    let (mut host, mut fake) = open();
    host.timing.nak_retry_ns = 50 * MS;
    run(&mut host, &mut fake, 5 * MS);
    fake.transactions.clear();
    let written_ns = fake.now_ns;
    host.write(&[5; 640]);
    assert_eq!(host.next_event_ns(), written_ns);
    run(&mut host, &mut fake, 5 * MS);
    let gaps = fake.transactions.windows(2).map(|pair| pair[1].0 - pair[0].0);
    assert_eq!(fake.transactions[0].0, written_ns);
    assert!(gaps.min() >= Some(51_000), "{:?}", fake.transactions);
}

#[test]
fn the_cable_may_be_unplugged_and_plugged_again() {
    let (mut host, mut fake) = open();
    fake.nak = true;
    host.write(&[1; 100]);
    run(&mut host, &mut fake, 5 * MS);
    assert!(host.errors.naks > 0);
    host.unplug();
    run(&mut host, &mut fake, 5 * MS);
    assert_eq!((host.state(), fake.vbus, host.errors.dropped_bytes), (State::Unplugged, false, 100));
    assert_eq!(host.errors.disconnects, 0, "the cable is not the device's doing");
    fake.nak = false;
    host.plug();
    run(&mut host, &mut fake, 500 * MS);
    assert_eq!(host.state(), State::Open);
    assert_eq!(fake.got, [0; 0]);
    fake.pull_up = false;
    run(&mut host, &mut fake, 5 * MS);
    assert_eq!((host.state(), host.errors.disconnects), (State::Waiting, 1));
}

#[test]
fn suspend_stops_the_frames() {
    let (mut host, mut fake) = open();
    fake.events.clear();
    let start = fake.now_ns;
    host.suspend();
    run(&mut host, &mut fake, 20 * MS);
    assert_eq!(fake.events, [(start + 3 * MS, "suspend")]);
    assert_eq!(host.state(), State::Suspended);
    host.write(b"later");
    host.resume();
    run(&mut host, &mut fake, 50 * MS);
    assert_eq!((host.state(), &fake.got[..]), (State::Open, &b"later"[..]));
    assert_eq!(fake.events[1], (start + 20 * MS, "resume"));
}

#[test]
fn a_reset_enumerates_again() {
    let (mut host, mut fake) = open();
    let asked = fake.setups.len();
    host.reset_bus();
    run(&mut host, &mut fake, 500 * MS);
    assert_eq!((host.state(), fake.setups.len()), (State::Open, 2 * asked));
}

#[test]
fn a_device_that_keeps_failing_is_refused() {
    let (mut host, mut fake) = (UsbHost::new(), Fake::new());
    fake.silent = true;
    host.plug();
    run(&mut host, &mut fake, 1000 * MS);
    let why = "unknown device: no answer to three attempts of DescriptorHead";
    assert_eq!(host.state(), State::Refused(why.into()));
    assert_eq!((host.errors.timeouts, host.errors.failed_requests), (12, 4));
    fake.silent = false;
    host.reset_bus();
    run(&mut host, &mut fake, 500 * MS);
    assert_eq!(host.state(), State::Open);
}

#[test]
fn another_class_is_refused_by_name() {
    let (mut host, mut fake) = (UsbHost::new(), Fake::new());
    fake.configuration = vec![9, 2, 18, 0, 1, 1, 0, 0xC0, 50, 9, 4, 0, 0, 0, 3, 1, 1, 0];
    host.plug();
    run(&mut host, &mut fake, 500 * MS);
    let why = "1209:0001 \"ok\": the device has no CDC ACM interface, only the classes [03]";
    assert_eq!(host.state(), State::Refused(why.into()));
}

#[test]
fn a_device_that_falls_silent_is_reset() {
    let (mut host, mut fake) = open();
    fake.silent = true;
    run(&mut host, &mut fake, 2 * MS);
    assert_eq!(host.state(), State::Enumerating);
    fake.silent = false;
    run(&mut host, &mut fake, 500 * MS);
    assert_eq!(host.state(), State::Open);
}

#[test]
fn a_snapshot_keeps_the_state() {
    let (mut host, mut fake) = open();
    host.write(&[1; 100]);
    fake.nak = true;
    run(&mut host, &mut fake, 2 * MS);
    let kept: UsbHost = serde_json::from_str(&serde_json::to_string(&host).unwrap()).unwrap();
    assert_eq!(kept, host);
}
