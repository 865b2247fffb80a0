//! The exponents of corners that make the largest K small.
//!
//! The least largest K for given exponents, V, has by the envelope theorem the derivative sum of multiplier times d ln K / d ln p in the
//! logarithm of a corner's exponent, over the elements of its cones. Corners hardly see each other: with a share w of the multipliers in
//! the cones of a corner, V is there about w times a function of its own exponent, whose slope, the sum divided by w, is led to 0
//! for each corner by a secant method of its own.

use std::collections::BTreeMap;

use super::Warped;
use crate::dilatation::Dilatation;
use crate::map::Corners;
use crate::measure::measure;
use crate::mesh::{TetId, Vec3, VertexId};
use crate::optimize::{OptimizeError, OptimizeSettings, Polish, Start};

/// Most optimizations.
const TRIES: usize = 5;
/// Fall of ln K below which there is no other: K is flat at the best exponents.
const GAIN: f64 = 2e-4;
/// Second derivative of ln K in ln p to begin with, and between which it is believed; 1.5 to 3 at corners of cubes and tetrahedra.
const CURVATURE: [f64; 3] = [0.7, 2.0, 8.0];
/// The largest change of ln p at a time.
const LARGEST: f64 = 0.3;
/// Share of the multipliers below which a corner does not tell what it needs.
const LEAST_SHARE: f64 = 0.02;
/// Half the change of ln p over which ln K is differentiated; the next term is its square times a third derivative of order 1.
const STEP: f64 = 1e-4;

/// What is known of a corner, or of all that symmetries take to each other.
#[derive(Clone, Copy, Debug)]
struct Search {
    /// ln p.
    log: f64,
    curvature: f64,
    /// ln p and the slope there, the last time that the corner told.
    last: Option<(f64, f64)>,
}

impl Search {
    fn at(log: f64) -> Self {
        Self { log, curvature: CURVATURE[1], last: None }
    }

    /// Takes the slope in, and goes to where it would vanish.
    fn go(&mut self, slope: f64) {
        if let Some((log, before)) = self.last
            && (self.log - log).abs() > 1e-3
        {
            self.curvature = ((slope - before) / (self.log - log)).clamp(CURVATURE[0], CURVATURE[2]);
        }
        self.last = Some((self.log, slope));
        self.log -= (slope / self.curvature).clamp(-LARGEST, LARGEST);
    }
}

impl Warped<'_> {
    /// The corners with exponents from which no small change lowers the largest K onto the polyhedron by much, from those that they
    /// have: of the ones tried, 1 for all among them, those of the least K. Corners that the mirror planes exchange have the same.
    ///
    /// # Errors
    /// As [`optimize()`](crate::optimize::optimize()).
    ///
    /// # Panics
    /// Without corners.
    pub fn exponents(&self, start: &[Vec3], settings: &OptimizeSettings) -> Result<Corners, OptimizeError> {
        let given = self.corners.expect("there are corners");
        let settings = OptimizeSettings { polish: Polish::None, ..settings.clone() };
        let mut searches: BTreeMap<u32, Search> = BTreeMap::new();
        for (vertex, exponent) in given.exponents() {
            searches.entry(self.alike(vertex)).or_insert_with(|| Search::at(exponent.ln()));
        }
        let largest = |corners: &Corners, known, positions: &[Vec3]| {
            let (plain, owners) =
                self.chamber().with_factors(|tet| corners.factors(self.domain, self.tet_of_chamber(tet)));
            let outcome = self.solved(&plain, known, positions, &settings, &mut |_, _| {})?;
            let k = measure(&plain, &self.restricted(&outcome.positions)).summary.max_k;
            Ok::<_, OptimizeError>((k, owners, outcome))
        };
        let mut best: Option<(f64, Corners)> = None;
        let (mut known, mut positions) = (Start::Anywhere, start.to_vec());
        for _ in 0..TRIES {
            let corners = given.clone().with_exponents(|vertex| searches[&self.alike(vertex)].log.exp());
            let (k, owners, outcome) = largest(&corners, known, &positions)?;
            let fell = best.as_ref().is_none_or(|(least, _)| k < *least);
            let slopes = self.slopes(&corners, &owners, &outcome.multipliers, &outcome.positions);
            if fell {
                (best, positions, known) = (Some((k, corners)), outcome.positions, Start::Settled);
            }
            let mut promised = 0.0;
            for (corner, (share, slope)) in slopes {
                if share > LEAST_SHARE {
                    let search = searches.get_mut(&corner).expect("it is a corner");
                    search.go(slope);
                    promised += share * slope * slope / (2.0 * search.curvature);
                }
            }
            if promised < GAIN || settings.cancel.is_due() {
                break;
            }
        }
        // What the search begins with suits corners of solids; at those of a coarse mesh of a smooth one no powers may be better.
        if !settings.cancel.is_due() {
            let linear = given.clone().with_exponents(|_| 1.0);
            let (k, ..) = largest(&linear, Start::Anywhere, start)?;
            if best.as_ref().is_none_or(|(least, _)| k < *least) {
                best = Some((k, linear));
            }
        }
        Ok(best.map_or_else(|| given.clone(), |(_, corners)| corners))
    }

    /// A number that corners have in common if and only if they are to have the same exponent.
    fn alike(&self, corner: VertexId) -> u32 {
        self.mirrors.map_or(corner.0, |mirrors| mirrors.in_chamber(corner.index()))
    }

    fn tet_of_chamber(&self, tet: TetId) -> TetId {
        self.mirrors.map_or(tet, |mirrors| mirrors.tets()[tet.index()])
    }

    /// For each corner its share of the multipliers, and their mean of d ln K / d ln p there.
    fn slopes(
        &self,
        corners: &Corners,
        owners: &[TetId],
        multipliers: &[(TetId, f64)],
        image: &[Vec3],
    ) -> BTreeMap<u32, (f64, f64)> {
        // The place of each element among those of its tet.
        let mut seen = vec![0; owners.len()];
        let places: Vec<usize> = owners
            .iter()
            .map(|tet| {
                seen[tet.index()] += 1;
                seen[tet.index()] - 1
            })
            .collect();
        let nearby = [-STEP, STEP].map(|step| {
            let exponents: BTreeMap<VertexId, f64> = corners.exponents().into_iter().collect();
            corners.clone().with_exponents(|vertex| exponents[&vertex] * step.exp())
        });
        let mut sums: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
        for (index, &(element, multiplier)) in multipliers.iter().enumerate() {
            let tet = self.tet_of_chamber(owners[element.index()]);
            let Some(cone) = corners.warped_cone(tet) else { continue };
            let jacobian = self.domain.jacobian(tet, image);
            let of = |corners: &Corners| {
                Dilatation::of(&(jacobian * corners.factors(self.domain, tet)[places[element.index()]]))
            };
            // A tet that holds both has two entries, that of K_O first.
            let is = |other: Option<&(TetId, f64)>| other.is_some_and(|(tet, _)| *tet == element);
            let side = match (is(multipliers.get(index + 1)), index > 0 && is(multipliers.get(index - 1))) {
                (true, _) => |dilatation: Dilatation| dilatation.outer,
                (false, true) => |dilatation: Dilatation| dilatation.inner,
                (false, false) => |dilatation: Dilatation| dilatation.k(),
            };
            let [less, more] = nearby.each_ref().map(|corners| side(of(corners)).ln());
            let [share, sum] = sums.entry(self.alike(cone.corner)).or_default();
            *share += multiplier;
            *sum += multiplier * (more - less) / (2.0 * STEP);
        }
        sums.into_iter().map(|(corner, [share, sum])| (corner, (share, sum / share))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Domain;
    use crate::mesh::Subdivision;
    use crate::mesh::fixtures::{cube, fan, split};
    use crate::optimize::BoundaryValues;

    #[test]
    fn slopes_are_the_derivatives_of_the_least_largest_k_and_the_search_lowers_it() {
        let mut parted = Subdivision::of(&split(&fan(&cube(), Vec3::zeros())));
        parted.split_edges(|edge| edge.iter().all(|v| v.0 < 8));
        let domain = Domain::new(parted.mesh().unwrap()).unwrap();
        let image: Vec<Vec3> = { domain.mesh().points().iter() }
            .map(|x| if x.norm() > 0.0 { x * (x.amax() / x.norm()) } else { *x })
            .collect();
        let settings = OptimizeSettings {
            boundary_values: BoundaryValues::Sliding,
            polish: Polish::None,
            tolerance: 1e-9,
            ..OptimizeSettings::default()
        };
        let of = |exponent: f64| {
            let exponents: Vec<(VertexId, f64)> = (0..8).map(|v| (VertexId(v), exponent)).collect();
            Corners::stars(&domain, &exponents).unwrap()
        };
        let solved = |corners: &Corners, start: &[Vec3]| {
            let warped = Warped { domain: &domain, corners: Some(corners), mirrors: None, onto_ball: false };
            let outcome = warped.optimize(start, &settings, &mut |_| {}).unwrap();
            let elements = corners.elements(&domain);
            let k = measure(&elements.domain, &outcome.positions).summary.max_k;
            let slopes = warped.slopes(corners, &elements.owners, &outcome.multipliers, &outcome.positions);
            (k.ln(), slopes.values().map(|(share, slope)| share * slope).sum::<f64>(), outcome.positions)
        };
        let exponent: f64 = 1.2;
        let (ln_k, slope, positions) = solved(&of(exponent), &image);
        let step = 1e-3;
        let [less, more] = [-step, step].map(|by: f64| solved(&of(exponent * by.exp()), &positions).0);
        // The third derivative, of order 1, times step^2, and the accuracy of the solutions over the step.
        let difference = (more - less) / (2.0 * step);
        assert!((slope - difference).abs() < 1e-4 && slope.abs() > 0.1, "{slope} {difference}");
        let corners = of(exponent);
        let warped = Warped { domain: &domain, corners: Some(&corners), mirrors: None, onto_ball: false };
        let found = warped.exponents(&image, &settings).unwrap();
        let (least, _, _) = solved(&found, &image);
        assert!(least < ln_k - 1e-3, "{least} {ln_k} {:?}", found.exponents());
    }
}
