#!/usr/bin/env bash
# What refinement of the surface too comes to, results/refined-surface/table.md: meshes of a folder, NAME-rest.mesh, run with their radial boundary
# values or a boundary that slides, one thread, each verified. Half an hour. Needs jq.
#
#   tests/refined-surface.sh MESHES_DIR [QCBALL]      by default target/release/qcball
set -euo pipefail
meshes=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${2:-target/release/qcball}")
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
mkdir -p results/refined-surface
cat > "$dir/table.md" <<'TEXT'
# Refinement of the surface too, for K onto the ball

Made by `tests/refined-surface.sh`: `qcball run` with `refine.surface = true`, from the radial map. *Limit*: K onto the ball of fine meshes with the same
boundary values and powers, where it is known. *Corners*: the exponent of the powers there. K is rounded up. Each row is verified.

| mesh | boundary values | corners | tets | K onto the ball | rounds | tets allowed | rounds made | tets added | K onto the ball refined | limit | ended | CPU s |
|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|--:|
TEXT
while read -r name values corners rounds allowed limit; do
    printf '[domain]\nfile = "%s"\n[boundary]\nvalues = "%s"\ncorners = %s\n[refine]\nrounds = %s\ntets = "%s"\nsurface = true\n' \
        "$meshes/$name-rest.mesh" "$values" "$corners" "$rounds" "$allowed" > "$dir/case.toml"
    rm -rf "$dir/out"
    "$qcball" run "$dir/case.toml" --out "$dir/out" --threads 1 --quiet > /dev/null
    "$qcball" verify "$dir/out" > /dev/null
    jq -r --arg name "$name" --arg values "$values" --arg corners "$corners" --arg rounds "$rounds" --arg allowed "$allowed" --arg limit "$limit" '
        def up($n): . * pow(10; $n) | ceil / pow(10; $n);
        .refined as $refined | $refined.tets_before as $before | ($refined.rounds[-1].tets // $before) as $tets
        | [ $name, $values, ($corners | gsub("\""; "")), $before, ($refined.max_k_before | up(4)), $rounds, $allowed, ($refined.rounds | length),
            "\($tets - $before) (\(($tets / $before - 1) * 1000 | round / 10) %)", (.final.ball_k.certified | up(4)), $limit,
            $refined.end, (.cpu_seconds | up(1)) ]
        | "| " + (map(tostring) | join(" | ")) + " |"' "$dir/out/report.json" >> "$dir/table.md"
    # What is ended early leaves the rows that it has.
    cp "$dir/table.md" results/refined-surface/table.md
done <<'MESHES'
cube-1k fixed "linear" 12 600% 4.41
cube-1k fixed "linear" 24 600% 4.41
tetra-1k fixed "linear" 12 600% 13.42
tetra-1k fixed "linear" 24 600% 13.42
octa-1k fixed "linear" 12 600% 4.77
octa-1k fixed "linear" 24 600% 4.77
bumpy-1k fixed "linear" 12 600% -
bumpy-1k fixed "linear" 24 600% -
cube-1k sliding 1.4 12 600% 2.83
tetra-1k sliding 2.2 12 600% 4.08
MESHES
echo results/refined-surface/table.md
