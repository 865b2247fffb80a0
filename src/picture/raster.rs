//! Triangles into pixels, nearest first.

use crate::mesh::Vec3;

/// A square of pixels with depth. Colours are red, green and blue from 0 to 1.
pub(super) struct Canvas {
    size: usize,
    depth: Vec<f64>,
    colours: Vec<[f32; 3]>,
}

impl Canvas {
    /// A white square.
    pub(super) fn new(size: usize) -> Self {
        Self { size, depth: vec![f64::NEG_INFINITY; size * size], colours: vec![[1.0; 3]; size * size] }
    }

    /// The mean colour of the square of `count` times `count` pixels at the given multiple of `count`.
    pub(super) fn mean(&self, column: usize, row: usize, count: usize) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for y in 0..count {
            for x in 0..count {
                let colour = self.colours[(row * count + y) * self.size + column * count + x];
                (0..3).for_each(|part| sum[part] += f64::from(colour[part]));
            }
        }
        sum.map(|part| part / (count * count) as f64)
    }

    /// Draws a triangle: x to the right and y down in pixels, z towards the viewer. `shade` gives the colour at the
    /// barycentric weights of a pixel's middle; where depths are equal, the first triangle stays.
    pub(super) fn triangle(&mut self, corners: [Vec3; 3], shade: &dyn Fn([f64; 3]) -> [f64; 3]) {
        let [a, b, c] = corners.map(|corner| corner.xy());
        let area = (b - a).perp(&(c - a));
        if area == 0.0 {
            return;
        }
        let low = a.inf(&b).inf(&c);
        let high = a.sup(&b).sup(&c);
        // A cast of a negative number is 0.
        let range = |axis: usize| low[axis].floor() as usize..(high[axis].ceil() as usize).min(self.size);
        let (columns, rows) = (range(0), range(1));
        for row in rows {
            for column in columns.clone() {
                let at = nalgebra::Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
                let weights = [(c - b).perp(&(at - b)), (a - c).perp(&(at - c)), (b - a).perp(&(at - a))];
                let weights = weights.map(|weight| weight / area);
                let depth = (0..3).map(|i| weights[i] * corners[i].z).sum();
                let pixel = row * self.size + column;
                if weights.iter().all(|weight| *weight >= 0.0) && depth > self.depth[pixel] {
                    self.depth[pixel] = depth;
                    self.colours[pixel] = shade(weights).map(|part| part as f32);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearer_triangle_hides_the_other_in_either_order() {
        let square = |z: f64| [[0.0, 0.0], [20.0, 0.0], [0.0, 20.0]].map(|[x, y]| Vec3::new(x, y, z));
        // It leans: nearer than 0 in the left half of the square only.
        let leaning = [[0.0, 0.0, 5.0], [20.0, 0.0, -15.0], [0.0, 20.0, 5.0]].map(Vec3::from);
        for order in [[0, 1], [1, 0]] {
            let mut canvas = Canvas::new(10);
            for which in order {
                if which == 0 {
                    canvas.triangle(square(0.0), &|_| [1.0, 0.0, 0.0]);
                } else {
                    canvas.triangle(leaning, &|_| [0.0, 0.0, 1.0]);
                }
            }
            for column in 0..10 {
                // z = 5 - x.
                let expected = if column < 5 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
                assert_eq!(canvas.mean(column, 3, 1), expected, "column {column}");
            }
        }
    }

    #[test]
    fn what_lies_outside_is_left_out_and_weights_sum_to_one() {
        let mut canvas = Canvas::new(8);
        canvas.triangle([[-9.0, -9.0, 0.0], [-1.0, -9.0, 0.0], [-9.0, -1.0, 0.0]].map(Vec3::from), &|_| [0.0; 3]);
        canvas.triangle([[99.0, 0.0, 0.0], [90.0, 8.0, 0.0], [99.0, 8.0, 0.0]].map(Vec3::from), &|_| [0.0; 3]);
        assert_eq!(canvas.mean(0, 0, 8), [1.0; 3]);
        canvas.triangle([[-9.0, -9.0, 0.0], [30.0, -9.0, 0.0], [-9.0, 30.0, 0.0]].map(Vec3::from), &|weights| {
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            weights
        });
        assert!((canvas.mean(0, 0, 8).iter().sum::<f64>() - 1.0).abs() < 1e-6);
    }
}
