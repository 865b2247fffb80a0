//! Text formats as streams of tokens that know their line, with raw bytes between them where a format is half binary.

use std::str::FromStr;

use super::text::reworded_number;

/// A line, where one is to blame, and what is wrong there.
pub(super) type Fault = (Option<usize>, String);

/// The unread rest of a file.
#[derive(Clone)]
pub(super) struct Tokens<'a> {
    rest: &'a [u8],
    line: usize,
    /// The line of the last token.
    last: usize,
    comments: bool,
}

/// A word of a text format.
#[derive(Clone, Copy)]
pub(super) struct Token<'a> {
    pub(super) text: &'a [u8],
    pub(super) line: usize,
}

impl<'a> Iterator for Tokens<'a> {
    type Item = Token<'a>;

    fn next(&mut self) -> Option<Token<'a>> {
        self.skip_space();
        let ends = |&b: &u8| is_space(b) || b == b'#' && self.comments;
        let end = self.rest.iter().position(ends).unwrap_or(self.rest.len());
        self.take(end)
    }
}

impl<'a> Tokens<'a> {
    /// Tokens between white space; every byte but the white space is part of one.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, line: 1, last: 1, comments: false }
    }

    /// Tokens between white space, where `#` starts a comment that ends with its line.
    pub(super) fn with_comments(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, line: 1, last: 1, comments: true }
    }

    /// A part of a file, with the number of its first line.
    pub(super) fn starting_at(bytes: &'a [u8], line: usize) -> Self {
        Self { rest: bytes, line, last: line, comments: false }
    }

    fn skip_space(&mut self) {
        loop {
            match self.rest.first() {
                Some(b'#') if self.comments => {
                    let end = self.rest.iter().position(|&b| b == b'\n').unwrap_or(self.rest.len());
                    self.rest = &self.rest[end..];
                }
                Some(&byte) if is_space(byte) => {
                    self.line += usize::from(byte == b'\n');
                    self.rest = &self.rest[1..];
                }
                _ => return,
            }
        }
    }

    /// The next `length` bytes as a token; none of no bytes.
    fn take(&mut self, length: usize) -> Option<Token<'a>> {
        let (text, rest) = self.rest.split_at(length);
        self.rest = rest;
        self.last = if text.is_empty() { self.last } else { self.line };
        (!text.is_empty()).then_some(Token { text, line: self.line })
    }

    /// The first `length` bytes of the next token, as one; the others stay unread.
    pub(super) fn part(&mut self, length: usize) -> Option<Token<'a>> {
        self.skip_space();
        self.take(length.min(self.rest.len()))
    }

    /// All that is unread.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// The line of the last token.
    pub(super) fn last_line(&self) -> usize {
        self.last
    }

    /// The line of the next byte.
    pub(super) fn line(&self) -> usize {
        self.line
    }

    /// How many bytes are unread.
    pub(super) fn left(&self) -> usize {
        self.rest.len()
    }

    /// The next token; the end of the file is a fault, which says what was wanted.
    pub(super) fn expect(&mut self, wanted: &str) -> Result<Token<'a>, Fault> {
        let line = self.line;
        self.next()
            .ok_or_else(|| (Some(line), format!("the file ends before {wanted}: it is truncated; write it anew")))
    }

    /// The next token if it is as wanted; what is there otherwise, raw bytes perhaps, stays unread.
    pub(super) fn next_if(&mut self, wanted: impl Fn(Token) -> bool) -> Option<Token<'a>> {
        let before = self.clone();
        let token = self.next().filter(|&token| wanted(token));
        if token.is_none() {
            *self = before;
        }
        token
    }

    /// The next token as a number.
    pub(super) fn number<T: FromStr>(&mut self, what: &str, expected: &str) -> Result<T, Fault> {
        self.expect(what)?.parse(what, expected)
    }

    /// The next token as a count of entries that take `least_bytes` each at the least; refused when the rest of the file
    /// cannot hold them, before anything is reserved for them.
    pub(super) fn bounded_count(&mut self, what: &str, least_bytes: usize) -> Result<usize, Fault> {
        let token = self.expect(what)?;
        let count = token.parse(what, "a whole number >= 0")?;
        self.check_room(count, least_bytes, what).map_err(|(_, message)| (Some(token.line), message))
    }

    /// The count, if the rest of the file can hold so many entries of `least_bytes` each and they can be numbered.
    pub(super) fn check_room(&self, count: u64, least_bytes: usize, what: &str) -> Result<usize, Fault> {
        // The last token of a file needs no separator.
        let most = (self.rest.len() as u64 + 1) / least_bytes as u64;
        if count > most || count > u64::from(u32::MAX) {
            let message = format!(
                "{what} is {count}, but the rest of the file has room for at most {most}: the count is wrong or the file \
                 is truncated; write it anew"
            );
            return Err((Some(self.line), message));
        }
        Ok(count as usize)
    }

    /// The rest of the current line, without its end.
    pub(super) fn rest_of_line(&mut self) -> &'a [u8] {
        let end = self.rest.iter().position(|&b| b == b'\n').unwrap_or(self.rest.len());
        let (text, rest) = self.rest.split_at(end);
        self.rest = rest.get(1..).unwrap_or_default();
        self.line += usize::from(!rest.is_empty());
        text
    }

    /// The next `count` bytes, whatever they are.
    pub(super) fn bytes(&mut self, count: usize, what: &str) -> Result<&'a [u8], Fault> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let message =
                format!("the file ends within {what}: {count} bytes are needed, {} are there", self.rest.len());
            return Err((Some(self.line), message));
        };
        self.rest = rest;
        Ok(taken)
    }

    /// Goes on after the next occurrence of `mark`; false when there is none, and nothing is read then.
    pub(super) fn skip_past(&mut self, mark: &[u8]) -> bool {
        let Some(at) = find(self.rest, mark) else { return false };
        let (skipped, rest) = self.rest.split_at(at + mark.len());
        self.line += skipped.iter().filter(|&&b| b == b'\n').count();
        self.rest = rest;
        true
    }
}

impl Token<'_> {
    /// The token as it may stand in a message: short, and printable whatever the file holds.
    pub(super) fn shown(self) -> String {
        const LONGEST: usize = 40;
        let shown = self.text[..self.text.len().min(LONGEST)].escape_ascii().to_string();
        if self.text.len() > LONGEST { format!("`{shown}...`") } else { format!("`{shown}`") }
    }

    /// The token as a number; Fortran's and Microsoft's ways to write one are known.
    pub(super) fn value<T: FromStr>(self) -> Option<T> {
        let text = std::str::from_utf8(self.text).ok()?;
        text.parse().ok().or_else(|| reworded_number(text)?.parse().ok())
    }

    /// The token as a number, or a fault which says what stands there and what should.
    pub(super) fn parse<T: FromStr>(self, what: &str, expected: &str) -> Result<T, Fault> {
        self.value().ok_or_else(|| (Some(self.line), format!("{what} is {}, but should be {expected}", self.shown())))
    }
}

/// White space; zeros, with which some writers fill a text up, are such.
fn is_space(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == 0
}

/// The line of a place in the file, counted from 1.
pub(super) fn line_at(file: &[u8], at: usize) -> usize {
    1 + file[..at].iter().filter(|&&b| b == b'\n').count()
}

/// Where `mark` first occurs.
pub(super) fn find(bytes: &[u8], mark: &[u8]) -> Option<usize> {
    let (&first, _) = mark.split_first()?;
    let mut from = 0;
    while let Some(at) = bytes[from..].iter().position(|&b| b == first).map(|at| from + at) {
        if bytes[at..].starts_with(mark) {
            return Some(at);
        }
        from = at + 1;
    }
    None
}
