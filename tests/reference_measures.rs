//! Measured dilatations against those of an independent program (numpy's SVD): `tests/reference/measure.py`.

use std::path::Path;

use qcball::Domain;
use qcball::measure::measure;
use qcball::mesh::TetMesh;
use qcball::mesh::io::read_medit;

#[test]
fn the_reference_pairs_have_their_measures() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference");
    let table = std::fs::read_to_string(folder.join("measures.csv")).unwrap();
    // rest,image,vertices,tets,boundary_vertices,locked,flipped,max_k,max inner, max outer and mean of the unflipped
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 2);
    for row in rows {
        let read = |name: &str| read_medit(&folder.join(name)).unwrap();
        let (rest, image) = (read(row[0]), read(row[1]).points);
        let domain = Domain::new(TetMesh::new(rest.points, rest.tets).unwrap()).unwrap();
        let summary = measure(&domain, &image).summary;
        let on_boundary = domain.boundary().vertex_mask().iter().filter(|&&on| on).count();
        let (vertices, tets) = (domain.mesh().points().len(), domain.mesh().tets().len());
        let counts = [vertices, tets, on_boundary, domain.locked_tets().count(), summary.flipped];
        assert_eq!(counts.map(|count| count.to_string())[..], row[2..7], "{}", row[1]);
        let measured =
            [summary.max_k, summary.max_k_inner_unflipped, summary.max_k_outer_unflipped, summary.mean_k_unflipped];
        for (measured, expected) in measured.iter().zip(&row[7..11]) {
            let expected: f64 = expected.parse().unwrap();
            // Conditions are below 100, and a few operations a tet round to 1e-16 each.
            let equal = *measured == expected || (measured - expected).abs() <= 1e-12 * expected;
            assert!(equal, "{}: {measured} instead of {expected}", row[1]);
        }
    }
}
