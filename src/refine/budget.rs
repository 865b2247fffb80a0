//! How many tets may be added.

/// A number of tets, written like 500 or "5 %".
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// So many.
    Tets(usize),
    /// This share of those that a mesh has.
    Share(f64),
}

impl std::str::FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let refused = || format!("{text:?} is no number of tets: write for example 500, or \"5 %\" of those there are");
        match text.trim().strip_suffix('%') {
            None => text.trim().parse().map(Self::Tets).map_err(|_| refused()),
            Some(percent) => match percent.trim().parse::<f64>() {
                Ok(percent) if percent >= 0.0 && percent.is_finite() => Ok(Self::Share(percent / 100.0)),
                _ => Err(refused()),
            },
        }
    }
}

impl Budget {
    /// The number for a mesh of so many tets.
    pub fn of(self, tets: usize) -> usize {
        match self {
            Self::Tets(count) => count,
            Self::Share(share) => (share * tets as f64) as usize,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_are_numbers_or_shares() {
        assert_eq!("500".parse(), Ok(Budget::Tets(500)));
        assert_eq!(" 12.5 % ".parse(), Ok(Budget::Share(0.125)));
        for text in ["", "-1", "5 percent", "-1 %", "inf %", "1e3"] {
            assert!(text.parse::<Budget>().unwrap_err().contains("\"5 %\""), "{text}");
        }
        assert_eq!([Budget::Tets(7), Budget::Share(0.05)].map(|budget| budget.of(100)), [7, 5]);
    }
}
