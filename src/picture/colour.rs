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
    /// The parts of the gradient at the ends of the range.
    ends: [f64; 2],
}

/// The colours of dilatations, here and in the pages of runs: for the colour-blind too, rising in lightness, and without the ends
/// of the gradient, which do not stand out from a dark or a light page.
const DILATATION: (Gradient, [f64; 2]) = (colorous::PLASMA, [0.24, 0.77]);

/// So many colours of dilatations as `#rrggbb`, from the lowest to the highest, evenly spaced.
pub(crate) fn dilatation_colours(count: usize) -> Vec<String> {
    let (gradient, ends) = DILATATION;
    let scale = Scale { low: 0.0, high: 1.0, logarithmic: false, gradient, ends };
    let colour =
        |index: usize| scale.colour(index as f64 / (count - 1) as f64).map(|part| (255.0 * part).round() as u8);
    (0..count).map(colour).map(|[red, green, blue]| format!("#{red:02x}{green:02x}{blue:02x}")).collect()
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
        let [low, high] = self.ends;
        let colour = self.gradient.eval_continuous(low + (high - low) * part.clamp(0.0, 1.0));
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
            let (gradient, ends) = DILATATION;
            // Where every cell is a similarity, a range all the same. A few large K shall not leave one colour to all others.
            let high = largest.max(1.001);
            Some(Scale { low: 1.0, high, logarithmic: true, gradient, ends })
        }
        Colour::Jacobian => {
            let least = finite().fold(f64::INFINITY, f64::min);
            let (low, high) = if largest > least { (least, largest) } else { (0.5, 2.0) };
            Some(Scale { low, high, logarithmic: true, gradient: colorous::VIRIDIS, ends: [0.0, 1.0] })
        }
        Colour::Domain => None,
        Colour::Curvature => {
            let mut sizes: Vec<f64> = finite().map(f64::abs).filter(|size| *size > 0.0).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            // A sharp edge's H grows without bound as the mesh gets finer: it shall not take the whole range.
            let high = sizes.get(sizes.len() * 9 / 10).copied().unwrap_or(1.0);
            Some(Scale { low: -high, high, logarithmic: false, gradient: colorous::RED_BLUE, ends: [1.0, 0.0] })
        }
        Colour::Dihedral => {
            let width = finite().map(|angle| (angle - 180.0).abs()).fold(FLAT, f64::max);
            let (low, high) = (180.0 - width, 180.0 + width);
            Some(Scale { low, high, logarithmic: false, gradient: colorous::RED_BLUE, ends: [0.0, 1.0] })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The relative luminance of a colour, WCAG 2.2.
    fn luminance(colour: &str) -> f64 {
        let part = |at: usize| f64::from(u8::from_str_radix(&colour[at..at + 2], 16).unwrap()) / 255.0;
        let linear = |x: f64| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
        0.2126 * linear(part(1)) + 0.7152 * linear(part(3)) + 0.0722 * linear(part(5))
    }

    #[test]
    fn the_colours_of_dilatations_rise_in_lightness_and_stand_out_from_dark_and_light() {
        let colours: Vec<f64> = dilatation_colours(17).iter().map(|colour| luminance(colour)).collect();
        assert!(colours.is_sorted(), "{colours:?}");
        // What is behind them in the pages (page.css) and in pictures.
        for behind in ["#171d24", "#f6f8fa", "#ffffff"].map(luminance) {
            let contrast = |one: f64| (one.max(behind) + 0.05) / (one.min(behind) + 0.05);
            let least = colours.iter().map(|&one| contrast(one)).fold(f64::INFINITY, f64::min);
            assert!(least > 1.9, "{least}");
        }
    }
}
