//! `cargo bench`: tets a second of a map's decomposition and, of decomposed maps, of the
//! energy's value, gradient and Hessian, beside the machine's memory bandwidth and what
//! the bandwidth would allow if nothing but the operands had to be moved.

use divan::Bencher;
use divan::counter::{BytesCount, ItemsCount};
use qcball::linalg::Method;
use qcball::map::{RadialCoordinates, caraman};
use qcball::objective::{Assembly, Iterate, SoftMax, Unknowns};
use qcball::solid::{ShellSettings, Solid, shell_mesh};
use qcball::{Domain, Vec3};

fn main() {
    divan::main();
}

/// Layers of the cube's shell mesh with 8 x 8 squares a face: 16,896 and 135,936 tets.
const LAYERS: [u32; 2] = [8, 60];

fn radial(layers: u32) -> (Domain, Vec<Vec3>) {
    let surface = Solid::Cube.surface().expect("the cube");
    let settings = ShellSettings { subdivisions: 4, refinement: None, layers, grading: 1.0 };
    let shell = shell_mesh(&surface, Vec3::zeros(), &settings).expect("a convex solid");
    let image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
    (Domain::new(shell.mesh).expect("a ball"), image)
}

/// Calls a kernel on the radial map with the free vertices of the interior.
fn on_radial(bencher: Bencher<'_, '_>, layers: u32, mut kernel: impl FnMut(&mut Assembly<'_>, &SoftMax, &Iterate)) {
    let (domain, image) = radial(layers);
    let fixed = domain.boundary().vertex_mask();
    let mut assembly =
        Assembly::new(&domain, &Unknowns::of_mask(fixed), Method::Iterative).expect("iterative systems fit");
    let iterate = assembly.at(image);
    let energy = SoftMax::new(16.0, iterate.largest_log().expect("no flips"));
    let tets = domain.mesh().tets().len();
    bencher.counter(ItemsCount::new(tets)).bench_local(|| kernel(&mut assembly, &energy, &iterate));
}

#[divan::bench(args = LAYERS)]
fn value(bencher: Bencher<'_, '_>, layers: u32) {
    on_radial(bencher, layers, |assembly, energy, iterate| {
        divan::black_box(assembly.value(energy, iterate));
    });
}

#[divan::bench(args = LAYERS)]
fn gradient(bencher: Bencher<'_, '_>, layers: u32) {
    on_radial(bencher, layers, |assembly, energy, iterate| {
        divan::black_box(assembly.gradient(energy, iterate));
    });
}

#[divan::bench(args = LAYERS)]
fn gradient_and_hessian(bencher: Bencher<'_, '_>, layers: u32) {
    on_radial(bencher, layers, |assembly, energy, iterate| {
        divan::black_box(assembly.linearize(energy, iterate, 0.0));
    });
}

#[divan::bench(args = LAYERS)]
fn decompositions(bencher: Bencher<'_, '_>, layers: u32) {
    on_radial(bencher, layers, |assembly, _, iterate| {
        divan::black_box(assembly.at(iterate.image().to_vec()));
    });
}

/// Reads and writes 256 MiB, far more than the caches hold.
#[divan::bench]
fn memory_bandwidth(bencher: Bencher<'_, '_>) {
    let source = vec![1.0f64; 1 << 25];
    let mut target = vec![0.0f64; 1 << 25];
    bencher.counter(BytesCount::new(2 * 8 * source.len())).bench_local(|| {
        target.copy_from_slice(divan::black_box(&source));
        divan::black_box(target[1]);
    });
}

/// What a value needs at least: a tet's vertex numbers, its reference operator and a sixth of its vertices' positions.
#[divan::bench]
fn operands_of_a_value(bencher: Bencher<'_, '_>) {
    const TETS: usize = 1 << 20;
    /// 4 indices of 4 bytes, 9 entries and 3 / 6 coordinates of 8 bytes.
    const BYTES: usize = 4 * 4 + 9 * 8 + 4;
    let operands = vec![1u64; TETS * BYTES / 8];
    bencher.counter(ItemsCount::new(TETS)).bench_local(|| divan::black_box(&operands).iter().fold(0, |a, b| a ^ b));
}
