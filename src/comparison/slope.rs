//! How the errors of estimates fall with the size of the cells, fitted and plotted (paper Fig. 10).

use std::collections::BTreeSet;

use plotters::prelude::*;

use super::ComparisonRow;
use crate::config::{AnalyticPlan, CellsPlan, MeshPlan};

/// The fewest meshes that a line is fitted to.
const FEWEST: usize = 3;

/// Errors of one map on meshes of one kind of one solid.
#[derive(Clone, Debug, PartialEq)]
pub struct Slope {
    /// The solid and its kind of cells.
    pub meshes: String,
    /// The map and its parameters.
    pub map: String,
    /// For each mesh, in the config's order, the side of a cube as large as its largest cell; a length.
    pub sizes: Vec<f64>,
    /// For each mesh |estimate / supremum - 1|, the estimate being the max over the vertices.
    pub estimated: Vec<f64>,
    /// The same of the max over the cells.
    pub per_cell: Vec<f64>,
}

impl Slope {
    /// Slope and intercept of the least-squares line of ln(error) over ln(size); where an error is 0 or infinite it is left out.
    /// None if fewer than two sizes are left.
    pub fn line(&self, errors: &[f64]) -> Option<[f64; 2]> {
        let logs = self.sizes.iter().zip(errors).filter(|(_, error)| error.is_finite() && **error > 0.0);
        let logs: Vec<[f64; 2]> = logs.map(|(size, error)| [size.ln(), error.ln()]).collect();
        let count = logs.len() as f64;
        let mean = [0, 1].map(|axis| logs.iter().map(|log| log[axis]).sum::<f64>() / count);
        let product =
            |a: usize, b: usize| -> f64 { logs.iter().map(|log| (log[a] - mean[a]) * (log[b] - mean[b])).sum() };
        let slope = product(0, 1) / product(0, 0);
        slope.is_finite().then_some([slope, mean[1] - slope * mean[0]])
    }
}

/// One entry for each map and each solid with three meshes of one kind, in the order of the rows.
pub(super) fn slopes(plan: &AnalyticPlan, rows: &[ComparisonRow]) -> Vec<Slope> {
    let filled: Vec<_> = plan.meshes.iter().filter(|mesh| mesh.cells != CellsPlan::Surface).collect();
    let kind = |index: usize| (&filled[index].solid, &filled[index].place, kind_of_cells(&filled[index].cells));
    let mut seen = BTreeSet::new();
    let mut slopes = Vec::new();
    for first in 0..filled.len() {
        let alike: Vec<usize> = (first..filled.len()).filter(|&other| kind(other) == kind(first)).collect();
        let is_new = alike.iter().all(|&index| seen.insert(index));
        if !is_new || alike.len() < FEWEST {
            continue;
        }
        for map in 0..plan.maps.len() {
            let rows: Vec<&ComparisonRow> = alike.iter().map(|mesh| &rows[mesh * plan.maps.len() + map]).collect();
            let Some(supremum) = rows[0].supremum.filter(|supremum| supremum.is_finite()) else { continue };
            let error = |value: f64| (value / supremum - 1.0).abs();
            let cells = kind_of_cells(&filled[first].cells);
            slopes.push(Slope {
                meshes: format!("{}, {cells}", filled[first].solid),
                map: rows[0].map.clone(),
                sizes: rows.iter().map(|row| row.largest_cell.cbrt()).collect(),
                estimated: rows.iter().map(|row| error(row.estimated)).collect(),
                per_cell: rows.iter().map(|row| error(row.per_cell)).collect(),
            });
        }
    }
    slopes
}

fn kind_of_cells(cells: &CellsPlan) -> String {
    match cells {
        CellsPlan::Voxels(_) => "boxes".into(),
        CellsPlan::Tets(MeshPlan::Shell(_) | MeshPlan::Auto { .. }) => "shell tets".into(),
        CellsPlan::Tets(MeshPlan::Flag(_)) => "flag tets".into(),
        CellsPlan::Tets(MeshPlan::External(settings)) => format!("{} tets", settings.mesher),
        CellsPlan::Surface => "no cells".into(),
    }
}

/// The errors of the estimates over the sizes, both on logarithmic axes, with their lines; as SVG.
pub(super) fn plot(slopes: &[Slope]) -> String {
    const COLOURS: [RGBColor; 4] = [RGBColor(31, 119, 180), RGBColor(214, 39, 40), RGBColor(44, 160, 44), BLACK];
    let all = |values: fn(&Slope) -> &Vec<f64>| {
        let positive = slopes.iter().flat_map(values).copied().filter(|value| *value > 0.0 && value.is_finite());
        let (low, high) = positive.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
        low / 1.5..high * 1.5
    };
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (720, 480)).into_drawing_area();
        // Drawing into a string cannot fail, but for a plot without any points, which no caller asks for.
        let drawn = (|| -> Result<(), DrawingAreaErrorKind<_>> {
            area.fill(&WHITE)?;
            let mut chart = ChartBuilder::on(&area)
                .caption("Relative error of the largest K over the vertices", ("sans-serif", 18))
                .margin(14)
                .x_label_area_size(46)
                .y_label_area_size(70)
                .build_cartesian_2d(all(|slope| &slope.sizes).log_scale(), all(|slope| &slope.estimated).log_scale())?;
            chart
                .configure_mesh()
                .x_desc("side of a cube as large as the largest cell")
                .y_desc("|estimate / exact - 1|")
                .x_label_formatter(&|x| format!("{x:.2}"))
                .y_label_formatter(&|y| format!("{y:.0e}"))
                .light_line_style(WHITE)
                .draw()?;
            for (slope, colour) in slopes.iter().zip(COLOURS.iter().cycle()) {
                let points = slope.sizes.iter().copied().zip(slope.estimated.iter().copied());
                let circles = points.filter(|(_, y)| *y > 0.0 && y.is_finite());
                chart.draw_series(circles.map(|point| Circle::new(point, 4, colour.filled())))?;
                let Some([exponent, intercept]) = slope.line(&slope.estimated) else { continue };
                let ends = slope.sizes.iter().map(|size| (*size, (intercept + exponent * size.ln()).exp()));
                let mut ends: Vec<(f64, f64)> = ends.collect();
                ends.sort_by(|a, b| a.0.total_cmp(&b.0));
                let label = format!("{}: slope {exponent:.2}", slope.meshes);
                chart
                    .draw_series(LineSeries::new(ends, colour.stroke_width(2)))?
                    .label(label)
                    .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
            }
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperLeft)
                .background_style(WHITE.mix(0.8))
                .border_style(BLACK)
                .draw()?;
            area.present()
        })();
        drawn.expect("drawing into a string");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_a_power_law_is_its_exponent() {
        let sizes = vec![0.5, 0.25, 0.1, 0.03];
        let errors: Vec<f64> = sizes.iter().map(|size: &f64| 3.0 * size.powf(1.7)).collect();
        let slope =
            Slope { meshes: "m".into(), map: "f".into(), sizes, estimated: errors.clone(), per_cell: vec![0.0; 4] };
        let [exponent, intercept] = slope.line(&errors).unwrap();
        assert!((exponent - 1.7).abs() < 1e-12 && (intercept.exp() - 3.0).abs() < 1e-12);
        // One point is no line, and what is exact has none.
        assert_eq!(slope.line(&slope.per_cell), None);
        assert_eq!(slope.line(&[f64::INFINITY, 0.1, 0.0, f64::NAN]), None);
        let text = plot(&[slope]);
        assert!(text.contains("m: slope 1.70") && text.matches("<circle").count() >= 4, "{text}");
    }
}
