//! A comparison as tables, plot, pictures and meshes.

use std::fmt::Write as _;
use std::path::Path;

use super::{Comparison, ComparisonRow, Drawn, Mesh, slope};
use crate::config::AnalyticPlan;
use crate::estimate::{Estimator, on_cells};
use crate::mesh::io::{DataArray, Values, WriteError, write_atomically, write_hexahedra_vtu, write_vtu};

/// The comparison in Markdown.
pub fn table(plan: &AnalyticPlan, comparison: &Comparison) -> String {
    let mut text = format!("# {}\n", plan.name);
    // Writing to a string cannot fail.
    let _ = dilatations(&mut text, plan, &comparison.rows);
    let _ = surfaces(&mut text, comparison);
    let _ = slopes(&mut text, comparison);
    if !plan.notes.is_empty() {
        text.push_str("\nNotes\n\n");
        plan.notes.iter().for_each(|note| {
            let _ = writeln!(text, "- {note}");
        });
    }
    text
}

fn dilatations(text: &mut String, plan: &AnalyticPlan, rows: &[ComparisonRow]) -> std::fmt::Result {
    if rows.is_empty() {
        return Ok(());
    }
    let estimator = serde_json::json!(plan.estimator);
    // Few of the paper's results have a mean.
    let with_means = rows.iter().any(|row| row.published_mean.is_some());
    let means = if with_means { " mean, paper | mean, ours |" } else { "" };
    writeln!(
        text,
        "\nMax K of maps in closed form. \"ours\": over the vertices, by the estimator {estimator}; \"per cell\": of the \
         gradient on each cell, exact for tets; \"exact at vertices\": of the map itself at the mesh's vertices; \"exact sup\": \
         over all points where the map is defined.\n\n\
         | mesh | cells | largest cell | map | paper | ours |{means} per cell | flipped cells | exact at vertices | exact sup |\n\
         |---|---|---|---|---|---|{}---|---|---|---|",
        if with_means { "---|---|" } else { "" }
    )?;
    let optional = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{value}"));
    for row in rows {
        let supremum = row.supremum.map_or_else(|| "-".into(), |value| format!("{value:.4}"));
        write!(
            text,
            "| {} | {} | {:.3e} | {} | {} | {:.4} |",
            row.mesh,
            row.cells,
            row.largest_cell,
            row.map,
            optional(row.published),
            row.estimated,
        )?;
        if with_means {
            write!(text, " {} | {:.4} |", optional(row.published_mean), row.estimated_mean)?;
        }
        writeln!(text, " {:.4} | {} | {:.4} | {supremum} |", row.per_cell, row.flipped, row.exact_at_vertices)?;
    }
    Ok(())
}

fn surfaces(text: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.surfaces.is_empty() {
        return Ok(());
    }
    text.push_str(
        "\nInvariants of surfaces of triangles before and after maps: the Willmore energy, the integral of H^2, which \
         conformal maps of space keep, and the integral of H, which isometries keep.\n\n\
         | surface | triangles | map | Willmore before | after | total H before | after | area before | after |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for row in &comparison.surfaces {
        let (before, after) = (row.before, row.after);
        writeln!(
            text,
            "| {} | {} | {} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} |",
            row.mesh,
            row.triangles,
            row.map,
            before.willmore_energy,
            after.willmore_energy,
            before.total_mean_curvature,
            after.total_mean_curvature,
            before.area,
            after.area
        )?;
    }
    Ok(())
}

fn slopes(text: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.slopes.is_empty() {
        return Ok(());
    }
    text.push_str(
        "\nSlopes of ln |max K / sup - 1| over ln of the side of a cube as large as the largest cell, by least squares over the \
         meshes (plot.svg): 2 would be second order.\n\n\
         | meshes | map | count | slope, ours | slope, per cell | smallest error, ours | per cell |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for slope in &comparison.slopes {
        let fitted = |errors| slope.line(errors).map_or_else(|| "-".into(), |[slope, _]| format!("{slope:.2}"));
        let least = |errors: &[f64]| format!("{:.2e}", errors.iter().copied().fold(f64::INFINITY, f64::min));
        writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} |",
            slope.meshes,
            slope.map,
            slope.sizes.len(),
            fitted(&slope.estimated),
            fitted(&slope.per_cell),
            least(&slope.estimated),
            least(&slope.per_cell)
        )?;
    }
    Ok(())
}

/// Writes into a folder, made if missing: `table.md`; `table.csv` if there are rows; `plot.svg` if there are slopes; and for
/// each map to be shown `mesh-M-map-N-COLOUR.png` and `mesh-M-map-N-domain.vtu` and `...-image.vtu`, with K, K_inner, K_outer
/// and the Jacobian on cells.
///
/// # Errors
/// The first file that could not be written, and why.
pub fn write_results(folder: &Path, plan: &AnalyticPlan, comparison: &Comparison) -> Result<(), WriteError> {
    if !comparison.rows.is_empty() {
        write_atomically(&folder.join("table.csv"), |file| {
            let mut writer = csv::Writer::from_writer(file);
            comparison.rows.iter().try_for_each(|row| writer.serialize(row)).map_err(std::io::Error::other)?;
            writer.flush()
        })?;
    }
    if !comparison.slopes.is_empty() {
        let plot = slope::plot(&comparison.slopes);
        write_atomically(&folder.join("plot.svg"), |file| file.write_all(plot.as_bytes()))?;
    }
    comparison.drawn.iter().try_for_each(|drawn| drawn.write(folder))?;
    write_atomically(&folder.join("table.md"), |file| file.write_all(table(plan, comparison).as_bytes()))
}

impl Drawn {
    fn write(&self, folder: &Path) -> Result<(), WriteError> {
        for (colour, picture) in &self.pictures {
            picture.write_png(&folder.join(format!("{}-{colour}.png", self.name)))?;
        }
        let (cells, points) = (self.mesh.cells(), self.mesh.points());
        let estimates = on_cells(cells, points, &self.image, Estimator::Gradient);
        let of_cells = |figure: &dyn Fn(usize) -> f64| (0..cells.len()).map(figure).collect::<Vec<f64>>();
        let arrays = [
            ("K", of_cells(&|cell| estimates[cell].dilatation().k())),
            ("K_inner", of_cells(&|cell| estimates[cell].dilatation().inner)),
            ("K_outer", of_cells(&|cell| estimates[cell].dilatation().outer)),
            ("Jacobian", of_cells(&|cell| estimates[cell].jacobian)),
        ];
        let arrays = arrays.each_ref().map(|(name, values)| DataArray { name, values: Values::Scalars(values) });
        for (which, points) in [("domain", points), ("image", self.image.as_slice())] {
            let path = folder.join(format!("{}-{which}.vtu", self.name));
            match &self.mesh {
                Mesh::Tets(mesh) => write_vtu(&path, points, mesh.tets(), &[], &arrays)?,
                Mesh::Boxes(mesh) => write_hexahedra_vtu(&path, points, mesh.cells(), &[], &arrays)?,
            }
        }
        Ok(())
    }
}
