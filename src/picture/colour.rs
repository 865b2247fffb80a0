//! Figures as colours.

use std::f64::consts::{PI, TAU};

use clap::ValueEnum;
use colorous::Gradient;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cut::{Corner, Polygon};
use super::figures::Figures;
use crate::mesh::Vec3;

/// What the colours of a picture mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Colour {
    /// K of each cell.
    K,
    /// K_I of each cell.
    KInner,
    /// K_O of each cell.
    KOuter,
    /// The volume of each cell's image over its own.
    Jacobian,
    /// Red, green and blue are r, phi and theta of the domain point about the middle of the bounding box: where a colour lies
    /// in the image, its point of the domain went. Green jumps where phi does.
    Domain,
    /// Mean curvature of the boundary, before and after; positive where it is convex.
    Curvature,
    /// Angle inside the solid at the edges of the boundary, before and after.
    Dihedral,
}

impl Colour {
    /// The name in configs and file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::K => "k",
            Self::KInner => "k-inner",
            Self::KOuter => "k-outer",
            Self::Jacobian => "jacobian",
            Self::Domain => "domain",
            Self::Curvature => "curvature",
            Self::Dihedral => "dihedral",
        }
    }
}

/// No figure: sections where only the boundary has one.
const PLAIN: [f64; 3] = [0.87, 0.87, 0.87];
/// A flipped cell.
pub(super) const FLIPPED: [f64; 3] = [0.25, 0.0, 0.4];
/// An edge whose angle is nearer to 180 degrees than this is drawn like any other.
const FLAT: f64 = 1.0;

/// A range of figures and its colours.
#[derive(Clone, Debug)]
pub(super) struct Scale {
    low: f64,
    high: f64,
    logarithmic: bool,
    gradient: Gradient,
    reversed: bool,
}

impl Scale {
    /// The figure at a part of the range.
    pub(super) fn value(&self, part: f64) -> f64 {
        if self.logarithmic {
            self.low * (self.high / self.low).powf(part)
        } else {
            self.low + part * (self.high - self.low)
        }
    }

    /// The colour at a part of the range, cut off at its ends.
    pub(super) fn colour(&self, part: f64) -> [f64; 3] {
        let part = if self.reversed { 1.0 - part } else { part };
        let colour = self.gradient.eval_continuous(part.clamp(0.0, 1.0));
        [colour.r, colour.g, colour.b].map(|part| f64::from(part) / 255.0)
    }

    fn part(&self, value: f64) -> f64 {
        if self.logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }
}

/// The colours of a picture.
pub(super) struct Paint<'a> {
    colour: Colour,
    figures: &'a Figures,
    /// None where the colours are places.
    pub(super) scale: Option<Scale>,
    centre: Vec3,
    radius: f64,
}

impl<'a> Paint<'a> {
    pub(super) fn new(colour: Colour, figures: &'a Figures, domain: &[Vec3]) -> Self {
        let low = domain.iter().copied().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let high = domain.iter().copied().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let centre = (low + high) / 2.0;
        let radius = domain.iter().map(|point| (point - centre).norm()).fold(f64::MIN_POSITIVE, f64::max);
        Self { colour, figures, scale: scale(colour, figures), centre, radius }
    }

    /// What the colours are.
    pub(super) fn heading(&self) -> &'static str {
        match self.colour {
            Colour::K => "K",
            Colour::KInner => "K_I",
            Colour::KOuter => "K_O",
            Colour::Jacobian => "Jacobian",
            Colour::Domain => "domain",
            Colour::Curvature => "mean H",
            Colour::Dihedral => "degrees",
        }
    }

    /// Whether a cell is flipped.
    pub(super) fn shows_flipped(&self) -> bool {
        self.figures.cells.iter().any(|value| !value.is_finite())
    }

    /// Whether an edge is drawn in the colour of its angle.
    pub(super) fn stands_out(&self, angle: f64) -> bool {
        (angle - 180.0).abs() > FLAT
    }

    /// The colour of a figure.
    pub(super) fn of_value(&self, value: f64) -> [f64; 3] {
        match &self.scale {
            Some(scale) if value.is_finite() => scale.colour(scale.part(value)),
            _ => FLIPPED,
        }
    }

    /// The colour of a point of a polygon, at the given weights of three corners.
    pub(super) fn of(&self, polygon: &Polygon, corners: [&Corner; 3], weights: [f64; 3]) -> [f64; 3] {
        match self.colour {
            Colour::K | Colour::KInner | Colour::KOuter | Colour::Jacobian => {
                self.of_value(self.figures.cells[polygon.cell])
            }
            Colour::Domain => self.of_place((0..3).map(|i| corners[i].domain * weights[i]).sum()),
            Colour::Curvature if polygon.boundary => self.of_value((0..3).map(|i| corners[i].value * weights[i]).sum()),
            Colour::Curvature | Colour::Dihedral => PLAIN,
        }
    }

    /// Red, green, blue = r, phi, theta.
    fn of_place(&self, point: Vec3) -> [f64; 3] {
        let from = point - self.centre;
        let theta = from.x.hypot(from.y).atan2(from.z);
        [from.norm() / self.radius, (from.y.atan2(from.x) + PI) / TAU, theta / PI].map(|part| part.clamp(0.0, 1.0))
    }
}

fn scale(colour: Colour, figures: &Figures) -> Option<Scale> {
    let finite = || figures.all().filter(|value| value.is_finite());
    let largest = finite().fold(f64::NEG_INFINITY, f64::max);
    match colour {
        Colour::K | Colour::KInner | Colour::KOuter => {
            let gradient = colorous::YELLOW_ORANGE_RED;
            // Where every cell is a similarity, a range all the same. A few large K shall not leave one colour to all others.
            let high = largest.max(1.001);
            Some(Scale { low: 1.0, high, logarithmic: high > 10.0, gradient, reversed: false })
        }
        Colour::Jacobian => {
            let least = finite().fold(f64::INFINITY, f64::min);
            let (low, high) = if largest > least { (least, largest) } else { (0.5, 2.0) };
            Some(Scale { low, high, logarithmic: true, gradient: colorous::VIRIDIS, reversed: false })
        }
        Colour::Domain => None,
        Colour::Curvature => {
            let mut sizes: Vec<f64> = finite().map(f64::abs).filter(|size| *size > 0.0).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            // A sharp edge's H grows without bound as the mesh gets finer: it shall not take the whole range.
            let high = sizes.get(sizes.len() * 9 / 10).copied().unwrap_or(1.0);
            Some(Scale { low: -high, high, logarithmic: false, gradient: colorous::RED_BLUE, reversed: true })
        }
        Colour::Dihedral => {
            let width = finite().map(|angle| (angle - 180.0).abs()).fold(FLAT, f64::max);
            let (low, high) = (180.0 - width, 180.0 + width);
            Some(Scale { low, high, logarithmic: false, gradient: colorous::RED_BLUE, reversed: false })
        }
    }
}
