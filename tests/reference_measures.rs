//! Measured dilatations against the reference table of independent measurements, where it is at hand.

use std::path::Path;

use qcball::Domain;
use qcball::measure::measure;
use qcball::mesh::TetMesh;
use qcball::mesh::io::read_medit;

#[test]
fn the_reference_pairs_have_their_measures() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let Ok(table) = std::fs::read_to_string(shared.join("reference/measures.csv")) else {
        println!("skipped: there is no {}/reference/measures.csv", shared.display());
        return;
    };
    // rest,image,vertices,tets,boundary_vertices,locked,flipped,max_k,max inner, max outer and mean of the unflipped
    for row in table.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>()) {
        let read = |name: &str| read_medit(&shared.join("meshes").join(name)).unwrap();
        let (rest, image) = (read(row[0]), read(row[1]).points);
        let (mesh, _) = TetMesh::from_either_orientation(rest.points, rest.tets).unwrap();
        let domain = Domain::new(mesh).unwrap();
        let summary = measure(&domain, &image).summary;
        let on_boundary = domain.boundary().vertex_mask().iter().filter(|&&on| on).count();
        let (vertices, tets) = (domain.mesh().points().len(), domain.mesh().tets().len());
        let counts = [vertices, tets, on_boundary, domain.locked_tets().count(), summary.flipped];
        assert_eq!(counts.map(|count| count.to_string())[..], row[2..7], "{}", row[1]);
        let measured =
            [summary.max_k, summary.max_k_inner_unflipped, summary.max_k_outer_unflipped, summary.mean_k_unflipped];
        for (measured, expected) in measured.iter().zip(&row[7..11]) {
            let expected: f64 = expected.parse().unwrap();
            let equal = *measured == expected || (measured - expected).abs() <= 1e-9 * expected;
            assert!(equal, "{}: {measured} instead of {expected}", row[1]);
        }
    }
}
