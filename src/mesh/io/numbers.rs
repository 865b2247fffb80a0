//! Arrays of numbers as text or as bytes, of the types that VTK and Gmsh know.

use super::tokens::{Fault, Tokens};

/// How one number stands in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Int8,
    UInt8,
    Int16,
    UInt16,
    Int32,
    UInt32,
    Int64,
    UInt64,
    Float32,
    Float64,
}

/// How a file writes its arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    BigEndian,
    LittleEndian,
}

/// An array, read. An unsigned number beyond Int64 becomes a negative one, which is no index either.
#[derive(Debug)]
pub(super) enum Numbers {
    Integers(Vec<i64>),
    Floats(Vec<f64>),
}

impl Numbers {
    /// As real numbers; integers beyond 2^53 are rounded.
    pub(super) fn into_floats(self) -> Vec<f64> {
        match self {
            Numbers::Integers(values) => values.into_iter().map(|value| value as f64).collect(),
            Numbers::Floats(values) => values,
        }
    }

    /// As indices; none for an array of floats.
    pub(super) fn into_integers(self) -> Option<Vec<i64>> {
        match self {
            Numbers::Integers(values) => Some(values),
            Numbers::Floats(_) => None,
        }
    }
}

impl Kind {
    /// Bytes a number takes in a binary file.
    pub(super) fn size(self) -> usize {
        match self {
            Kind::Int8 | Kind::UInt8 => 1,
            Kind::Int16 | Kind::UInt16 => 2,
            Kind::Int32 | Kind::UInt32 | Kind::Float32 => 4,
            Kind::Int64 | Kind::UInt64 | Kind::Float64 => 8,
        }
    }

    /// Reads `count` numbers; refused when the rest of the file cannot hold them, before anything is reserved.
    pub(super) fn read(
        self,
        tokens: &mut Tokens,
        encoding: Encoding,
        count: u64,
        what: &str,
    ) -> Result<Numbers, Fault> {
        if encoding == Encoding::Text {
            return self.read_text(tokens, count, what);
        }
        let too_many = || (Some(tokens.line()), format!("{what} has {count} numbers, more than the file has bytes"));
        let bytes = usize::try_from(count).ok().and_then(|count| count.checked_mul(self.size()));
        let bytes = bytes.ok_or_else(too_many)?;
        Ok(self.decode(tokens.bytes(bytes, what)?, encoding == Encoding::BigEndian))
    }

    fn read_text(self, tokens: &mut Tokens, count: u64, what: &str) -> Result<Numbers, Fault> {
        // A digit and a separator each, but for the last of the file.
        let most = (tokens.left() as u64).div_ceil(2);
        if count > most {
            let message =
                format!("{what} should have {count} numbers, but the rest of the file has room for at most {most}");
            return Err((Some(tokens.line()), message));
        }
        if matches!(self, Kind::Float32 | Kind::Float64) {
            let values = (0..count).map(|_| tokens.number(what, "a number")).collect::<Result<_, _>>()?;
            return Ok(Numbers::Floats(values));
        }
        let values = (0..count).map(|_| tokens.number(what, "a whole number")).collect::<Result<_, _>>()?;
        Ok(Numbers::Integers(values))
    }

    /// The numbers that whole bytes hold; a partial one at the end is dropped.
    pub(super) fn decode(self, bytes: &[u8], big_endian: bool) -> Numbers {
        macro_rules! numbers {
            ($kind:ident as $wide:ident) => {{
                let (whole, _) = bytes.as_chunks::<{ size_of::<$kind>() }>();
                let read = if big_endian { $kind::from_be_bytes } else { $kind::from_le_bytes };
                whole.iter().map(|&bytes| read(bytes) as $wide).collect()
            }};
        }
        match self {
            Kind::Int8 => Numbers::Integers(numbers!(i8 as i64)),
            Kind::UInt8 => Numbers::Integers(numbers!(u8 as i64)),
            Kind::Int16 => Numbers::Integers(numbers!(i16 as i64)),
            Kind::UInt16 => Numbers::Integers(numbers!(u16 as i64)),
            Kind::Int32 => Numbers::Integers(numbers!(i32 as i64)),
            Kind::UInt32 => Numbers::Integers(numbers!(u32 as i64)),
            Kind::Int64 => Numbers::Integers(numbers!(i64 as i64)),
            Kind::UInt64 => Numbers::Integers(numbers!(u64 as i64)),
            Kind::Float32 => Numbers::Floats(numbers!(f32 as f64)),
            Kind::Float64 => Numbers::Floats(numbers!(f64 as f64)),
        }
    }
}
