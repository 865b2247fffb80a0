//! What is done to a file: changes of bytes, pieces and numbers, and pieces of another file.

/// Random numbers by a counter (splitmix64: Steele, Lea and Flood, *Fast Splittable Pseudorandom Number Generators*, 2014).
pub struct Random(u64);

impl Random {
    /// The numbers of one input.
    pub fn new(seed: u64, input: u64) -> Self {
        Self(seed.wrapping_mul(0xA076_1D64_78BD_642F) ^ input.wrapping_mul(0xE703_7ED1_A0B4_28DB))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// Any number below `bound`, which is at least 1.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }
}

/// Numbers and words that readers have stumbled over elsewhere.
const WORDS: [&str; 24] = [
    "0",
    "-1",
    "1",
    "2",
    "255",
    "65536",
    "4294967295",
    "4294967296",
    "2147483648",
    "1000000000000000000",
    "18446744073709551615",
    "99999999999999999999",
    "-9223372036854775808",
    "nan",
    "-inf",
    "1e999",
    "1e-320",
    "1d5",
    "\\",
    "#",
    "\"",
    "<Piece>",
    "end",
    "\u{feff}",
];

/// The bytes after one to six changes.
pub fn damaged(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(6) {
        change(&mut bytes, other, random);
    }
    bytes
}

fn change(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    let length = bytes.len();
    if length == 0 {
        bytes.push(random.next() as u8);
        return;
    }
    let at = random.below(length);
    let piece = |random: &mut Random, most: usize| at..length.min(at + 1 + random.below(most));
    match random.below(12) {
        0..3 => bytes[at] = random.next() as u8,
        3 => bytes[at] ^= 1 << random.below(8),
        4 => {
            bytes.drain(piece(random, 40));
        }
        5 => {
            let part = bytes[piece(random, 40)].to_vec();
            let to = random.below(length);
            bytes.splice(to..to, part);
        }
        6 => bytes.truncate(at),
        7 if !other.is_empty() => {
            let from = random.below(other.len());
            let part = &other[from..other.len().min(from + 1 + random.below(200))];
            bytes.splice(at..at, part.iter().copied());
        }
        8 => {
            let word = WORDS[random.below(WORDS.len())];
            bytes.splice(at..at, word.bytes());
        }
        9 => {
            // Four or eight bytes of a binary number.
            let fill = [0, 0xFF, 0x7F, 0x80][random.below(4)];
            let end = length.min(at + [4, 8][random.below(2)]);
            bytes[at..end].fill(fill);
        }
        _ => {
            // A number becomes another one.
            let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else { return };
            let end =
                bytes[start..].iter().position(|byte| !byte.is_ascii_digit()).map_or(length, |offset| start + offset);
            let word = WORDS[random.below(18)];
            bytes.splice(start..end, word.bytes());
        }
    }
}
