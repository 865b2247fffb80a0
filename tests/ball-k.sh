#!/usr/bin/env bash
# K and K onto the ball on finer and finer shell meshes of the cube, results/ball-k/table.md. Some minutes. Needs jq.
#
#   tests/ball-k.sh [QCBALL]      by default target/release/qcball
set -euo pipefail
cd "$(dirname "$0")/.."
qcball=$(realpath "${1:-target/release/qcball}")
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT

mkdir -p results/ball-k
{
    cat <<TEXT
# K onto the ball

Made by \`tests/ball-k.sh\`: the cube of \`configs/cube.toml\` with 3 layers, each of its 48 triangles split into n^2. *Start*: the radial map;
*final*: optimized. K is that of the map onto the polyhedron; K onto the ball, that of the map followed by the radial map of this
polyhedron onto the ball, is given as [sampled, certified]. Every quasi-conformal map of the cube onto the ball has K >= 2.

| n | tets | image / ball | start, K | start, K onto the ball | final, K | final, K onto the ball | final, the one over the other |
|--:|--:|--:|--:|--:|--:|--:|--:|
TEXT
    for n in 1 2 4 8 16; do
        "$qcball" run configs/cube.toml --quiet --out "$dir" --set mesh.subdivisions=$n --set mesh.layers=3
        jq -r --arg n "$n" '
            def digits($n): . * pow(10; $n) | round / pow(10; $n);
            def up: . * 1e4 | ceil / 1e4;
            def down: . * 1e4 | floor / 1e4;
            def interval: "[\(.sampled | down), \(.certified | up)]";
            "| \([$n, .domain.tets, (.ball_fraction | digits(4)), (.initial.max_k | digits(4)), (.initial.ball_k | interval),
            (.final.max_k | digits(4)), (.final.ball_k | interval), (.final.ball_k.certified / .final.max_k | digits(4))] | map(tostring) | join(" | ")) |"' \
            "$dir/report.json"
    done
} > "$dir/table.md"
cp "$dir/table.md" results/ball-k/table.md
echo results/ball-k/table.md
