//! An order of unknowns in which neighbours lie near each other.

/// The reverse Cuthill-McKee order of a graph given as edges between `count` nodes: new position -> old index.
///
/// Breadth first from the nodes of least degree, neighbours by ascending degree, then reversed (George 1971). Meshes come in
/// any order; in this one an incomplete factor without fill drops less, and what a row refers to is still in the cache.
pub fn reverse_cuthill_mckee(count: usize, edges: &[(u32, u32)]) -> Vec<u32> {
    let mut starts = vec![0usize; count + 1];
    for &(a, b) in edges {
        starts[a as usize + 1] += 1;
        starts[b as usize + 1] += 1;
    }
    for i in 0..count {
        starts[i + 1] += starts[i];
    }
    let degree = |node: u32| starts[node as usize + 1] - starts[node as usize];
    let mut next = starts.clone();
    let mut neighbours = vec![0u32; 2 * edges.len()];
    for (from, to) in edges.iter().flat_map(|&(a, b)| [(a, b), (b, a)]) {
        neighbours[next[from as usize]] = to;
        next[from as usize] += 1;
    }
    let mut roots: Vec<u32> = (0..count as u32).collect();
    roots.sort_by_key(|&node| degree(node));
    let mut seen = vec![false; count];
    let mut order = Vec::with_capacity(count);
    for root in roots {
        if std::mem::replace(&mut seen[root as usize], true) {
            continue;
        }
        let mut done = order.len();
        order.push(root);
        while done < order.len() {
            let node = order[done] as usize;
            let first_new = order.len();
            for &neighbour in &neighbours[starts[node]..starts[node + 1]] {
                if !std::mem::replace(&mut seen[neighbour as usize], true) {
                    order.push(neighbour);
                }
            }
            order[first_new..].sort_by_key(|&node| (degree(node), node));
            done += 1;
        }
    }
    order.reverse();
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shuffled_path_and_a_lone_node_come_out_in_line() {
        // The path 3 - 0 - 4 - 1 - 5 and the node 2.
        let order = reverse_cuthill_mckee(6, &[(3, 0), (4, 0), (4, 1), (5, 1)]);
        assert_eq!(order, [5, 1, 4, 0, 3, 2]);
    }
}
