//! The paper's Algorithm 1: a solid filled with axis-parallel boxes that are refined towards its surface.

use std::collections::HashMap;
use std::fmt;
use std::str::FromStr;

use rayon::prelude::*;

use super::{InsideTest, Side, Surface};
use crate::mesh::{Vec3, VertexId, VoxelMesh};

/// The most cells that are looked at, and the most that are kept: their corners would not fit in memory much later.
const MOST_CELLS: u64 = 20_000_000;

/// The first grid over a surface's bounding box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid {
    /// So many cells along x, y and z, of the shape that fills the bounding box.
    Voxel([u32; 3]),
    /// Cubes, so many of them along the longest side of the bounding box; along the others as many as cover it, centred.
    Cubic(u32),
}

/// How a solid is filled with boxes; written `voxel(nx,ny,nz;d;k)` or `cubic(n;d;k)` (paper §2.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Voxels {
    /// The first grid.
    pub grid: Grid,
    /// d: how often a cell that is not wholly inside is divided; 0 for the plain grid.
    pub depth: u32,
    /// k: into how many parts along each axis.
    pub subdivision: u32,
}

/// Why there are no boxes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VoxelizeError {
    /// A text that is no notation of a grid.
    #[error(
        "{text:?} is no voxel grid: write voxel(nx,ny,nz;d;k) or cubic(n;d;k) with whole numbers, as in cubic(10;2;2)"
    )]
    Notation {
        /// The text.
        text: String,
    },
    /// A count out of range.
    #[error("{voxels}: {requirement}")]
    Parameter {
        /// The grid.
        voxels: Voxels,
        /// What is asked of it.
        requirement: &'static str,
    },
    /// More cells than fit.
    #[error("{voxels} needs more than {MOST_CELLS} cells; lower the counts, the depth or the subdivision")]
    TooFine {
        /// The grid.
        voxels: Voxels,
    },
    /// No cell lies in the solid.
    #[error("{voxels}: no cell has all its corners inside the solid; take a finer grid or a greater depth")]
    Nothing {
        /// The grid.
        voxels: Voxels,
    },
}

impl fmt::Display for Voxels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.grid {
            Grid::Voxel([x, y, z]) => write!(f, "voxel({x},{y},{z};{};{})", self.depth, self.subdivision),
            Grid::Cubic(n) => write!(f, "cubic({n};{};{})", self.depth, self.subdivision),
        }
    }
}

impl FromStr for Voxels {
    type Err = VoxelizeError;

    /// Reads the paper's notation; spaces are of no account.
    fn from_str(text: &str) -> Result<Self, VoxelizeError> {
        let refused = || VoxelizeError::Notation { text: text.to_owned() };
        let compact: String = text.chars().filter(|letter| !letter.is_whitespace()).collect();
        let inner = compact.split_once('(').and_then(|(name, rest)| Some((name, rest.strip_suffix(')')?)));
        let (name, inner) = inner.ok_or_else(refused)?;
        let numbers = |part: &str| part.split(',').map(|number| number.parse().ok()).collect::<Option<Vec<u32>>>();
        let parts: Vec<Vec<u32>> = inner.split(';').map(numbers).collect::<Option<_>>().ok_or_else(refused)?;
        let parts: Vec<&[u32]> = parts.iter().map(Vec::as_slice).collect();
        let voxels = match (name, parts.as_slice()) {
            ("voxel", &[&[x, y, z], &[depth], &[subdivision]]) => {
                Self { grid: Grid::Voxel([x, y, z]), depth, subdivision }
            }
            ("cubic", &[&[n], &[depth], &[subdivision]]) => Self { grid: Grid::Cubic(n), depth, subdivision },
            _ => return Err(refused()),
        };
        voxels.check()?;
        Ok(voxels)
    }
}

impl Voxels {
    fn check(self) -> Result<(), VoxelizeError> {
        let least = match self.grid {
            Grid::Voxel(counts) => counts.into_iter().min().expect("there are three"),
            Grid::Cubic(count) => count,
        };
        let requirement = if least == 0 {
            "every count of cells must be at least 1"
        } else if self.subdivision == 0 || (self.subdivision == 1 && self.depth > 0) {
            "the subdivision must be at least 2, or 1 with a depth of 0"
        } else {
            return Ok(());
        };
        Err(VoxelizeError::Parameter { voxels: self, requirement })
    }

    /// The box of the first grid and its counts.
    fn first_grid(self, surface: &Surface) -> (Vec3, Vec3, [u64; 3]) {
        let (low, high) = surface.bounding_box();
        match self.grid {
            Grid::Voxel(counts) => (low, high, counts.map(u64::from)),
            Grid::Cubic(count) => {
                let size = high - low;
                let edge = size.max() / f64::from(count);
                // A side that is a whole number of cells up to rounding is that number, and keeps its bounds to the bit.
                let counts = [0, 1, 2].map(|axis| ((size[axis] / edge) * (1.0 - 1e-12)).ceil().max(1.0));
                let extra = Vec3::from_fn(|axis, _| {
                    let extra = counts[axis] * edge - size[axis];
                    if extra.abs() <= 1e-9 * edge { 0.0 } else { 0.5 * extra }
                });
                (low - extra, high + extra, counts.map(|count| count as u64))
            }
        }
    }
}

/// A cell: its low corner and the length of its sides, in steps of the finest grid.
#[derive(Clone, Copy)]
struct Cell {
    low: [u64; 3],
    side: u64,
}

impl Cell {
    fn corner(&self, i: usize) -> [u64; 3] {
        std::array::from_fn(|axis| self.low[axis] + self.side * (i >> axis & 1) as u64)
    }
}

/// Fills the solid with boxes (paper Algorithm 1): a cell with all eight corners inside is kept, one with some but not all is
/// divided, to the given depth. A corner on the surface counts as inside.
///
/// A part of the solid that has no corner of the first grid in it is missed, and a kept cell may stick out where the surface
/// is bent more than the grid can see: that is the algorithm. The cells come level by level, large ones first.
///
/// # Errors
/// Counts out of range or too large; a solid that no cell lies in.
pub fn voxelize(surface: &Surface, voxels: Voxels) -> Result<VoxelMesh, VoxelizeError> {
    voxels.check()?;
    let too_fine = || VoxelizeError::TooFine { voxels };
    let k = u64::from(voxels.subdivision);
    let finest = k.checked_pow(voxels.depth).filter(|&finest| finest <= 1 << 20).ok_or_else(too_fine)?;
    let (low, high, counts) = voxels.first_grid(surface);
    let total = counts.iter().try_fold(1u64, |product, &count| product.checked_mul(count));
    total.filter(|&total| total <= MOST_CELLS).ok_or_else(too_fine)?;
    let steps = counts.map(|count| count * finest);
    // At both ends of the box exactly its bounds, so that a flat side of the solid stays one.
    let position = |at: [u64; 3]| {
        Vec3::from_fn(|axis, _| {
            let fraction = at[axis] as f64 / steps[axis] as f64;
            low[axis] * (1.0 - fraction) + high[axis] * fraction
        })
    };

    let test = InsideTest::new(surface);
    let mut cells: Vec<Cell> = Vec::with_capacity(total.unwrap_or(0) as usize);
    for z in 0..counts[2] {
        for y in 0..counts[1] {
            cells.extend((0..counts[0]).map(|x| Cell { low: [x, y, z].map(|i| i * finest), side: finest }));
        }
    }
    let mut kept = Vec::new();
    for level in 0..=voxels.depth {
        let corners = corners_inside(&cells, |at| test.side(&position(at)) != Side::Outside);
        let inside = |cell: &Cell| (0..8).filter(|&i| corners[&cell.corner(i)]).count();
        let mut cut: Vec<Cell> = Vec::new();
        for cell in cells {
            match inside(&cell) {
                8 => kept.push(cell),
                0 => {}
                _ => cut.push(cell),
            }
        }
        if level == voxels.depth {
            break;
        }
        if kept.len() as u64 + (cut.len() as u64).saturating_mul(k.pow(3)) > MOST_CELLS {
            return Err(too_fine());
        }
        cells = cut.iter().flat_map(|cell| parts(cell, k)).collect();
    }
    mesh_of(&kept, position).ok_or(VoxelizeError::Nothing { voxels })
}

/// Whether each corner of the cells is inside.
fn corners_inside(cells: &[Cell], inside: impl Fn([u64; 3]) -> bool + Sync) -> HashMap<[u64; 3], bool> {
    let mut corners: Vec<[u64; 3]> = cells.iter().flat_map(|cell| (0..8).map(|i| cell.corner(i))).collect();
    corners.par_sort_unstable();
    corners.dedup();
    corners.into_par_iter().map(|corner| (corner, inside(corner))).collect()
}

/// The k^3 parts of a cell.
fn parts(cell: &Cell, k: u64) -> impl Iterator<Item = Cell> + use<> {
    let (low, side) = (cell.low, cell.side / k);
    (0..k.pow(3)).map(move |index| {
        let at = [index % k, index / k % k, index / (k * k)];
        Cell { low: std::array::from_fn(|axis| low[axis] + at[axis] * side), side }
    })
}

fn mesh_of(kept: &[Cell], position: impl Fn([u64; 3]) -> Vec3) -> Option<VoxelMesh> {
    let (mut points, mut index_of) = (Vec::new(), HashMap::new());
    let mut vertex = |at: [u64; 3]| {
        *index_of.entry(at).or_insert_with(|| {
            points.push(position(at));
            VertexId(points.len() as u32 - 1)
        })
    };
    let cells: Vec<[VertexId; 8]> = kept.iter().map(|cell| std::array::from_fn(|i| vertex(cell.corner(i)))).collect();
    VoxelMesh::new(points, cells).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    fn voxels(text: &str) -> Voxels {
        text.parse().unwrap()
    }

    #[test]
    fn the_papers_notation_is_read_and_written() {
        for text in ["voxel(6,8,8;2;2)", "cubic(10;0;2)", "cubic(10;1;4)"] {
            assert_eq!(voxels(text).to_string(), text);
        }
        assert_eq!(voxels(" cubic( 10 ; 2 ; 2 ) "), Voxels { grid: Grid::Cubic(10), depth: 2, subdivision: 2 });
        for text in [
            "",
            "cubic",
            "cubic(10)",
            "cubic(10;2;2",
            "cubic(1,2,3;2;2)",
            "voxel(3;1;2)",
            "cubic(x;1;2)",
            "cubic(-1;1;2)",
        ] {
            assert!(matches!(text.parse::<Voxels>(), Err(VoxelizeError::Notation { .. })), "{text}");
        }
        for text in ["cubic(0;1;2)", "voxel(1,0,1;0;2)", "cubic(3;1;1)", "cubic(3;0;0)"] {
            assert!(matches!(text.parse::<Voxels>(), Err(VoxelizeError::Parameter { .. })), "{text}");
        }
    }

    #[test]
    fn a_box_is_filled_to_its_bounds() {
        let solid = Solid::Box { size: [1.0, 0.7, 0.3] }.surface().unwrap();
        for text in ["voxel(3,2,5;0;2)", "voxel(7,3,3;2;3)", "cubic(10;0;2)"] {
            let mesh = voxelize(&solid, voxels(text)).unwrap();
            // 0.7 and 0.3 are not whole numbers of tenths in binary.
            assert!((mesh.volume() - 0.21).abs() < 1e-14, "{text}: {}", mesh.volume());
        }
        assert_eq!(voxelize(&solid, voxels("cubic(10;0;2)")).unwrap().cells().len(), 10 * 7 * 3);
        // Cells of 1/9 cover the other sides by 7 and 3 with a rest, which sticks out and is divided.
        let rest = voxelize(&solid, voxels("cubic(9;3;2)")).unwrap();
        assert!(rest.volume() < 0.21 && rest.volume() > 0.19);
    }

    #[test]
    fn cells_do_not_overlap_and_come_in_powers_of_the_subdivision() {
        let torus = Solid::Torus { major_radius: 1.0, minor_radius: 0.4, resolution: 24 }.surface().unwrap();
        let mut before = 0.0;
        for depth in 0..3 {
            let mesh = voxelize(&torus, Voxels { grid: Grid::Cubic(10), depth, subdivision: 2 }).unwrap();
            let side = |cell: &[VertexId; 8]| mesh.points()[cell[1].index()].x - mesh.points()[cell[0].index()].x;
            let mut sizes: Vec<i32> =
                mesh.cells().iter().map(|cell| (0.28 / side(cell)).log2().round() as i32).collect();
            sizes.dedup();
            assert_eq!(sizes, (0..=depth as i32).collect::<Vec<_>>());
            // Kept cells have their corners inside, each level adds to the volume, and what is missing lies within a
            // cell's diagonal of the surface; the polyhedron's bends are small against a cell.
            let missing = torus.volume() - mesh.volume();
            let diagonal = 0.28 * 3f64.sqrt() / f64::from(1 << depth);
            assert!(mesh.volume() > before && missing > 0.0 && missing < torus.area() * diagonal);
            before = mesh.volume();
            // The corners of no cell lie strictly inside another.
            for cell in mesh.cells() {
                let (low, high) = (mesh.points()[cell[0].index()], mesh.points()[cell[7].index()]);
                let within = |p: &Vec3| (0..3).all(|axis| low[axis] < p[axis] && p[axis] < high[axis]);
                assert!(!mesh.points().iter().any(within));
            }
        }
    }

    #[test]
    fn the_volume_converges_to_the_solids() {
        let ball = Solid::Ball { radius: 1.0, resolution: 12 }.surface().unwrap();
        let error = |text: &str| 1.0 - voxelize(&ball, voxels(text)).unwrap().volume() / ball.volume();
        // The missing layer is a fraction of a cell thick: of first order.
        let errors = ["cubic(8;0;2)", "cubic(16;0;2)", "cubic(32;0;2)"].map(error);
        assert!(errors[1] < 0.7 * errors[0] && errors[2] < 0.7 * errors[1], "{errors:?}");
        // Dividing to a depth is as good as the fine grid where it matters.
        assert!(error("cubic(8;2;2)") < 1.05 * errors[2]);
    }

    #[test]
    fn too_fine_and_too_coarse_grids_say_so() {
        let ball = Solid::Ball { radius: 1.0, resolution: 4 }.surface().unwrap();
        let said = |text: &str| voxelize(&ball, voxels(text)).unwrap_err().to_string();
        assert!(said("cubic(1;0;2)").contains("take a finer grid"));
        for text in ["cubic(4000000;0;2)", "cubic(10;40;2)", "cubic(100;3;10)"] {
            assert!(said(text).contains("lower the counts"), "{text}");
        }
    }
}
