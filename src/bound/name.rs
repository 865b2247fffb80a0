//! What the bounds are called, and where each is stated.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize};

/// The theorem of a bound. In files and on the command line it is written in lower case with hyphens, e.g. `"end-fan"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum BoundName {
    /// [`super::locked()`].
    Locked,
    /// [`super::trace()`].
    Trace,
    /// [`super::edge_ratio()`].
    EdgeRatio,
    /// [`super::fan()`].
    Fan,
    /// [`super::end_fan()`].
    EndFan,
    /// [`super::vertex()`].
    Vertex,
    /// [`super::apex()`].
    Apex,
    /// [`super::certificate`].
    Gram,
    /// [`super::wedge()`].
    Wedge,
    /// [`super::caraman()`].
    Caraman,
    /// [`super::vertex_smooth()`].
    VertexSmooth,
    /// [`super::trace_smooth()`].
    TraceSmooth,
    /// [`super::trace_smooth()`], for maps that are continuously differentiable up to the boundary.
    TraceSmoothC1,
    /// [`super::edge_limit()`].
    EdgeLimit,
}

impl BoundName {
    /// Every bound there is.
    pub const ALL: [Self; 14] = [
        Self::Locked,
        Self::Trace,
        Self::EdgeRatio,
        Self::Fan,
        Self::EndFan,
        Self::Vertex,
        Self::Apex,
        Self::Gram,
        Self::Wedge,
        Self::Caraman,
        Self::VertexSmooth,
        Self::TraceSmooth,
        Self::TraceSmoothC1,
        Self::EdgeLimit,
    ];

    /// As files and summaries write it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Locked => "locked",
            Self::Trace => "trace",
            Self::EdgeRatio => "edge-ratio",
            Self::Fan => "fan",
            Self::EndFan => "end-fan",
            Self::Vertex => "vertex",
            Self::Apex => "apex",
            Self::Gram => "gram",
            Self::Wedge => "wedge",
            Self::Caraman => "caraman",
            Self::VertexSmooth => "vertex-smooth",
            Self::TraceSmooth => "trace-smooth",
            Self::TraceSmoothC1 => "trace-smooth-c1",
            Self::EdgeLimit => "edge-limit",
        }
    }

    /// Where it is stated: the docs of its function here, with the proof, or an equation of the paper.
    pub fn source(self) -> Source {
        match self {
            Self::Locked => "docs of qcball::bound::locked",
            Self::Trace => "docs of qcball::bound::trace",
            Self::EdgeRatio => "paper eq. 42, docs of qcball::bound::edge_ratio",
            Self::Fan => "docs of qcball::bound::fan",
            Self::EndFan => "docs of qcball::bound::end_fan",
            Self::Vertex => "docs of qcball::bound::vertex",
            Self::Apex => "docs of qcball::bound::apex",
            Self::Gram => "docs of qcball::bound::certificate",
            Self::Wedge => "paper eq. 39, 44",
            Self::Caraman => "paper eq. 41, after Caraman 1974",
            Self::VertexSmooth => "docs of qcball::bound::vertex_smooth",
            Self::TraceSmooth | Self::TraceSmoothC1 => "docs of qcball::bound::trace_smooth",
            Self::EdgeLimit => "docs of qcball::bound::edge_limit",
        }
    }
}

impl fmt::Display for BoundName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// The source of some bound. By this name, since serde would borrow a `&'static str` from what it reads.
pub type Source = &'static str;

/// A source as it stands in a record.
pub(super) fn known_source<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Source, D::Error> {
    let given = String::deserialize(deserializer)?;
    let found = BoundName::ALL.into_iter().map(BoundName::source).find(|source| *source == given);
    found.ok_or_else(|| serde::de::Error::custom(format!("{given:?} states no bound that this version knows")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for name in BoundName::ALL {
            assert_eq!(serde_json::to_value(name).unwrap(), name.as_str());
            assert_eq!(serde_json::from_value::<BoundName>(name.as_str().into()).unwrap(), name);
        }
    }
}
