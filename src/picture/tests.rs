use super::*;
use crate::mesh::TetMesh;
use crate::solid::{CentreChoice, ShellSettings, Solid, shell_mesh, star_centre};

fn shell(solid: &Solid) -> TetMesh {
    let surface = solid.surface().unwrap();
    let centre = star_centre(&surface, &CentreChoice::Kernel).unwrap();
    let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 2, grading: 1.0 };
    shell_mesh(&surface, centre.position, &settings).unwrap().mesh
}

fn settings(colour: Colour, cuts: &[[f64; 4]]) -> PictureSettings {
    let cuts = cuts.iter().map(|[x, y, z, d]| Cut::new(Vec3::new(*x, *y, *z), *d).unwrap()).collect();
    PictureSettings { colour, cuts, view: PictureSettings::VIEW.into() }
}

/// The part of a panel that is not white, title left out.
fn covered(picture: &Picture, column: usize) -> f64 {
    let at = |x: usize, y: usize| picture.sheet.pixel(column * PANEL + x, y);
    let counted = (40..PANEL).flat_map(|y| (0..PANEL).map(move |x| (x, y))).filter(|&(x, y)| at(x, y) != [255; 3]);
    counted.count() as f64 / (PANEL * PANEL) as f64
}

#[test]
fn a_box_covers_the_area_of_its_shadow_whether_cut_through_the_back_or_not() {
    let mesh = shell(&Solid::Box { size: [2.0, 2.0, 2.0] });
    let view = Vec3::from(PictureSettings::VIEW).normalize();
    // The shadow of a cube with sides 2 is 4 (|x| + |y| + |z|); its extent across the widest direction gives the scale.
    let right = Vec3::z().cross(&view).normalize();
    let up = view.cross(&right);
    let extent = [right, up].map(|axis| 2.0 * axis.abs().sum()).into_iter().fold(0.0, f64::max);
    let expected = 4.0 * view.abs().sum() * (0.84 / extent).powi(2);
    for cuts in [&[][..], &[[-1.0, 0.0, 0.0, 0.5]]] {
        let picture = Picture::draw((&mesh).into(), mesh.points(), None, &settings(Colour::Domain, cuts)).unwrap();
        if cuts.is_empty() {
            // A pixel of the outline counts whole: a band of half a pixel about 3 x 0.84 panels long.
            let band = 0.5 * 3.0 / PANEL as f64;
            assert!((covered(&picture, 0) - expected - band / 2.0).abs() < band, "{} {expected}", covered(&picture, 0));
        } else {
            assert!(covered(&picture, 0) < 0.95 * expected);
        }
    }
}

#[test]
fn a_map_of_constant_k_has_one_colour_up_to_light() {
    let mesh = shell(&Solid::Octahedron);
    let image: Vec<Vec3> = mesh.points().iter().map(|p| Vec3::new(2.0 * p.x, p.y, p.z)).collect();
    for colour in [Colour::K, Colour::KInner, Colour::KOuter] {
        let picture =
            Picture::draw((&mesh).into(), mesh.points(), Some(&image), &settings(colour, &[[0.0, 0.0, 1.0, 0.1]]))
                .unwrap();
        // Light changes the length of a colour, not its direction.
        let direction = |colour: [f64; 3]| Vec3::from(colour).normalize();
        let end = &dilatation_colours(2)[1];
        let end = direction([1, 3, 5].map(|at| f64::from(u8::from_str_radix(&end[at..at + 2], 16).unwrap())));
        let of_end = (0..2 * PANEL * PANEL).filter(|i| {
            let pixel = picture.sheet.pixel(i % (2 * PANEL), i / (2 * PANEL)).map(f64::from);
            pixel[0] > 40.0 && (direction(pixel) - end).norm() < 0.03
        });
        assert!(of_end.count() > PANEL * PANEL / 4);
    }
}

#[test]
fn what_cannot_be_shown_is_refused() {
    let mesh = shell(&Solid::Cube);
    let points = mesh.points();
    let draw = |colour, cuts: &[[f64; 4]]| Picture::draw((&mesh).into(), points, None, &settings(colour, cuts));
    assert_eq!(draw(Colour::K, &[]), Err(PictureError::NoMap { colour: Colour::K }));
    assert_eq!(draw(Colour::Domain, &[[1.0, 0.0, 0.0, -2.0]]), Err(PictureError::NothingLeft));
    let from_nowhere = PictureSettings { view: Vec3::zeros(), ..settings(Colour::Domain, &[]) };
    assert_eq!(Picture::draw((&mesh).into(), points, None, &from_nowhere), Err(PictureError::View));
    let mut broken = points.to_vec();
    broken[3].x = f64::NAN;
    let drawn = Picture::draw((&mesh).into(), points, Some(&broken), &settings(Colour::K, &[]));
    assert_eq!(drawn, Err(PictureError::NotFinite { vertex: 3 }));
    // A flat image has no volume, hence no inside and no angles; its K is infinite and can be shown.
    let flat: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.x, p.y, 0.0)).collect();
    let of_flat = |colour| Picture::draw((&mesh).into(), points, Some(&flat), &settings(colour, &[]));
    assert!(matches!(of_flat(Colour::Dihedral), Err(PictureError::Surface(_))));
    assert!(of_flat(Colour::K).is_ok());
}

#[test]
fn curvature_and_angles_of_the_cube() {
    let mesh = shell(&Solid::Cube);
    let figures = Figures::of(Colour::Dihedral, (&mesh).into(), mesh.points(), None).unwrap();
    let sharp = figures.edges[0].values().filter(|angle| (**angle - 90.0).abs() < 1e-9).count();
    let flat = figures.edges[0].values().filter(|angle| (**angle - 180.0).abs() < 1e-9).count();
    // Each of the 12 edges is cut in two by the solid and in two again by the mesh.
    assert_eq!((sharp, sharp + flat), (48, figures.edges[0].len()));
    let curvature = Figures::of(Colour::Curvature, (&mesh).into(), mesh.points(), None).unwrap();
    let boundary = crate::mesh::Boundary::of(&mesh).unwrap();
    for (vertex, mean) in curvature.vertices[0].iter().enumerate() {
        let point = mesh.points()[vertex];
        let on_edge = point.iter().filter(|x| x.abs() > 1.0 - 1e-9).count() >= 2;
        assert_eq!(*mean > 1e-9, on_edge && boundary.vertex_mask()[vertex], "{point:?}");
    }
}
