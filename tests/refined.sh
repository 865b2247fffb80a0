#!/usr/bin/env bash
# What refinement where the largest K sits comes to, results/refined/table.md: meshes of a folder optimised from NAME-init.mesh as they
# are and with rounds of refinement, one thread. Some minutes. Needs jq.
#
#   tests/refined.sh MESHES_DIR [QCBALL]      by default target/release/qcball
set -euo pipefail
meshes=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${2:-target/release/qcball}")
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cat > "$dir/table.md" <<'TEXT'
# Refinement where the largest K sits

Made by `tests/refined.sh`: `qcball optimize`, then the same with `--refine` and `--refine-tets`, the rounds and the most tets that may be
added. The surface and the values there are the same in both. *Bound*: what they allow at best on any mesh inside, as far as it is known
(edge-ratio, trace and vertex). *CPU*: processor seconds, and how many times those without refinement. K is rounded up, bounds down.

| mesh | tets | max K | rounds | tets allowed | rounds made | tets added | max K refined | bound | ended | CPU s | times |
|---|--:|--:|--:|--:|--:|--:|--:|--:|---|--:|--:|
TEXT
while read -r name rounds allowed; do
    optimize() { "$qcball" optimize "$meshes/$name-rest.mesh" "$meshes/$name-init.mesh" "$dir/out.mesh" --threads 1 --json "$@"; }
    optimize > "$dir/plain.json"
    optimize --refine "$rounds" --refine-tets "$allowed" > "$dir/refined.json"
    jq -r --arg name "$name" --arg rounds "$rounds" --arg allowed "$allowed" --slurpfile plain "$dir/plain.json" '
        def up($n): . * pow(10; $n) | ceil / pow(10; $n);
        def down($n): . * pow(10; $n) | floor / pow(10; $n);
        ([.bounds[] | select(.name == "edge-ratio" or .name == "trace" or .name == "vertex") | .value] | max) as $bound
        | [ $name, .refined.tets_before, ($plain[0].final.max_k | up(4)), $rounds, $allowed, (.refined.rounds | length),
            "\(.tets - .refined.tets_before) (\((.tets / .refined.tets_before - 1) * 1000 | round / 10) %)", (.final.max_k | up(4)), ($bound | down(4)),
            .refined.end, (.cpu_seconds | up(1)), (.cpu_seconds / $plain[0].cpu_seconds | up(1)) ]
        | "| " + (map(tostring) | join(" | ")) + " |"' "$dir/refined.json" >> "$dir/table.md"
done <<'MESHES'
cube-1k 8 60%
cube-1k 8 150%
bumpy-1k 8 60%
dodeca-1k 8 60%
icosa-1k 8 60%
octa-1k 8 60%
prism-1k 8 60%
tetra-1k 8 60%
bumpy-10k 8 10%
bumpy-10k 8 60%
cube-10k 8 10%
cube-10k 8 60%
dodeca-10k 8 10%
icosa-10k 8 10%
octa-10k 8 10%
octa-10k 8 60%
prism-10k 8 10%
prism-10k 8 60%
tetra-10k 8 10%
tetra-10k 8 60%
cube-100k 8 3%
cube-100k 14 3%
MESHES
mkdir -p results/refined
cp "$dir/table.md" results/refined/table.md
echo results/refined/table.md
