//! How far a mesh is refined, and how many tets may be added.

/// How far a mesh is refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineSettings {
    /// Most rounds; each may add its part of the tets.
    pub rounds: usize,
    /// Most tets that may be added in all.
    pub tets: Budget,
    /// Relative distance from [`unchanging_bound`](super::unchanging_bound) within which there is nothing left to gain, where the surface stays as it is.
    pub until: f64,
    /// Whether edges of the surface are halved as well, and K onto the ball is what counts.
    pub surface: bool,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { rounds: 8, tets: Budget::Share(0.1), until: 0.02, surface: false }
    }
}

impl RefineSettings {
    /// What is usual where edges of the surface are halved: a coarse surface that opens a little has a larger K onto the ball at first.
    pub fn of_surface() -> Self {
        Self { rounds: 12, tets: Budget::Share(6.0), surface: true, ..Self::default() }
    }
}

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
