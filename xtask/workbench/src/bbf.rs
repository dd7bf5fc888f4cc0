//! An image in Prusa's container (`.bbf`), as the boot loader of the MINI takes it
//! from a USB stick.
//!
//! The first version of the format, which boot loaders before and after 2.0 read: a signature, the
//! SHA-256 of all that follows, a header, the image. Source: Prusa-Firmware-Buddy,
//! `utils/pack_fw.py` and `utils/unpack_bbf.py`. Only Prusa can sign: the signature here is zeros,
//! which a boot loader accepts once the board's appendix is broken.

use ferrostep_boards::BBF_HEADER_BYTES;
use sha2::{Digest, Sha256};

use crate::steps::Failure;

/// Bytes of the signature, which is not written to flash.
const SIGNATURE_BYTES: usize = 64;

/// Bytes of the SHA-256, the first that flash holds.
const HASH_BYTES: usize = 32;

/// Bytes of the header after it.
const HEADER_BYTES: usize = BBF_HEADER_BYTES as usize - HASH_BYTES;

/// Prusa's printer type of the MINI, the only one with this chip.
const PRINTER_MINI: u8 = 2;

/// The printer's version; readers take the same byte for the format's, the first.
const PRINTER_VERSION: u8 = 1;

/// A version's three numbers.
///
/// # Errors
/// The text is not `major.minor.patch`, each from 0 to 255: the header has a byte for each.
fn numbers(version: &str) -> Result<[u8; 3], Failure> {
    let core = version.split(['-', '+']).next().unwrap_or_default();
    let parts: Result<Vec<u8>, _> = core.split('.').map(str::parse).collect();
    parts.ok().and_then(|parts| parts.try_into().ok()).ok_or_else(|| {
        format!("version {version}: expected three numbers from 0 to 255, for which the header of a .bbf has room")
    })
}

/// The container of an image.
///
/// # Errors
/// The version does not fit the header, or the image its length.
pub fn pack(image: &[u8], version: &str) -> Result<Vec<u8>, Failure> {
    let length = u32::try_from(image.len()).map_err(|_| "the image is longer than 4 GiB".to_owned())?;
    let mut hashed = length.to_le_bytes().to_vec();
    hashed.extend(numbers(version)?);
    // Number of the build, and five letters of a pre-release.
    hashed.extend([0; 2 + 5]);
    // The board's version, the printer, its version and subversion.
    hashed.extend([0, PRINTER_MINI, PRINTER_VERSION, 0]);
    hashed.resize(HEADER_BYTES, 0);
    hashed.extend_from_slice(image);
    let mut file = vec![0; SIGNATURE_BYTES];
    file.extend_from_slice(&Sha256::digest(&hashed));
    file.extend(hashed);
    Ok(file)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Offsets as `utils/unpack_bbf.py` reads them.
    #[test]
    fn the_fields_are_where_the_boot_loader_reads_them() {
        let image: Vec<u8> = (0..1000_u32).map(|byte| byte as u8).collect();
        let file = pack(&image, "3.14.159-rc1").unwrap();
        assert_eq!(file.len(), 64 + 512 + 1000);
        assert_eq!(file[..64], [0; 64], "unsigned");
        assert_eq!(file[64..96], Sha256::digest(&file[96..])[..]);
        assert_eq!(file[96..100], [0xe8, 0x03, 0, 0], "the image's length");
        assert_eq!(file[100..103], [3, 14, 159]);
        assert_eq!(file[103..110], [0; 7], "build and pre-release");
        // Board, printer, version of printer or format, subversion.
        assert_eq!(file[110..114], [0, 2, 1, 0]);
        assert!(file[114..576].iter().all(|byte| *byte == 0));
        assert_eq!(file[576..], image);
    }

    /// The hash of "abc" (FIPS 180-2, appendix B.1).
    #[test]
    fn the_hash_is_sha_256() {
        let hash: String = Sha256::digest(b"abc").iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hash, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    fn a_version_that_does_not_fit_is_refused() {
        for version in ["1.2", "1.2.3.4", "1.2.256", "1.x.3", ""] {
            assert!(pack(&[], version).unwrap_err().contains("expected three numbers"), "{version}");
        }
        assert!(pack(&[], env!("CARGO_PKG_VERSION")).is_ok());
    }
}
