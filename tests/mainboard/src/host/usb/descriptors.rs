//! The descriptors of a device, USB 2.0 section 9.6 and the class definition of communication
//! devices (CDC 1.2).

/// The largest full-speed bulk packet.
const BULK_PACKET: u16 = 64;
/// Descriptor types.
const CONFIGURATION: u8 = 2;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;

/// The fields of the device descriptor that a host uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Device {
    /// Vendor identifier.
    pub vendor: u16,
    /// Product identifier.
    pub product: u16,
    /// Class of the whole device.
    pub class: u8,
    /// Maximum packet size of endpoint 0, bytes.
    pub control_packet: u8,
    /// Numbers of the strings for maker, product and serial number; 0 for none.
    pub strings: [u8; 3],
}

impl Device {
    /// Reads the 18 bytes of a device descriptor.
    ///
    /// # Errors
    ///
    /// The descriptor is malformed; the text says how.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() < 18 || bytes[0] != 18 || bytes[1] != 1 {
            return Err(format!("the device descriptor is {bytes:02x?}, expected 18 bytes of type 1"));
        }
        let control_packet = control_packet(bytes)?;
        Ok(Self {
            vendor: u16::from_le_bytes([bytes[8], bytes[9]]),
            product: u16::from_le_bytes([bytes[10], bytes[11]]),
            class: bytes[4],
            control_packet,
            strings: [bytes[14], bytes[15], bytes[16]],
        })
    }
}

/// bMaxPacketSize0 from the first eight bytes of a device descriptor.
///
/// # Errors
///
/// The size is not one of full speed.
pub fn control_packet(bytes: &[u8]) -> Result<u8, String> {
    match bytes.get(7) {
        Some(size @ (8 | 16 | 32 | 64)) => Ok(*size),
        other => Err(format!("bMaxPacketSize0 is {other:?}, expected 8, 16, 32 or 64")),
    }
}

/// A CDC ACM function: its interface for requests and its endpoints for data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Serial {
    /// bConfigurationValue.
    pub configuration: u8,
    /// Interface that takes the class requests.
    pub control_interface: u8,
    /// Endpoint for notifications and its interval in frames, if there is one.
    pub notification: Option<(u8, u16)>,
    /// Bulk endpoint to the host, and its packet size in bytes.
    pub input: (u8, u16),
    /// Bulk endpoint to the device, and its packet size in bytes.
    pub output: (u8, u16),
}

impl Serial {
    /// Finds the serial port in a whole configuration descriptor.
    ///
    /// # Errors
    ///
    /// The configuration is malformed, or lacks a part of a serial port; the text says which.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let configuration = match bytes {
            [9, CONFIGURATION, ..] if bytes.len() >= 9 => bytes[5],
            _ => {
                let head = &bytes[..bytes.len().min(9)];
                return Err(format!("the configuration descriptor begins with {head:02x?}, expected [09, 02]"));
            }
        };
        let mut classes = Vec::new();
        let mut class = 0;
        let (mut control_interface, mut notification, mut input, mut output) = (None, None, None, None);
        let mut rest = bytes;
        while let [length, kind, ..] = *rest {
            let length = usize::from(length);
            if length < 2 || length > rest.len() {
                return Err(format!("a descriptor has {length} bytes, expected 2 to {}", rest.len()));
            }
            let (one, after) = rest.split_at(length);
            rest = after;
            match (kind, one) {
                (INTERFACE, &[_, _, number, _, _, interface_class, subclass, ..]) => {
                    class = interface_class;
                    classes.push(class);
                    if (class, subclass) == (0x02, 0x02) {
                        control_interface = Some(number);
                    }
                }
                (ENDPOINT, &[_, _, address, attributes, low, high, interval, ..]) => {
                    let size = u16::from_le_bytes([low, high]) & 0x7FF;
                    let number = address & 0xF;
                    match (class, attributes & 3, address & 0x80 != 0) {
                        (0x02, 3, true) => notification = Some((number, u16::from(interval.max(1)))),
                        (0x0A, 2, to_host) => {
                            if size == 0 || size > BULK_PACKET {
                                return Err(format!(
                                    "bulk endpoint {address:#04x} has packets of {size} bytes, expected 1 to 64"
                                ));
                            }
                            *(if to_host { &mut input } else { &mut output }) = Some((number, size));
                        }
                        _ => {}
                    }
                }
                _ => {}
            }
        }
        let Some(control_interface) = control_interface else {
            return Err(format!("the device has no CDC ACM interface, only the classes {classes:02x?}"));
        };
        let (Some(input), Some(output)) = (input, output) else {
            return Err("the device's CDC data interface lacks a bulk endpoint in one direction".into());
        };
        Ok(Self { configuration, control_interface, notification, input, output })
    }
}

/// The text of a string descriptor.
#[must_use]
pub fn text(bytes: &[u8]) -> String {
    let pairs = bytes.get(2..).unwrap_or(&[]).as_chunks::<2>().0;
    let units: Vec<u16> = pairs.iter().map(|pair| u16::from_le_bytes(*pair)).collect();
    String::from_utf16_lossy(&units)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const ACM: [u8; 67] = [
        9, 2, 67, 0, 2, 1, 0, 0xC0, 50, 9, 4, 0, 0, 1, 2, 2, 1, 0, 5, 0x24, 0, 0x10, 1, 4, 0x24, 2, 2, 5, 0x24, 6, 0,
        1, 5, 0x24, 1, 0, 1, 7, 5, 0x83, 3, 8, 0, 16, 9, 4, 1, 0, 2, 0x0A, 0, 0, 0, 7, 5, 0x81, 2, 64, 0, 0, 7, 5,
        0x02, 2, 64, 0, 0,
    ];

    #[test]
    fn a_serial_port_is_found() {
        assert_eq!(
            Serial::parse(&ACM),
            Ok(Serial {
                configuration: 1,
                control_interface: 0,
                notification: Some((3, 16)),
                input: (1, 64),
                output: (2, 64),
            })
        );
    }

    #[test]
    fn another_class_is_reported() {
        let keyboard = [9, 2, 18, 0, 1, 1, 0, 0xC0, 50, 9, 4, 0, 0, 0, 3, 1, 1, 0];
        assert_eq!(Serial::parse(&keyboard), Err("the device has no CDC ACM interface, only the classes [03]".into()));
        assert!(Serial::parse(&ACM[..53]).unwrap_err().contains("lacks a bulk endpoint"));
        assert!(Serial::parse(&ACM[..60]).is_err());
    }

    #[test]
    fn damaged_descriptors_are_refused() {
        for length in 0..ACM.len() {
            let _ = Serial::parse(&ACM[..length]);
        }
        let mut damaged = ACM;
        damaged[9] = 0;
        assert!(Serial::parse(&damaged).unwrap_err().contains("has 0 bytes"));
        assert!(Device::parse(&[18, 1]).is_err());
        assert!(control_packet(&[18, 1, 0, 2, 0, 0, 0, 7]).is_err());
    }

    #[test]
    fn strings_are_utf_16() {
        assert_eq!(text(&[6, 3, b'o', 0, 0xE9, 0]), "o\u{e9}");
    }
}
