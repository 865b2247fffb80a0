//! TetGen's pair of `.node` (vertices) and `.ele` (tets), text.
//!
//! Each is a line of counts, then one entry a line that starts with its number; vertices count from 0 or 1, whichever the
//! first one has. Written from 1, TetGen's default. Cell data stands as attributes of the tets, named by a comment as
//! meshio writes it. (meshio itself reads attributes of tets as integers only.)

use std::path::{Path, PathBuf};

use super::cells::{CellData, Cells, Contents, Shape};
use super::tokens::{Fault, Tokens};
use super::{ReadError, WriteError, at, read_bytes, text, write_atomically};
use crate::mesh::{Vec3, VertexId};

/// The comment before the names of attributes.
const NAMES: &str = "# attribute names: ";

/// Reads the pair of which `path` names either; attributes and markers of vertices are skipped.
pub(super) fn read(path: &Path) -> Result<Contents, ReadError> {
    let [node_path, ele_path] = ["node", "ele"].map(|ending| part(path, ending));
    let text = |path: &Path| text::plain(path, read_bytes(path)?);
    let nodes = parse_nodes(&text(&node_path)?).map_err(at(&node_path))?;
    parse_tets(&text(&ele_path)?, nodes).map_err(at(&ele_path))
}

/// The file of the pair with this ending, in lower or, if only that is there, in upper case.
fn part(path: &Path, ending: &str) -> PathBuf {
    let lower = path.with_extension(ending);
    let upper = path.with_extension(ending.to_uppercase());
    if !lower.exists() && upper.exists() { upper } else { lower }
}

/// The vertices of a `.node` file.
pub(super) struct Nodes {
    coordinates: Vec<f64>,
    /// The number of the first vertex.
    first: i64,
}

pub(super) fn parse_nodes(bytes: &[u8]) -> Result<Nodes, Fault> {
    let mut tokens = Tokens::with_comments(bytes);
    let [count, dimension, attributes, markers] = header(&mut tokens, "vertices", [0, 3, 0, 0])?;
    if dimension != 3 {
        return Err((Some(tokens.line()), format!("the vertices have {dimension} coordinates; a solid needs 3")));
    }
    let mut nodes = Nodes { coordinates: Vec::new(), first: 1 };
    for entry in 0..count {
        let number: i64 = tokens.number("the number of a vertex", "a whole number")?;
        if entry == 0 {
            nodes.first = number;
        }
        check_number(&tokens, number, nodes.first, entry, "vertex")?;
        for _ in 0..3 {
            nodes.coordinates.push(tokens.number("a coordinate", "a number")?);
        }
        skip(&mut tokens, attributes.saturating_add(markers))?;
        pass_over_line(&mut tokens);
    }
    Ok(nodes)
}

pub(super) fn parse_tets(bytes: &[u8], nodes: Nodes) -> Result<Contents, Fault> {
    let mut tokens = Tokens::with_comments(bytes);
    let [count, corners, attributes, _] = header(&mut tokens, "tets", [0, 4, 0, 0])?;
    if !matches!(corners, 4 | 10) {
        let message = format!("the tets have {corners} nodes each; tets have 4, or 10 if they are of second order");
        return Err((Some(tokens.line()), message));
    }
    let mut cells = Cells::default();
    // Without tets there are no numbers against which the count of attributes could be held.
    let attributes = if count == 0 { 0 } else { tokens.check_room(attributes, 2, "the count of attributes")? };
    let mut cell_data: CellData = names(bytes, attributes).into_iter().map(|name| (name, Vec::new())).collect();
    let mut first = 1;
    for entry in 0..count {
        let number = tokens.number("the number of a tet", "a whole number")?;
        if entry == 0 {
            first = number;
        }
        check_number(&tokens, number, first, entry, "tet")?;
        let mut tet = [0; 10];
        for vertex in &mut tet[..corners as usize] {
            let token = tokens.expect("a vertex of a tet")?;
            let number: i64 = token.parse("a vertex of a tet", "a whole number")?;
            let last = nodes.first.saturating_add(nodes.coordinates.len() as i64 / 3 - 1);
            if number < nodes.first || number > last {
                let message = format!("a tet names vertex {number}, but the vertices are {} to {last}", nodes.first);
                return Err((Some(token.line), message));
            }
            *vertex = number - nodes.first;
        }
        cells.push(Shape::Tet, &tet[..corners as usize]);
        for (_, values) in &mut cell_data {
            values.push(tokens.number("an attribute of a tet", "a number")?);
        }
        pass_over_line(&mut tokens);
    }
    cells.finish(nodes.coordinates, cell_data)
}

/// The first line: a count, then up to three numbers, those missing as in `default`.
fn header(tokens: &mut Tokens, what: &str, mut numbers: [u64; 4]) -> Result<[u64; 4], Fault> {
    let first = tokens.clone().expect(what)?;
    // A number, its separator and four fields more.
    numbers[0] = tokens.bounded_count(&format!("the count of {what}"), 8)? as u64;
    for number in &mut numbers[1..] {
        if let Some(token) = tokens.next_if(|token| token.line == first.line) {
            *number = token.parse("a count in the first line", "a whole number >= 0")?;
        }
    }
    Ok(numbers)
}

/// What a line has beyond what the first line promises, as TetGen does: there are files whose markers are not announced.
fn pass_over_line(tokens: &mut Tokens) {
    let line = tokens.line();
    while tokens.next_if(|token| token.line == line).is_some() {}
}

fn check_number(tokens: &Tokens, number: i64, first: i64, entry: u64, what: &str) -> Result<(), Fault> {
    if !matches!(first, 0 | 1) || number != first + entry as i64 {
        let message = format!(
            "{what} {number} stands where number {} should: they must be numbered in order from 0 or 1",
            first.clamp(0, 1) + entry as i64
        );
        return Err((Some(tokens.line()), message));
    }
    Ok(())
}

fn skip(tokens: &mut Tokens, count: u64) -> Result<(), Fault> {
    (0..count).try_for_each(|_| tokens.expect("an attribute or marker").map(|_| ()))
}

/// The names in the comment, if there are as many as attributes; "attribute 1" and so on otherwise.
fn names(bytes: &[u8], attributes: usize) -> Vec<String> {
    let comment = bytes.split(|&b| b == b'\n').find_map(|line| line.strip_prefix(NAMES.as_bytes()));
    let comment = String::from_utf8_lossy(comment.unwrap_or_default());
    let names: Vec<String> = comment.trim().split(", ").map(str::to_owned).collect();
    if names.len() == attributes && !comment.is_empty() {
        return names;
    }
    (1..=attributes).map(|number| format!("attribute {number}")).collect()
}

/// Writes both files, of which `path` names either; each is whole or not there, `.ele` last.
pub(super) fn write(
    path: &Path,
    points: &[Vec3],
    tets: &[[VertexId; 4]],
    cell_data: &CellData,
) -> Result<(), WriteError> {
    write_atomically(&path.with_extension("node"), |file| {
        writeln!(file, "{} 3 0 0", points.len())?;
        (1..).zip(points).try_for_each(|(number, p)| writeln!(file, "{number} {:?} {:?} {:?}", p.x, p.y, p.z))
    })?;
    write_atomically(&path.with_extension("ele"), |file| {
        if !cell_data.is_empty() {
            let names: Vec<&str> = cell_data.iter().map(|(name, _)| name.as_str()).collect();
            writeln!(file, "{NAMES}{}", names.join(", "))?;
        }
        writeln!(file, "{} 4 {}", tets.len(), cell_data.len())?;
        for (index, tet) in tets.iter().enumerate() {
            let [a, b, c, d] = tet.map(|v| u64::from(v.0) + 1);
            write!(file, "{} {a} {b} {c} {d}", index + 1)?;
            cell_data.iter().try_for_each(|(_, values)| write!(file, " {:?}", values[index]))?;
            writeln!(file)?;
        }
        Ok(())
    })
}
