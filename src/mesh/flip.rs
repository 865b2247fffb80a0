//! Flips: the tets at an edge or at a face replaced by others that fill the same room.

use std::collections::BTreeMap;

use super::{TetId, TetMesh, VertexId};

/// Most tets at an edge that is taken away: there are as many triangulations of their ring as its Catalan number says, of which the best is
/// found in the cube of it.
const MOST_AROUND: usize = 8;

/// What refinement did to a mesh: edges that were halved, and tets that were flipped in between.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshChanges {
    /// The ends of the edges that were halved, in this order; their middles are the last vertices.
    pub halved: Vec<[VertexId; 2]>,
    /// What flips came to, in this order.
    pub flips: Vec<Flips>,
}

impl MeshChanges {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.halved.is_empty() && self.flips.is_empty()
    }
}

/// Which of the changes of a mesh cannot be made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ChangeError {
    /// The halving of this number, from 0, and why.
    Halving(usize, String),
    /// Of the tets that the flips replace and put there, one group of flips after the other, the old before the new: the number, from 0, of the
    /// one to blame, or of the first of a group that is to blame as a whole, and why.
    Flip(usize, String),
}

/// What some flips in a row come to: tets of a mesh, and the ones in their room. The others keep their order, and the new ones follow them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Flips {
    /// How many edges were halved before.
    pub after: usize,
    /// The tets that are replaced, ascending.
    pub old: Vec<(TetId, [VertexId; 4])>,
    /// Those in their room.
    pub new: Vec<[VertexId; 4]>,
}

impl Flips {
    /// Puts the new tets in the place of the old. They have the same outer faces, and so they fill the same room, if all of them are
    /// positively oriented: how many tets a generic point of space lies in follows from the faces around it.
    ///
    /// # Errors
    /// What is wrong, numbered within these flips: an old tet is not there, or the new ones have other outer faces.
    pub fn make(&self, tets: &mut Vec<[VertexId; 4]>) -> Result<(), ChangeError> {
        if let Some(row) = self.old.iter().position(|(id, tet)| tets.get(id.index()) != Some(tet)) {
            return Err(ChangeError::Flip(row, format!("tet {} has other vertices", self.old[row].0.0)));
        }
        if let Some(row) = self.old.windows(2).position(|pair| pair[0].0 >= pair[1].0) {
            return Err(ChangeError::Flip(row + 1, "the tets that are replaced are not in their order".into()));
        }
        if outer_faces(self.old.iter().map(|(_, tet)| tet)) != outer_faces(self.new.iter()) {
            let all = self.old.len() + self.new.len();
            let reason = format!("from there on {all} tets have other outer faces where they come than where they go");
            return Err(ChangeError::Flip(0, reason));
        }
        let (mut index, mut gone) = (0, self.old.iter().map(|(id, _)| id.index()).peekable());
        tets.retain(|_| {
            index += 1;
            gone.next_if_eq(&(index - 1)).is_none()
        });
        tets.extend(&self.new);
        Ok(())
    }

    /// Puts the old tets back; `None` if the new ones are not there.
    pub fn undo(&self, tets: &mut Vec<[VertexId; 4]>) -> Option<()> {
        let kept = tets.len().checked_sub(self.new.len())?;
        if tets.split_off(kept) != self.new {
            return None;
        }
        let (mut kept, mut old) = (std::mem::take(tets).into_iter(), self.old.iter().peekable());
        loop {
            let next = old.next_if(|(id, _)| id.index() == tets.len()).map(|(_, tet)| *tet).or_else(|| kept.next());
            let Some(tet) = next else { break };
            tets.push(tet);
        }
        old.next().is_none().then_some(())
    }
}

/// How often each face of some tets, its vertices ascending, is there as it is more often than the other way round.
fn outer_faces<'a>(tets: impl Iterator<Item = &'a [VertexId; 4]>) -> BTreeMap<[VertexId; 3], i32> {
    let mut faces = BTreeMap::new();
    for (tet, face) in tets.flat_map(|tet| TetMesh::FACES.map(|face| (tet, face))) {
        let face = face.map(|i| tet[i]);
        let mut sorted = face;
        sorted.sort_unstable();
        let [a, b, c] = face;
        let is_even = [[a, b, c], [b, c, a], [c, a, b]].contains(&sorted);
        *faces.entry(sorted).or_insert(0) += if is_even { 1 } else { -1 };
    }
    faces.retain(|_, count| *count != 0);
    faces
}

/// What a tet is worth, the less the better, if it may be there and that is below a number.
pub(crate) type Worth<'a> = dyn Fn(&[VertexId; 4], f64) -> Option<f64> + 'a;

/// Tets with what each is worth.
type Valued = Vec<([VertexId; 4], f64)>;

/// The tets of a mesh while they are flipped.
pub(crate) struct Flipping {
    /// Those there were, and then the new ones; `None` for what is replaced.
    tets: Vec<Option<[VertexId; 4]>>,
    /// What each is worth.
    worths: Vec<f64>,
    /// The tets at each vertex, and some that were.
    at: Vec<Vec<usize>>,
    /// How many tets there were.
    before: usize,
}

impl Flipping {
    /// Takes a mesh, and what its tets are worth.
    pub fn of(mesh: &TetMesh, worths: Vec<f64>) -> Self {
        let mut at = vec![Vec::new(); mesh.points().len()];
        for (index, tet) in mesh.tets().iter().enumerate() {
            tet.iter().for_each(|v| at[v.index()].push(index));
        }
        Self { tets: mesh.tets().iter().copied().map(Some).collect(), worths, at, before: mesh.tets().len() }
    }

    /// Makes the flip of a tet that lowers the largest worth of the tets it replaces most, if one does by more than so much: 2-3 at a
    /// face, or any triangulation of the ring of an edge inside, which is taken away (3-2, 4-4, ...). Nothing if the tet is replaced already.
    pub fn flip(&mut self, tet: TetId, least_fall: f64, worth: &Worth<'_>) {
        let index = tet.index();
        let Some(tet) = self.tets[index] else { return };
        let mut best: Option<(f64, Vec<usize>, Valued)> = None;
        let mut consider = |old: Vec<usize>, search: &dyn Fn(f64) -> Option<Valued>| {
            let before = old.iter().map(|index| self.worths[*index]).fold(f64::NEG_INFINITY, f64::max);
            let least = best.as_ref().map_or(least_fall, |(fall, ..)| *fall);
            if let Some(new) = search(before - least) {
                let after = new.iter().map(|(_, worth)| *worth).fold(f64::NEG_INFINITY, f64::max);
                best = Some((before - after, old, new));
            }
        };
        for (i, face) in TetMesh::FACES.into_iter().enumerate() {
            let [x, y, z] = face.map(|k| tet[k]);
            let beyond = |other: &(usize, [VertexId; 4])| other.0 != index && other.1.contains(&z);
            let Some((other, beyond)) = self.around([x, y]).find(beyond) else { continue };
            let apex = beyond.into_iter().find(|v| ![x, y, z].contains(v)).expect("a tet has four vertices");
            let new = [[x, y], [y, z], [z, x]].map(|[p, q]| [tet[i], apex, p, q]);
            consider(vec![index, other], &|below| new.iter().map(|tet| Some((*tet, worth(tet, below)?))).collect());
        }
        for edge in (0..4).flat_map(|i| (0..i).map(move |k| [tet[k], tet[i]])) {
            let around: Vec<(usize, [VertexId; 4])> = self.around(edge).collect();
            let Some(ring) = ring(edge, &around) else { continue };
            let around = around.into_iter().map(|(index, _)| index).collect();
            consider(around, &|below| best_triangulation(edge, &ring, below, worth));
        }
        let Some((_, old, new)) = best else { return };
        old.into_iter().for_each(|index| self.tets[index] = None);
        for (tet, worth) in new {
            tet.iter().for_each(|v| self.at[v.index()].push(self.tets.len()));
            self.tets.push(Some(tet));
            self.worths.push(worth);
        }
    }

    /// What the flips came to on the mesh; `None` if there were none.
    pub fn made(&self, mesh: &TetMesh, after: usize) -> Option<Flips> {
        let (there, new) = self.tets.split_at(self.before);
        let gone = (0..).map(TetId).zip(there).filter(|(_, tet)| tet.is_none());
        let old: Vec<(TetId, [VertexId; 4])> = gone.map(|(id, _)| (id, mesh.tets()[id.index()])).collect();
        (!old.is_empty()).then(|| Flips { after, old, new: new.iter().flatten().copied().collect() })
    }

    fn around(&self, [a, b]: [VertexId; 2]) -> impl Iterator<Item = (usize, [VertexId; 4])> + '_ {
        let there = self.at[a.index()].iter().filter_map(|&index| Some((index, self.tets[index]?)));
        there.filter(move |(_, tet)| tet.contains(&b))
    }
}

/// The other vertices of the tets around an edge, counter-clockwise seen from its second end; `None` at the boundary, or if they are many.
fn ring(edge: [VertexId; 2], around: &[(usize, [VertexId; 4])]) -> Option<Vec<VertexId>> {
    if !(3..=MOST_AROUND).contains(&around.len()) {
        return None;
    }
    let sides: Vec<[VertexId; 2]> = around.iter().map(|(_, tet)| opposite(tet, edge)).collect();
    let mut ring = vec![sides[0][0]];
    while ring.len() < sides.len() {
        let last = ring[ring.len() - 1];
        ring.push(sides.iter().find(|[from, _]| *from == last)?[1]);
    }
    let is_closed = sides.contains(&[ring[ring.len() - 1], ring[0]]);
    let is_whole = ring.iter().enumerate().all(|(i, v)| !ring[..i].contains(v));
    (is_closed && is_whole).then_some(ring)
}

/// The edge of a tet opposite to one of its edges, so that `[edge, opposite]` is the tet in its orientation.
fn opposite(tet: &[VertexId; 4], edge: [VertexId; 2]) -> [VertexId; 2] {
    let place = |v: VertexId| tet.iter().position(|w| *w == v).expect("an edge of the tet");
    let [i, j] = edge.map(place);
    let mut others = (0..4).filter(|k| *k != i && *k != j);
    let (k, l) = (others.next().expect("four"), others.next().expect("four"));
    let order = [i, j, k, l];
    let inversions = (0..4).flat_map(|a| (0..a).map(move |b| (b, a))).filter(|(b, a)| order[*b] > order[*a]).count();
    if inversions % 2 == 0 { [tet[k], tet[l]] } else { [tet[l], tet[k]] }
}

/// The triangulation of a ring about an edge with the least largest worth of the tets between its triangles and the ends, if that is below a
/// number, with what each is worth: that of a polygon from those of its parts.
fn best_triangulation([a, b]: [VertexId; 2], ring: &[VertexId], below: f64, worth: &Worth<'_>) -> Option<Valued> {
    /// The best of the part of a polygon between two vertices: the largest worth, the third vertex of the triangle at their edge, and its tets.
    #[derive(Clone)]
    struct Part {
        largest: f64,
        middle: usize,
        tets: Valued,
    }
    let count = ring.len();
    let mut parts: Vec<Vec<Option<Part>>> = vec![vec![None; count]; count];
    let edge = Part { largest: f64::NEG_INFINITY, middle: 0, tets: Vec::new() };
    (1..count).for_each(|i| parts[i - 1][i] = Some(edge.clone()));
    for (from, to) in (2..count).flat_map(|length| (0..count - length).map(move |from| (from, from + length))) {
        let mut best: Option<Part> = None;
        (from + 1..to).for_each(|middle| {
            let below = best.as_ref().map_or(below, |best| best.largest);
            let (Some(one), Some(other)) = (&parts[from][middle], &parts[middle][to]) else { return };
            if one.largest.max(other.largest) >= below {
                return;
            }
            let [x, y, z] = [from, middle, to].map(|i| ring[i]);
            let of = |tet: [VertexId; 4]| Some((tet, worth(&tet, below)?));
            let (Some(upper), Some(lower)) = (of([x, y, z, b]), of([x, z, y, a])) else { return };
            let largest = one.largest.max(other.largest).max(upper.1).max(lower.1);
            best = Some(Part { largest, middle, tets: vec![upper, lower] });
        });
        parts[from][to] = best;
    }
    let (mut tets, mut left) = (Vec::new(), vec![(0, count - 1)]);
    while let Some((from, to)) = left.pop() {
        let Part { middle, tets: of_triangle, .. } = parts[from][to].as_ref()?;
        if !of_triangle.is_empty() {
            tets.extend(of_triangle);
            left.extend([(from, *middle), (*middle, to)]);
        }
    }
    Some(tets)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Boundary, Orientation, Subdivision, Vec3, edge_matrix, orientation};

    /// A double cone over a regular polygon: vertex 0 below, 1 above, and so many around.
    fn around_an_axis(count: usize) -> TetMesh {
        let mut points = vec![Vec3::new(0.0, 0.0, -1.0), Vec3::new(0.0, 0.0, 1.0)];
        let angle = |i: usize| i as f64 * std::f64::consts::TAU / count as f64;
        points.extend((0..count).map(|i| Vec3::new(angle(i).cos(), angle(i).sin(), 0.0)));
        let ring = |i: usize| VertexId((2 + i % count) as u32);
        let tets = (0..count).map(|i| [VertexId(0), VertexId(1), ring(i), ring(i + 1)]).collect();
        TetMesh::new(points, tets).unwrap()
    }

    fn volume(mesh: &TetMesh) -> f64 {
        (0..mesh.tets().len() as u32).map(|t| edge_matrix(mesh.corners(TetId(t))).determinant() / 6.0).sum()
    }

    fn has_axis(tet: &[VertexId; 4]) -> bool {
        [0, 1].iter().all(|v| tet.contains(&VertexId(*v)))
    }

    /// The mesh after the best flip of its first tet, where its tets are worth 2 and others what is said.
    fn flipped(mesh: &TetMesh, worth: impl Fn(&[VertexId; 4]) -> Option<f64>) -> Option<(TetMesh, Flips)> {
        let is_positive =
            |tet: &[VertexId; 4]| orientation(tet.map(|v| &mesh.points()[v.index()])) == Orientation::Positive;
        let worth = |tet: &[VertexId; 4], below: f64| worth(tet).filter(|worth| *worth < below && is_positive(tet));
        let mut flipping = Flipping::of(mesh, vec![2.0; mesh.tets().len()]);
        flipping.flip(TetId(0), 0.5, &worth);
        // What is replaced is left alone.
        flipping.flip(TetId(0), 0.5, &worth);
        let flips = flipping.made(mesh, 0)?;
        let mut tets = mesh.tets().to_vec();
        flips.make(&mut tets).unwrap();
        let mut before = tets.clone();
        flips.undo(&mut before).unwrap();
        assert_eq!(before, mesh.tets());
        Some((TetMesh::new(mesh.points().to_vec(), tets).unwrap(), flips))
    }

    #[test]
    fn an_edge_is_taken_away_with_the_best_triangulation_of_its_ring_and_comes_back() {
        for count in 3..=MOST_AROUND {
            let mesh = around_an_axis(count);
            // All are bad that have the axis, or do not have vertex 4: a fan from there is left.
            let is_of_fan = |tet: &[VertexId; 4]| tet.contains(&VertexId(4)) && !has_axis(tet);
            let (after, flips) = flipped(&mesh, |tet| Some(if is_of_fan(tet) { 1.0 } else { 3.0 })).unwrap();
            assert_eq!((flips.old.len(), flips.new.len()), (count, 2 * (count - 2)));
            assert!(after.tets().iter().all(is_of_fan), "{count}: {:?}", after.tets());
            assert!((volume(&after) - volume(&mesh)).abs() < 1e-14);
            let surface = |mesh: &TetMesh| Boundary::of(mesh).unwrap().triangles().len();
            assert_eq!(surface(&after), surface(&mesh));
            let changes = MeshChanges { halved: vec![[4, 0].map(VertexId)], flips: vec![flips] };
            let mut again = Subdivision::of(&mesh);
            again.change(&changes).unwrap();
            assert_eq!(Subdivision::before(&again.mesh().unwrap(), &changes), Some(mesh));
        }
        // One more than are looked at, too small a fall, and tets that may not be.
        let off_axis = |tet: &[VertexId; 4]| Some(1.0).filter(|_| !has_axis(tet));
        assert!(flipped(&around_an_axis(MOST_AROUND + 1), off_axis).is_none());
        assert!(flipped(&around_an_axis(4), |_| Some(1.6)).is_none());
        assert!(flipped(&around_an_axis(4), |_| None).is_none());
    }

    #[test]
    fn a_face_gives_way_to_an_edge() {
        let three = around_an_axis(3);
        let (two, _) = flipped(&three, |_| Some(1.0)).unwrap();
        assert_eq!(two.tets().len(), 2);
        let (again, flips) = flipped(&two, |_| Some(1.0)).unwrap();
        assert_eq!((flips.old.len(), flips.new.len()), (2, 3));
        assert!(again.tets().iter().all(has_axis));
        assert!((volume(&again) - volume(&three)).abs() < 1e-15);
    }

    #[test]
    fn flips_of_other_tets_or_into_other_room_are_refused() {
        let mesh = around_an_axis(4);
        let (_, flips) = flipped(&mesh, |_| Some(1.0)).unwrap();
        let made = |change: &dyn Fn(&mut Flips)| {
            let mut flips = flips.clone();
            change(&mut flips);
            flips.make(&mut mesh.tets().to_vec())
        };
        assert_eq!(made(&|_| {}), Ok(()));
        let is = |error: Result<(), ChangeError>, row: usize, text: &str| match error {
            Err(ChangeError::Flip(at, reason)) => at == row && reason.contains(text),
            _ => false,
        };
        assert!(is(made(&|flips| flips.old[1].0 = TetId(7)), 1, "tet 7"));
        assert!(is(made(&|flips| flips.old.swap(0, 1)), 1, "order"));
        assert!(is(made(&|flips| flips.new.truncate(1)), 0, "outer faces"));
        assert!(is(made(&|flips| flips.old.truncate(1)), 0, "outer faces"));
        assert!(is(made(&|flips| flips.new[0].swap(0, 1)), 0, "outer faces"));
        let changed = |flips| Subdivision::of(&mesh).change(&MeshChanges { halved: Vec::new(), flips });
        let late = Flips { after: 1, ..flips.clone() };
        assert!(is(changed(vec![late]), 0, "halvings"));
        // The second of two: after all rows of the first.
        let again = flips.old.len() + flips.new.len();
        assert!(is(changed(vec![flips.clone(), flips.clone()]), again, "tet 0"));
        assert_eq!(flips.undo(&mut mesh.tets().to_vec()), None);
    }
}
