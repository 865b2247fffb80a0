//! How the texts for a terminal are set: labels, tables, shares, lengths.

use crate::dilatation::number;
use crate::measure::Summary;
use crate::mesh::io::on_one_line;

/// The width of what is written into files and read through pipes, and the largest that is used.
pub const COLUMNS: usize = 80;
/// Where the text of a labelled line begins.
const INDENT: usize = 12;
/// The width of the tables of dilatations and of bounds.
pub(super) const TABLE: usize = 77;

/// A label and its text, wrapped between words.
pub(super) fn labelled(columns: usize, label: &str, text: &str) -> String {
    let mut lines = format!("{label:<INDENT$}");
    let mut column = INDENT;
    // Names of files and overrides are among the words.
    for (index, word) in on_one_line(text).split(' ').enumerate() {
        let width = word.chars().count();
        if index > 0 && column + 1 + width > columns {
            lines.push_str(&format!("\n{:INDENT$}", ""));
            column = INDENT;
        } else if index > 0 {
            lines.push(' ');
            column += 1;
        }
        lines.push_str(word);
        column += width;
    }
    lines + "\n"
}

/// A table of dilatations, one row a map; one column a map where there is no room for that.
pub(crate) fn dilatations(columns: usize, maps: &[(&str, &Summary)]) -> String {
    let heads = ["max K", "mean K", "median K", "99 % K", "max K_I", "max K_O", "flipped"];
    let rows = maps.iter().map(|(name, map)| {
        let numbers = [map.max_k, map.mean_k, map.p50_k, map.p99_k, map.max_k_inner, map.max_k_outer].map(number);
        (*name, numbers.into_iter().chain([map.flipped.to_string()]).collect::<Vec<String>>())
    });
    let rows: Vec<(&str, Vec<String>)> = rows.collect();
    let line = |name: &str, cells: &[&str]| {
        let (last, others) = cells.split_last().expect("there is a map");
        let last_width = if columns < TABLE { 10 } else { 9 };
        let cells: String = others.iter().map(|cell| format!("{cell:>10}")).collect();
        format!("{name:<8}{cells}{last:>last_width$}\n")
    };
    if columns >= TABLE {
        let rows = rows.iter().map(|(name, cells)| line(name, &cells.iter().map(String::as_str).collect::<Vec<_>>()));
        return line("", &heads) + &rows.collect::<String>();
    }
    let row = |(at, head): (usize, &&str)| line(head, &rows.iter().map(|(_, cells)| &*cells[at]).collect::<Vec<_>>());
    line("", &maps.iter().map(|(name, _)| *name).collect::<Vec<_>>())
        + &heads.iter().enumerate().map(row).collect::<String>()
}

/// A share, rounded down.
pub(super) fn percent(share: f64) -> String {
    format!("{:.2} %", (share * 1e4).floor() / 100.0)
}

/// Decimals of a length in a solid of this volume (in its units cubed): four, and in small units as many as four figures of
/// the solid's size take; none where a power of ten is easier to read, or the volume out of the range of numbers.
pub(super) fn decimals(volume: f64) -> Option<usize> {
    (1e-36..1e36).contains(&volume).then(|| 4 + (-volume.cbrt().log10().ceil()).max(0.0) as usize)
}

/// A length in the domain; no `-0.0000`, which another order of sums would turn into `0.0000`.
pub(super) fn length(x: f64, decimals: Option<usize>) -> String {
    let Some(decimals) = decimals else { return format!("{:.4e}", x + 0.0) };
    let text = format!("{x:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|byte| matches!(byte, b'0' | b'.')) => digits.to_owned(),
        _ => text,
    }
}

/// A point in the domain.
pub(super) fn point(coordinates: [f64; 3], decimals: Option<usize>) -> String {
    let [x, y, z] = coordinates.map(|x| length(x, decimals));
    format!("({x}, {y}, {z})")
}
