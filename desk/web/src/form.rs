//! Receives a slicer's upload: a form with one file and some short fields. The file is written to a
//! temporary file as it arrives.

use std::io::{self, Read, Write};

use futures_util::stream;
use multer::bytes::Bytes;
use multer::{Constraints, Field, Multipart, SizeLimit};
use tempfile::NamedTempFile;

use crate::answer::Answer;
use crate::deadline::is_slow;
use crate::printer::Upload;
use crate::upload::{PORTION_BYTES, not_kept, too_slow};

/// Maximum length of a field other than the file, bytes.
const MAX_WORD_BYTES: u64 = 256;

/// Maximum length of a file name, bytes.
const MAX_NAME_BYTES: usize = 200;

/// A form that has arrived completely.
#[derive(Debug)]
pub struct Form {
    /// Uploaded file.
    pub upload: Upload,
    /// True if the file must be printed at once.
    pub prints: bool,
}

/// Receives a form by reading `body` to its end.
///
/// # Errors
/// The answer to a form that is broken, has unknown fields, names a folder, or whose file cannot be
/// stored.
pub fn receive(body: impl Read + Send, content_type: Option<&str>) -> Result<Form, Answer> {
    let boundary = multer::parse_boundary(content_type.unwrap_or_default()).map_err(|_| {
        Answer::text(400, "an upload is a form: send it as multipart/form-data, with its boundary in Content-Type")
    })?;
    let words = SizeLimit::new().per_field(MAX_WORD_BYTES).for_field("file", u64::MAX);
    let constraints = Constraints::new().size_limit(words);
    let form = Multipart::with_constraints(stream::iter(portions(body)), boundary, constraints);
    // `block_on` never waits: the stream blocks in its read and is ready when that returns.
    pollster::block_on(fields(form))
}

/// Splits a body into portions, up to its end or the first error.
fn portions(mut body: impl Read + Send) -> impl Iterator<Item = io::Result<Bytes>> + Send {
    let mut portion = vec![0; PORTION_BYTES];
    let mut has_failed = false;
    std::iter::from_fn(move || {
        if has_failed {
            return None;
        }
        match body.read(&mut portion) {
            Ok(0) => None,
            Ok(read) => Some(Ok(Bytes::copy_from_slice(portion.get(..read).unwrap_or_default()))),
            Err(error) => {
                has_failed = true;
                Some(Err(error))
            }
        }
    })
}

/// Reads all fields.
async fn fields(mut form: Multipart<'_>) -> Result<Form, Answer> {
    let (mut upload, mut prints) = (None, false);
    while let Some(field) = form.next_field().await.map_err(broken)? {
        match field.name().unwrap_or_default().to_owned().as_str() {
            "file" if upload.is_some() => return Err(Answer::text(400, "the form has two files: send one at a time")),
            "file" => upload = Some(file(field).await?),
            "print" => prints = is_true("print", &field.text().await.map_err(broken)?)?,
            // The newest file is always the selected one here.
            "select" => drop(is_true("select", &field.text().await.map_err(broken)?)?),
            "path" => {
                let folder = field.text().await.map_err(broken)?;
                if !matches!(folder.as_str(), "" | "/") {
                    return Err(Answer::text(400, "there are no folders here: leave the file's folder empty"));
                }
            }
            other => {
                let other: String = other.chars().filter(|char| !char.is_control()).collect();
                let why = format!("the form has an unknown field \"{other}\": send only file, print, select and path");
                return Err(Answer::text(400, why));
            }
        }
    }
    let upload = upload.ok_or_else(|| Answer::text(400, "the form has no file: send it as its field \"file\""))?;
    if upload.bytes == 0 {
        return Err(Answer::text(400, format!("{}: the file is empty", upload.name)));
    }
    Ok(Form { upload, prints })
}

/// Stores the form's file.
async fn file(mut field: Field<'_>) -> Result<Upload, Answer> {
    let name = name(field.file_name().unwrap_or_default())?;
    let mut file = NamedTempFile::new().map_err(not_kept)?;
    let mut bytes = 0_u64;
    while let Some(portion) = field.chunk().await.map_err(broken)? {
        file.write_all(&portion).map_err(not_kept)?;
        bytes = bytes.saturating_add(portion.len() as u64);
    }
    file.flush().map_err(not_kept)?;
    Ok(Upload { name, file, bytes })
}

/// Checks a file's name. The name is only shown, but must not look like the path of another file.
fn name(name: &str) -> Result<String, Answer> {
    let is_path = name.contains(['/', '\\']) || matches!(name, "." | "..");
    if is_path || name.chars().any(char::is_control) {
        return Err(Answer::text(
            400,
            "the file's name has a folder or a control character in it: send the name alone",
        ));
    }
    if name.is_empty() || name.len() > MAX_NAME_BYTES {
        return Err(Answer::text(400, format!("a file's name has 1 to {MAX_NAME_BYTES} bytes")));
    }
    Ok(name.to_owned())
}

/// Parses a yes or no, in OctoPrint's words.
fn is_true(field: &str, word: &str) -> Result<bool, Answer> {
    match word.to_ascii_lowercase().as_str() {
        "true" | "yes" | "y" | "1" => Ok(true),
        "false" | "no" | "n" | "0" | "" => Ok(false),
        _ => Err(Answer::text(400, format!("the form's field \"{field}\" is true or false"))),
    }
}

/// Returns the answer to a form that is broken or incomplete.
fn broken(error: multer::Error) -> Answer {
    match error {
        multer::Error::StreamReadFailed(error) if error.downcast_ref::<io::Error>().is_some_and(is_slow) => too_slow(),
        multer::Error::FieldSizeExceeded { .. } => {
            Answer::text(413, format!("a field beside the file has more than {MAX_WORD_BYTES} bytes"))
        }
        error => Answer::text(400, format!("the form did not come whole: {error}")),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const KIND: &str = "multipart/form-data; boundary=----line";

    /// Builds a form's body from fields: name, file name, text.
    fn body(fields: &[(&str, Option<&str>, &str)]) -> String {
        let parts = fields.iter().map(|(name, file, text)| {
            let file = file.map_or_else(String::new, |file| format!("; filename=\"{file}\""));
            format!("------line\r\nContent-Disposition: form-data; name=\"{name}\"{file}\r\n\r\n{text}\r\n")
        });
        parts.collect::<String>() + "------line--\r\n"
    }

    fn status(fields: &[(&str, Option<&str>, &str)]) -> Result<bool, u16> {
        receive(body(fields).as_bytes(), Some(KIND)).map(|form| form.prints).map_err(|answer| answer.status)
    }

    /// Reader that returns one byte at a time.
    struct Trickle<'a>(&'a [u8]);

    impl Read for Trickle<'_> {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            let room = bytes.len().min(1);
            self.0.read(&mut bytes[..room])
        }
    }

    /// The file contains the beginning of the boundary, line ends of both systems, and bytes that
    /// are not text.
    #[test]
    fn a_file_keeps_its_bytes_however_they_come() {
        let content = "G28\r\n------lin\r\n\r\n--\n\u{0}M84\n";
        let body = body(&[("print", None, "true"), ("path", None, ""), ("file", Some("a b.gcode"), content)]);
        for form in [receive(body.as_bytes(), Some(KIND)), receive(Trickle(body.as_bytes()), Some(KIND))] {
            let Form { upload, prints } = form.unwrap();
            assert_eq!((upload.name.as_str(), upload.bytes, prints), ("a b.gcode", content.len() as u64, true));
            assert_eq!(std::fs::read(upload.file.path()).unwrap(), content.as_bytes());
            let path = upload.file.path().to_owned();
            drop(upload);
            assert!(!path.exists());
        }
    }

    #[test]
    fn words_are_read_in_any_order_or_refused() {
        let file = ("file", Some("a.gcode"), "G28\n");
        assert_eq!(status(&[file]), Ok(false));
        assert_eq!(status(&[file, ("select", None, "true"), ("print", None, "True")]), Ok(true));
        assert_eq!(status(&[("print", None, "false"), ("path", None, "/"), file]), Ok(false));
        for fields in [
            &[][..],
            &[("print", None, "true")],
            &[file, file],
            &[file, ("print", None, "perhaps")],
            &[file, ("path", None, "parts")],
            &[file, ("foldername", None, "parts")],
            &[("file", None, "G28\n")],
            &[("file", Some("a.gcode"), "")],
        ] {
            assert_eq!(status(fields), Err(400), "{fields:?}");
        }
        assert_eq!(status(&[("print", None, &"t".repeat(300)), file]), Err(413));
    }

    #[test]
    fn a_name_with_a_folder_is_refused() {
        for name in ["../a.gcode", "/etc/passwd", "..", "a/b", "a\\b", "..\\a", "", &"a".repeat(300)] {
            assert_eq!(status(&[("file", Some(name), "G28\n")]), Err(400), "{name}");
        }
        assert_eq!(status(&[("file", Some("..a.gcode"), "G28\n")]), Ok(false));
    }

    #[test]
    fn what_is_no_form_or_cut_off_is_refused() {
        let whole = body(&[("file", Some("a.gcode"), "G28\nG1 X5\n")]);
        for length in 0..whole.len() - "--\r\n".len() {
            let answer = receive(&whole.as_bytes()[..length], Some(KIND)).unwrap_err();
            assert_eq!(answer.status, 400, "{length}");
        }
        for kind in [None, Some("text/plain"), Some("multipart/form-data"), Some("multipart/form-data; boundary=other")]
        {
            assert_eq!(receive(whole.as_bytes(), kind).unwrap_err().status, 400, "{kind:?}");
        }
    }

    #[test]
    fn a_slow_client_and_a_full_disk_have_their_own_answers() {
        struct Slow;
        impl Read for Slow {
            fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
                Err(io::ErrorKind::TimedOut.into())
            }
        }
        let start = body(&[("file", Some("a.gcode"), "G28\n")]);
        let answer = receive(start.as_bytes()[..90].chain(Slow), Some(KIND)).unwrap_err();
        assert_eq!(answer.status, 408);
        assert_eq!(not_kept(io::ErrorKind::StorageFull.into()).status, 507);
    }
}
