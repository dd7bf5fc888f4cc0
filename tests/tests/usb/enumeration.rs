//! The device's descriptors, byte by byte.

use crate::usb::device::{Device, PRODUCT};
use crate::usb::host::{BULK_IN, BULK_OUT, Host, PACKET_BYTES, Stalled};

/// A string descriptor's text (USB 2.0, 9.6.7).
fn text(descriptor: &[u8]) -> String {
    assert_eq!((usize::from(descriptor[0]), descriptor[1]), (descriptor.len(), 3));
    let units: Vec<u16> = descriptor[2..].chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    String::from_utf16(&units).unwrap()
}

/// USB 2.0, table 9-8.
#[rustfmt::skip]
const DEVICE: [u8; 18] = [
    18, 1,
    0x00, 0x02,  // USB 2.0
    2, 0, 0,     // communications device
    64,          // bytes in a control packet
    0x09, 0x12,  // vendor 1209
    0x01, 0x00,  // product 0001
    0x10, 0x00,  // release
    1, 2, 3,     // strings: manufacturer, product, serial number
    1,           // one configuration
];

/// USB 2.0, tables 9-10, 9-12, 9-13; CDC 1.2, tables 15 and 16; PSTN 1.2, tables 3 and 4.
#[rustfmt::skip]
const CONFIGURATION: [u8; 67] = [
    9, 2, 67, 0, 2, 1, 0, 0b1100_0000, 50,    // two interfaces, self-powered, 100 mA
    9, 4, 0, 0, 1, 0x02, 0x02, 0x00, 0,       // interface 0: communications, abstract control model
    5, 0x24, 0x00, 0x10, 0x01,                // CDC 1.10
    4, 0x24, 0x02, 0x00,                      // abstract control management
    5, 0x24, 0x06, 0, 1,                      // union of interfaces 0 and 1
    5, 0x24, 0x01, 0x00, 1,                   // call management
    7, 5, 0x81, 3, 8, 0, 255,                 // interrupt IN 1
    9, 4, 1, 0, 2, 0x0a, 0x00, 0x00, 0,       // interface 1: data
    7, 5, 0x82, 2, 64, 0, 0,                  // bulk IN 2
    7, 5, 0x01, 2, 64, 0, 0,                  // bulk OUT 1
];

#[test]
fn descriptors_match_the_specification() {
    let device = Device::new();
    let mut host = device.host();
    host.reset();
    // Hosts begin like this: the first bytes, for the size of control packets.
    assert_eq!(host.descriptor(1, 0, 8).unwrap(), DEVICE[..8]);
    host.reset();
    host.set_address();
    // More than there is may be asked for.
    assert_eq!(host.descriptor(1, 0, 64).unwrap(), DEVICE);
    assert_eq!(host.descriptor(2, 0, 9).unwrap(), CONFIGURATION[..9]);
    assert_eq!(host.descriptor(2, 0, 255).unwrap(), CONFIGURATION);
    assert_eq!(host.descriptor(3, 0, 255).unwrap(), [4, 3, 0x09, 0x04]);
    let string = |index| text(&host.descriptor(3, index, 255).unwrap());
    assert_eq!([string(1), string(2), string(3)], ["Ferrostep", PRODUCT, "003000413436511030323532"]);
    // A device at full speed only has none of these.
    assert_eq!(host.descriptor(3, 9, 255), Err(Stalled));
    assert_eq!(host.descriptor(6, 0, 10), Err(Stalled));
    assert_eq!(host.descriptor(1, 0, 18).unwrap(), DEVICE, "a refusal ends with the next request");
    assert!(!device.is_configured());
    host.configure(1);
    assert!(device.is_configured());
    assert_eq!(host.ask(0, 8, 0, 0, 1), Ok(vec![1]));
    assert_eq!(host.ask(0, 0, 0, 0, 2), Ok(vec![1, 0]), "self-powered");
}

#[test]
fn the_port_has_the_endpoints_of_its_descriptor() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    assert_eq!(host.packet_sizes(BULK_IN, BULK_OUT), (PACKET_BYTES, PACKET_BYTES));
    host.send(b"M115\n");
    assert_eq!(device.take_received(), b"M115\n");
    device.reply("ok");
    assert_eq!(host.read(), b"ok\n");
}

/// GET_LINE_CODING.
fn line_coding(host: &Host<'_>) -> Vec<u8> {
    host.ask(0x21, 0x21, 0, 0, 7).unwrap()
}

#[test]
fn line_coding_is_stored_without_effect() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    for coding in [[0x00, 0xc2, 0x01, 0x00, 0, 0, 8], [0x90, 0xd0, 0x03, 0x00, 2, 1, 7]] {
        host.tell(0x21, 0x20, 0, 0, &coding).unwrap();
        assert_eq!(line_coding(&host), coding);
        host.send(b"M105\n");
        assert_eq!(device.take_received(), b"M105\n");
    }
    // Half of it, of another interface, and invalid requests.
    assert_eq!(host.tell(0x21, 0x20, 0, 0, &[1, 2, 3]), Err(Stalled));
    assert_eq!(host.tell(0x21, 0x20, 0, 1, &[0; 7]), Err(Stalled));
    assert_eq!(host.tell(0x21, 0x7f, 0, 0, &[]), Err(Stalled));
    assert_eq!(line_coding(&host), [0x90, 0xd0, 0x03, 0x00, 2, 1, 7]);
    host.set_open(true);
    host.set_open(false);
}
