#!/usr/bin/env bash
# The gaps on the meshes of a folder, results/gaps/table.md: each NAME-rest.mesh is optimised from NAME-init.mesh, and the result set
# beside all bounds and a Gram certificate. Needs jq.
#
#   tests/gaps.sh MESHES_DIR [QCBALL]      by default target/release/qcball
set -euo pipefail
meshes=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
qcball=${2:-target/release/qcball}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cat > "$dir/table.md" <<'TEXT'
# Gaps

Made by `tests/gaps.sh`. *Best bound*: the largest one proved for K of all orientation-preserving piecewise-linear maps of the
mesh with these boundary positions, *gap* = max K / best bound. *gram*: what the Gram certificate proves by itself. Bounds are rounded
down, K and gaps up. *Change*: of the best bound since before-the-checks.csv, from the time when what was called proved had not to
pass a checker in interval arithmetic; 0 is less than 0.005 %. *Seconds*: those of `qcball bounds --certify --time-limit 600`, of
the processor, over all threads. *Refined*: max K, its best bound and their gap after 8 rounds of refinement where K sits, at most 60 % of tets
added, of the maps of that mesh.

| mesh | tets | max K | best bound | its name | gram | gap | change | seconds | refined | its bound | its gap | what limits K |
|---|--:|--:|--:|---|--:|--:|--:|--:|--:|--:|--:|---|
TEXT
for size in 1k 10k; do
    for rest in "$meshes"/*-"$size"-rest.mesh; do
        name=$(basename "$rest" -rest.mesh)
        "$qcball" optimize "$rest" "$meshes/$name-init.mesh" "$dir/$name.mesh" --threads 1 --no-polish --json > "$dir/$name.json"
        bounds() { "$qcball" bounds "$rest" "$dir/$name.mesh" --certify --time-limit 600 --json > "$dir/$name-bounds.json"; }
        "$qcball" optimize "$rest" "$meshes/$name-init.mesh" "$dir/refined.mesh" --threads 1 --no-polish --quiet --refine 8 --refine-tets 60% > "$dir/said"
        "$qcball" bounds "$dir/refined-domain.mesh" "$dir/refined.mesh" --certify --time-limit 600 --json > "$dir/$name-refined.json"
        seconds=$({ TIMEFORMAT=%U; time bounds; } 2>&1)
        before=$(awk -F, -v mesh="$name" '$1 == mesh { print $2 }' results/gaps/before-the-checks.csv)
        jq -r --arg name "$name" --arg seconds "$seconds" --argjson before "${before:-null}" --slurpfile map "$dir/$name.json" --slurpfile fine "$dir/$name-refined.json" '
            ([.bounds[] | select(.applies and .certified)] | max_by(.value)) as $best
            | ([.bounds[] | select(.name == "gram") | .value] | max) as $gram
            | def shown: tostring | if test("[.]") then . else . + "." end | . + "0000" | capture("^(?<n>[0-9]*[.][0-9]{4})").n;
              def down: . * 1e4 | floor / 1e4 | shown;
              def up: . * 1e4 | ceil / 1e4 | shown;
            [ $name, $map[0].tets, (.max_k | up), ($best.value | down), $best.name, ($gram | down), (.gap * 1e4 | ceil / 1e4 | shown),
              (if $before then ($best.value / $before - 1) * 1e4 | round / 100 | "\(if . > 0 then "+" else "" end)\(.) %" else "-" end), $seconds,
              ($fine[0].max_k | up), ([$fine[0].bounds[] | select(.applies and .certified) | .value] | max | down), ($fine[0].gap | up), .limit.sentence ]
            | "| " + (map(tostring) | join(" | ")) + " |"' "$dir/$name-bounds.json" >> "$dir/table.md"
    done
done
mkdir -p results/gaps
cp "$dir/table.md" results/gaps/table.md
echo results/gaps/table.md
