//! What takes the place of a start whose tets resist untangling, or whose powers at corners cost more than they gain.

use super::{RunError, Start};
use crate::config::Plan;
use crate::map::{AREA_WEIGHT_OVER_COLLAR, CornerChoice, spherical_starts_over_collar};
use crate::optimize::Freed;
use crate::report::Splits;
use crate::sphere::SphereSettings;

impl Start {
    /// The map of the first positions of a spherical start, in words.
    pub(super) const FIRST: &str = "spherical, hyperbolic harmonic inside";
    /// The map of the second positions, in words.
    pub(super) const SECOND: &str = "spherical, harmonic inside";
    /// What either adds where it is over a collar.
    const COLLAR: &str = ", areas weighed too, over a collar";

    /// Takes over what untangling did, which may have refined the domain and gone back to the second positions.
    pub fn take_freed(&mut self, freed: &Freed) {
        self.domain = freed.domain.clone();
        self.image.clone_from(&freed.start);
        if freed.is_second {
            self.map.map = self.map.map.replace(Self::FIRST, Self::SECOND);
        }
    }

    /// The same domain with a spherical start, if one may take this one's place and the boundary has a map onto the sphere.
    pub fn in_spherical(&self) -> Option<Self> {
        let sphere =
            self.may_be_spherical.then(|| Self::of_sphere(self.domain.clone(), &SphereSettings::default()).ok())??;
        let mut warnings = self.warnings.clone();
        warnings.push(
            "the solid is star-shaped, but tets of the radial start resisted untangling: the map started from is the spherical one"
                .into(),
        );
        let Self { image, second, map, .. } = sphere;
        Some(Self { image, second, map, warnings, centre: None, may_be_spherical: false, ..self.clone() })
    }

    /// The spherical start over a collar of as many tets again, with areas weighed in its boundary map, if it may take the place of this one.
    pub fn over_collar(&self) -> Option<Self> {
        let tets_before = self.domain.mesh().tets().len();
        let (domain, starts, edges) = self.may_have_collar.then(|| spherical_starts_over_collar(&self.domain))??;
        let Self { domain, image, second, mut map, .. } = Self::of_starts(domain, starts);
        map.map.push_str(Self::COLLAR);
        let before = self.splits.unwrap_or(Splits { tets_before, ..Splits::default() });
        let splits = Some(Splits { collar: edges, ..before });
        let mut warnings = self.warnings.clone();
        warnings.push(format!(
            "tets of the start resisted untangling: it was made again over a collar, with areas weighed in the boundary map, as by \
             boundary.collar = 1 and map.area_weight = {}",
            AREA_WEIGHT_OVER_COLLAR
        ));
        Some(Self { domain, image, second, map, splits, warnings, may_have_collar: false, ..self.clone() })
    }

    /// The same from the spherical start, from that over a collar or from the second positions, if that is what the words for the map say.
    pub fn told_by(mut self, map: &str) -> Self {
        let of_sphere = map.strip_suffix(Self::COLLAR).unwrap_or(map);
        if [Self::FIRST, Self::SECOND].contains(&of_sphere)
            && let Some(spherical) = self.in_spherical()
        {
            self = spherical;
        }
        if of_sphere != map
            && let Some(over_collar) = self.over_collar()
        {
            self = over_collar;
        }
        if of_sphere == Self::SECOND
            && let Some(second) = self.second.take()
        {
            (self.image, self.map.map) = (second, map.into());
        }
        self
    }

    /// Whether exponents are sought on a mesh whose edges from corner to corner were halved, and the map without powers is made as well.
    pub fn seeks_powers_on_halves(&self, plan: &Plan) -> bool {
        plan.corners == CornerChoice::Power
            && plan.optimize.max_iterations > 0
            && self.splits.is_some_and(|splits| splits.corners > 0)
    }

    /// The start of the map without powers, which takes the place of that with them where it is better, and its plan.
    ///
    /// # Errors
    /// As [`Start::of`].
    pub fn without_powers(plan: &Plan) -> Result<(Plan, Self), RunError> {
        let plan = Plan { corners: CornerChoice::Linear, ..plan.clone() };
        let start = Self::of(&plan)?;
        Ok((plan, start.told_to_be_without_powers()))
    }

    /// The same with a warning of it.
    pub fn told_to_be_without_powers(mut self) -> Self {
        self.warnings.push(
            "corners = \"power\" halves edges from corner to corner, which on this mesh costs more than the powers gain: the map without powers came out \
             better and was taken; ask for more tets, so that they gain"
                .into(),
        );
        self
    }
}
