//! The piecewise-linear radial map on ever finer shell meshes against their closed forms.

use qcball::Domain;
use qcball::map::{RadialCoordinates, caraman};
use qcball::measure::measure;
use qcball::solid::{ShellSettings, Solid, radial_max_dilatation, shell_mesh};

/// Solid, radial map K and the printed digits' half unit.
fn table() -> Vec<(Solid, f64)> {
    let pyramid = |height| Solid::Pyramid { sides: 4, height };
    vec![
        (Solid::Tetrahedron, 31.145),
        (Solid::Cube, 7.210),
        (Solid::Octahedron, 7.210),
        (Solid::Dodecahedron, 3.064),
        (Solid::Icosahedron, 3.064),
        (Solid::Prism { sides: 3, height: 1.0 }, 22.091),
        (pyramid(0.5f64.sqrt()), 76.013),
        (pyramid(1.0), 31.145),
    ]
}

#[test]
fn measured_k_converges_to_the_closed_form_with_order_one() {
    for (solid, printed) in table() {
        let surface = solid.surface().unwrap();
        let centre = surface.centroid();
        let exact = radial_max_dilatation(&surface, &centre, 1.0);
        // Four decimals are printed, the last one rounded.
        assert!((exact - printed).abs() <= 5.5e-4, "{solid:?}: {exact} against the table's {printed}");
        let errors: Vec<f64> = [8, 16, 32]
            .into_iter()
            .map(|subdivisions| {
                // K is constant in each cone, so one layer measures it.
                let settings = ShellSettings { subdivisions, refinement: None, layers: 1, grading: 1.0 };
                let shell = shell_mesh(&surface, centre, &settings).unwrap();
                let image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
                let measured = measure(&Domain::new(shell.mesh).unwrap(), &image).summary;
                assert_eq!(measured.flipped, 0);
                exact - measured.max_k
            })
            .collect();
        for pair in errors.windows(2) {
            // The cone of a corner averages K over its width h, so the error is c h + O(h^2): halving h halves it up to
            // a second-order term, 20 % at these widths.
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 1.0).abs() < 0.2, "{solid:?}: errors {errors:?}, order {order}");
        }
        assert!(errors[2].abs() < 0.05 * exact, "{solid:?}: {errors:?}");
    }
}
