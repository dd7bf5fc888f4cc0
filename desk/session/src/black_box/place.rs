//! Finds the place in the source at which a program ended.

use std::path::Path;

use addr2line::Loader;
use ferrostep_black_box::Identity;

/// Text before an address in the last words.
const AT: &str = " at 0x";

/// Folders of others' sources, as an image names them: the core library, and what
/// cargo has fetched.
const OF_OTHERS: [&str; 2] = ["/rust/", "/crates/"];

/// The image that a board ran, with its debug information.
pub struct Image(Loader);

impl Image {
    /// Opens the image that has left a black box.
    ///
    /// # Errors
    /// The image cannot be read, or did not write this black box.
    pub fn open(path: &Path, identity: &Identity<'_>) -> Result<Self, String> {
        let name = path.display();
        let bytes = std::fs::read(path).map_err(|error| format!("{name}: {error}"))?;
        let Identity { version, board, profile, .. } = identity;
        let built_as = format!("{version} {board} {profile}");
        if !bytes.windows(built_as.len()).any(|window| window == built_as.as_bytes()) {
            return Err(format!(
                "{name}: not the image that has left this black box, ferrostep {built_as}: expected the ferrostep.elf that was flashed"
            ));
        }
        let loader = Loader::new(path).map_err(|error| format!("{name}: {error}"))?;
        Ok(Self(loader))
    }

    /// The places of the address in last words, the innermost first: files with their lines, of our
    /// own sources where there are any.
    pub fn place(&self, last_words: &str) -> Option<String> {
        let (_, address) = last_words.split_once(AT)?;
        let digits = address.find(|char: char| !char.is_ascii_hexdigit()).unwrap_or(address.len());
        let address = u64::from_str_radix(address.get(..digits)?, 16).ok()?;
        let mut frames = self.0.find_frames(address).ok()?;
        let mut places = Vec::new();
        while let Ok(Some(frame)) = frames.next() {
            let Some(location) = frame.location else { continue };
            if let (Some(file), Some(line)) = (location.file, location.line) {
                places.push((file.to_owned(), line));
            }
        }
        let is_own = |(file, _): &(String, u32)| !OF_OTHERS.iter().any(|folder| file.starts_with(folder));
        if places.iter().any(is_own) {
            places.retain(is_own);
        }
        let named: Vec<String> = places.into_iter().map(|(file, line)| format!("{file}:{line}")).collect();
        (!named.is_empty()).then(|| named.join(", from "))
    }
}
