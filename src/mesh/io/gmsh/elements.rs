//! `$Elements` and `$ElementData`.

use super::{Nodes, Places, Source, Version, data_number};
use crate::mesh::io::numbers::Kind;
use crate::mesh::io::tet_file::{Cells, TetFile};
use crate::mesh::io::tokens::Fault;

/// Gmsh's number for a linear tetrahedron.
pub(super) const TETRAHEDRON: i64 = 4;

/// The elements so far; vertices are still tags.
#[derive(Default)]
pub(super) struct Elements {
    tets: Vec<[i64; 4]>,
    tet_tags: Vec<i64>,
    skipped: usize,
}

/// An array of `$ElementData`: tags of elements and their values.
pub(super) struct Data {
    name: String,
    values: Vec<(i64, f64)>,
}

impl Elements {
    pub(super) fn read(&mut self, source: &mut Source) -> Result<(), Fault> {
        match source.version {
            Version::Two if source.is_text() => self.read_lines(source),
            Version::Two => self.read_binary(source),
            Version::Four => self.read_blocks(source),
        }
    }

    /// Version 2, text: `tag type count-of-labels labels... nodes...`.
    fn read_lines(&mut self, source: &mut Source) -> Result<(), Fault> {
        let count = source.text_count(8, "the count of $Elements")?;
        for _ in 0..count {
            let [tag, kind, labels] = source.fixed(Kind::Int32, "an element")?;
            let nodes = node_count(kind).map_err(|message| source.fault(message))?;
            source.integers(Kind::Int32, labels as u64, "the labels of an element")?;
            let vertices = source.integers(Kind::Int32, nodes, "the nodes of an element")?;
            self.push(kind, tag, &vertices);
        }
        Ok(())
    }

    /// Version 2, binary: blocks of one type, each with a head.
    fn read_binary(&mut self, source: &mut Source) -> Result<(), Fault> {
        // Each is counted, and may have a head of its own or share one.
        let count = source.text_count(8, "the count of $Elements")?;
        let mut there = 0;
        while there < count {
            let [kind, in_block, labels] = source.fixed(Kind::Int32, "the head of a block of elements")?;
            let nodes = node_count(kind).map_err(|message| source.fault(message))?;
            if in_block < 1 || in_block as usize > count - there || labels < 0 {
                return Err(source.fault(format!("a block of {in_block} elements with {labels} labels each")));
            }
            there += in_block as usize;
            let (labels, columns) = (labels as usize, 1 + labels as u64 + nodes);
            let rows = source.integers(Kind::Int32, columns.saturating_mul(in_block as u64), "a block of elements")?;
            rows.chunks_exact(columns as usize).for_each(|row| self.push(kind, row[0], &row[1 + labels..]));
        }
        Ok(())
    }

    /// Version 4: blocks of one entity.
    fn read_blocks(&mut self, source: &mut Source) -> Result<(), Fault> {
        source.end_text_line();
        let [blocks, ..] = source.fixed::<4>(source.size, "the counts of $Elements")?;
        for _ in 0..blocks.max(0) {
            let [_, _, kind] = source.fixed(Kind::Int32, "the head of a block of elements")?;
            let [count] = source.fixed(source.size, "the count of a block of elements")?;
            let nodes = node_count(kind).map_err(|message| source.fault(message))?;
            let rows = source.integers(source.size, (count as u64).saturating_mul(1 + nodes), "a block of elements")?;
            rows.chunks_exact(1 + nodes as usize).for_each(|row| self.push(kind, row[0], &row[1..]));
        }
        Ok(())
    }

    fn push(&mut self, kind: i64, tag: i64, vertices: &[i64]) {
        match (kind, vertices) {
            (TETRAHEDRON, &[a, b, c, d]) => {
                self.tets.push([a, b, c, d]);
                self.tet_tags.push(tag);
            }
            _ => self.skipped += 1,
        }
    }

    /// Resolves all tags.
    pub(super) fn finish(self, nodes: Nodes, data: Vec<Data>) -> Result<TetFile, Fault> {
        let mut cells = Cells::default();
        for (tet, tag) in self.tets.iter().zip(&self.tet_tags) {
            let mut vertices = [0; 4];
            for (vertex, &node) in vertices.iter_mut().zip(tet) {
                *vertex = nodes.places.of(node).ok_or_else(|| {
                    (None, format!("the element {tag} names the node {node}, but no node has this tag"))
                })?;
            }
            cells.push_tet(vertices);
        }
        let mut cell_data: Vec<(String, Vec<f64>)> = Vec::new();
        if !data.is_empty() {
            let places = Places::new(&self.tet_tags)
                .map_err(|tag| (None, format!("two elements have the tag {tag}, to which data refers")))?;
            for Data { name, values: given } in data {
                let mut values = vec![f64::NAN; self.tets.len()];
                for (tag, value) in given {
                    if let Some(place) = places.of(tag) {
                        values[place as usize] = value;
                    }
                }
                // A later time step takes the place of an earlier one.
                match cell_data.iter_mut().find(|(other, _)| *other == name) {
                    Some((_, earlier)) => *earlier = values,
                    None => cell_data.push((name, values)),
                }
            }
        }
        cells.skip(self.skipped);
        let mut file = cells.finish(nodes.coordinates, Vec::new())?;
        file.cell_data = cell_data;
        Ok(file)
    }
}

/// One `$ElementData`, if it has one number an element.
pub(super) fn read_data(source: &mut Source) -> Result<Option<Data>, Fault> {
    let strings = source.tokens.bounded_count("the count of string labels", 2)?;
    source.tokens.rest_of_line();
    let mut name = None;
    for _ in 0..strings {
        let line = String::from_utf8_lossy(source.tokens.rest_of_line()).trim().to_owned();
        let bare = line.strip_prefix('"').and_then(|line| line.strip_suffix('"')).unwrap_or(&line);
        name.get_or_insert(bare.to_owned());
    }
    for _ in 0..source.tokens.bounded_count("the count of real labels", 2)? {
        source.tokens.number::<f64>("a real label", "a number")?;
    }
    let labels = source.tokens.bounded_count("the count of integer labels", 2)?;
    let mut integers = Vec::new();
    for _ in 0..labels {
        integers.push(source.tokens.number::<u64>("an integer label", "a whole number >= 0")?);
    }
    let [_, components, count, ..] = integers[..] else {
        return Err(source.fault("$ElementData needs the integer labels time step, components and count".into()));
    };
    source.end_text_line();
    source.tokens.check_room(count, 4, "the count of $ElementData")?;
    let mut values = Vec::new();
    for _ in 0..count {
        let [tag] = source.fixed(Kind::Int32, "a tag of $ElementData")?;
        if components != 1 {
            source.floats(components, "the numbers of $ElementData")?;
        } else if source.is_text() {
            values.push((tag, data_number(source.tokens.expect("a number of $ElementData")?)?));
        } else {
            let number = source.floats(1, "the numbers of $ElementData")?;
            values.push((tag, number[0]));
        }
    }
    Ok((components == 1).then(|| Data { name: name.unwrap_or_default(), values }))
}

/// How many nodes an element of this type has; volumes other than linear tets are refused.
fn node_count(kind: i64) -> Result<u64, String> {
    let name = match kind {
        15 => return Ok(1),
        1 => return Ok(2),
        2 | 8 => return Ok(3),
        3 | TETRAHEDRON | 26 => return Ok(4),
        27 => return Ok(5),
        9 | 28 => return Ok(6),
        16 => return Ok(8),
        10 | 20 => return Ok(9),
        21 => return Ok(10),
        22 => return Ok(12),
        23 | 24 => return Ok(15),
        25 => return Ok(21),
        5 => "hexahedra",
        6 => "prisms",
        7 => "pyramids",
        11 | 29..=31 => "tetrahedra of second or higher order",
        _ => {
            return Err(format!(
                "the mesh has elements of Gmsh's type {kind}, which are not read; split or remove them"
            ));
        }
    };
    Err(format!("the mesh has {name}; only linear tetrahedra are read: split them first"))
}
