//! `$Elements` and `$ElementData`.

use super::{Nodes, Places, Source, Version, data_number};
use crate::mesh::io::cells::{Cells, Contents, Shape};
use crate::mesh::io::numbers::Kind;
use crate::mesh::io::tokens::Fault;

/// Gmsh's number for a linear tetrahedron.
pub(super) const TETRAHEDRON: i64 = 4;

/// The elements so far; vertices are still tags.
#[derive(Default)]
pub(super) struct Elements {
    volumes: List,
    /// Triangles and the like, which are of interest where there are no volumes.
    polygons: List,
    skipped: usize,
}

/// Elements one after the other: kind, tag, and where the nodes end in the row of all.
#[derive(Default)]
struct List {
    elements: Vec<(i64, i64, usize)>,
    nodes: Vec<i64>,
}

impl List {
    fn push(&mut self, kind: i64, tag: i64, nodes: &[i64]) {
        self.nodes.extend_from_slice(nodes);
        self.elements.push((kind, tag, self.nodes.len()));
    }

    fn iter(&self) -> impl Iterator<Item = (i64, i64, &[i64])> {
        let starts = std::iter::once(0).chain(self.elements.iter().map(|element| element.2));
        self.elements.iter().zip(starts).map(|(&(kind, tag, end), start)| (kind, tag, &self.nodes[start..end]))
    }
}

/// An array of `$ElementData`: tags of elements and their values.
pub(super) struct Data {
    name: String,
    values: Vec<(i64, f64)>,
}

impl Elements {
    pub(super) fn read(&mut self, source: &mut Source) -> Result<(), Fault> {
        match source.version {
            Version::One => self.read_first(source),
            Version::Two if source.is_text() => self.read_lines(source),
            Version::Two => self.read_binary(source),
            Version::Four | Version::FourOne => self.read_blocks(source),
        }
    }

    /// Version 1: `tag type physical elementary count-of-nodes nodes...`.
    fn read_first(&mut self, source: &mut Source) -> Result<(), Fault> {
        let count = source.text_count(8, "the count of $ELM")?;
        for _ in 0..count {
            let [tag, kind, _, _, nodes] = source.fixed(Kind::Int32, "an element")?;
            let wanted = node_count(kind).map_err(|message| source.fault(message))?;
            if nodes as u64 != wanted {
                return Err(source.fault(format!("the element {tag} of type {kind} has {nodes} nodes, not {wanted}")));
            }
            let vertices = source.integers(Kind::Int32, wanted, "the nodes of an element")?;
            self.push(kind, tag, &vertices);
        }
        Ok(())
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
        let what = "the counts of $Elements";
        let (blocks, tag) = match source.version {
            Version::FourOne => (source.fixed::<4>(source.size, what)?[0], source.size),
            _ => (source.fixed::<2>(source.size, what)?[0], Kind::Int32),
        };
        for _ in 0..blocks.max(0) {
            let [_, _, kind] = source.fixed(Kind::Int32, "the head of a block of elements")?;
            let [count] = source.fixed(source.size, "the count of a block of elements")?;
            let nodes = node_count(kind).map_err(|message| source.fault(message))?;
            let rows = source.integers(tag, (count as u64).saturating_mul(1 + nodes), "a block of elements")?;
            rows.chunks_exact(1 + nodes as usize).for_each(|row| self.push(kind, row[0], &row[1..]));
        }
        Ok(())
    }

    fn push(&mut self, kind: i64, tag: i64, nodes: &[i64]) {
        match shape(kind) {
            Shape::Other => self.skipped += 1,
            Shape::Polygon(_) => self.polygons.push(kind, tag, nodes),
            _ => self.volumes.push(kind, tag, nodes),
        }
    }

    /// Resolves all tags.
    pub(super) fn finish(self, nodes: Nodes, data: Vec<Data>) -> Result<Contents, Fault> {
        let mut cells = Cells::default();
        cells.skip(self.skipped);
        let elements = if self.volumes.elements.is_empty() {
            &self.polygons
        } else {
            cells.skip(self.polygons.elements.len());
            &self.volumes
        };
        let mut vertices = Vec::new();
        for (kind, tag, tags) in elements.iter() {
            vertices.clear();
            for &node in tags {
                vertices.push(nodes.places.of(node).ok_or_else(|| {
                    (None, format!("the element {tag} names the node {node}, but no node has this tag"))
                })?);
            }
            cells.push(shape(kind), &vertices);
        }
        let mut cell_data: Vec<(String, Vec<f64>)> = Vec::new();
        if !data.is_empty() {
            let tags: Vec<i64> = self.volumes.elements.iter().map(|element| element.1).collect();
            let places = Places::new(&tags)
                .map_err(|tag| (None, format!("two elements have the tag {tag}, to which data refers")))?;
            let skipped = self.skipped + self.polygons.elements.len();
            for Data { name, values: given } in data {
                let mut values = vec![f64::NAN; skipped + tags.len()];
                for (tag, value) in given {
                    if let Some(place) = places.of(tag) {
                        values[skipped + place as usize] = value;
                    }
                }
                // A later time step takes the place of an earlier one.
                match cell_data.iter_mut().find(|(other, _)| *other == name) {
                    Some((_, earlier)) => *earlier = values,
                    None => cell_data.push((name, values)),
                }
            }
        }
        cells.finish(nodes.coordinates, cell_data)
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

/// What an element of this type is; the corners of one of higher order come first.
fn shape(kind: i64) -> Shape {
    match kind {
        2 | 9 | 20..=25 => Shape::Polygon(3),
        3 | 10 | 16 => Shape::Polygon(4),
        TETRAHEDRON | 11 | 29..=31 => Shape::Tet,
        5 | 12 | 17 => Shape::Hexahedron,
        6 | 13 | 18 => Shape::Prism,
        7 | 14 | 19 => Shape::Pyramid,
        _ => Shape::Other,
    }
}

/// How many nodes an element of this type has.
fn node_count(kind: i64) -> Result<u64, String> {
    Ok(match kind {
        15 => 1,
        1 => 2,
        2 | 8 => 3,
        3 | TETRAHEDRON | 26 => 4,
        7 | 27 => 5,
        6 | 9 | 28 => 6,
        5 | 16 => 8,
        10 | 20 => 9,
        11 | 21 => 10,
        22 => 12,
        19 => 13,
        14 => 14,
        18 | 23 | 24 => 15,
        13 => 18,
        17 | 29 => 20,
        25 => 21,
        12 => 27,
        30 => 35,
        31 => 56,
        _ => {
            return Err(format!(
                "the mesh has elements of Gmsh's type {kind}, which are not read; split or remove them"
            ));
        }
    })
}
