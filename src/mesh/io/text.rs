//! What all text formats share: marks before the first line, ends of lines, numbers as other languages write them.

use std::path::Path;

use super::ReadError;

/// The mark that some editors put before text in UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// The bytes of a text without its byte-order mark, lines ended by `\n`.
///
/// # Errors
/// Text in UTF-16, in which no format here is.
pub(super) fn plain(path: &Path, mut bytes: Vec<u8>) -> Result<Vec<u8>, ReadError> {
    if bytes.starts_with(BYTE_ORDER_MARK) {
        bytes.drain(..BYTE_ORDER_MARK.len());
    }
    if is_utf16(&bytes) {
        let message = "the file is text in UTF-16; save it in UTF-8".into();
        return Err(ReadError::Malformed { path: path.into(), line: None, message });
    }
    // Zeros are a sign of binary numbers.
    if !bytes.contains(&b'\n') && !bytes.contains(&0) {
        bytes.iter_mut().filter(|byte| **byte == b'\r').for_each(|byte| *byte = b'\n');
    }
    Ok(bytes)
}

/// By the mark, or by the zeros between the first letters.
fn is_utf16(bytes: &[u8]) -> bool {
    let letter = |byte: u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    match *bytes {
        [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => true,
        [a, 0, b, 0, ..] | [0, a, 0, b, ..] => letter(a) && letter(b),
        _ => false,
    }
}

/// A number that Rust does not know as one that it does: Fortran's exponents and what Microsoft's C makes of NaN.
pub(super) fn reworded_number(text: &str) -> Option<String> {
    let lower = text.to_ascii_lowercase();
    if lower.contains("nan(") || ["#ind", "#qnan", "#snan", "#inf"].iter().any(|mark| lower.contains(mark)) {
        return Some("nan".into());
    }
    // A `d` in other places does not become a number by this either.
    lower.contains('d').then(|| lower.replace('d', "e"))
}

/// A part of a file as it may stand in a message: short, and printable whatever the file holds.
pub(super) fn shown(text: &str) -> String {
    const LONGEST: usize = 60;
    let short: String = text.trim().chars().take(LONGEST).collect();
    let dots = if short.len() < text.trim().len() { "..." } else { "" };
    format!("{}{dots}", short.escape_debug())
}

/// Whether a character of a name does something to a terminal or to the lines around it instead of being shown: controls, line
/// breaks, and marks that turn the direction of the text.
pub(crate) fn is_harmful(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}')
}

/// A name with every such character escaped.
pub(crate) fn on_one_line(name: &str) -> String {
    name.chars().map(|c| if is_harmful(c) { c.escape_default().to_string() } else { c.to_string() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_on_one_line() {
        assert_eq!(on_one_line("M\u{fc}ller \u{5bf}\u{20ac}.off"), "M\u{fc}ller \u{5bf}\u{20ac}.off");
        assert_eq!(on_one_line("a\nerror: b\r\u{1b}\u{202e}\u{2028}"), r"a\nerror: b\r\u{1b}\u{202e}\u{2028}");
    }

    #[test]
    fn numbers_of_other_languages() {
        let read = |text: &str| reworded_number(text).and_then(|text| text.parse::<f64>().ok());
        assert_eq!(read("1D+00"), Some(1.0));
        assert_eq!(read("-2.5d-3"), Some(-0.0025));
        assert!(["-nan(ind)", "1.#QNAN", "-1.#IND00"].iter().all(|text| read(text).is_some_and(f64::is_nan)));
        assert_eq!((read("dd"), read("x")), (None, None));
    }

    #[test]
    fn marks_go_and_wide_text_is_refused() {
        let plain = |bytes: &[u8]| plain(Path::new("a"), bytes.to_vec());
        assert_eq!(plain(b"\xEF\xBB\xBFv 1\rv 2").unwrap(), b"v 1\nv 2");
        assert_eq!(plain(b"v 1\r\nv 2").unwrap(), b"v 1\r\nv 2");
        for wide in [&b"\xFF\xFEv\0 \0"[..], b"\xFE\xFF\0v\0 ", b"v\0 \0", b"\0v\0 "] {
            assert!(plain(wide).unwrap_err().to_string().contains("UTF-16"));
        }
        assert!(plain(&[1, 0, 0, 0, 2, 0, 0, 0]).is_ok(), "a binary file is none");
    }
}
