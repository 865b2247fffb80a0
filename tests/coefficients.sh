#!/usr/bin/env bash
# The table of coefficients, results/coefficients/table.md: runs the two sweeps, checks every case by `qcball verify` and
# puts their figures side by side. Needs jq.
#
#   tests/coefficients.sh [QCBALL]      by default target/release/qcball
set -euo pipefail
cd "$(dirname "$0")/.."
qcball=${1:-target/release/qcball}
out=results/coefficients
table=$(mktemp)
trap 'rm -f "$table"' EXIT

cat > "$table" <<'TEXT'
# Table of coefficients

Made by `tests/coefficients.sh` from the sweeps `configs/coefficients.toml` and `configs/coefficients-prisms.toml`; every row is
from a folder that `qcball verify` accepts. Bounds are rounded down in the last decimal, K up, gaps to
the nearest.

What the columns speak of:

- **pi/a** (the wedge bound), *K_I of any qc map* of the solid onto the ball, boundary values free: proved.
- **(41)**, *K_I of any qc map*: as quoted in the paper; not proved.
- **vertex**, **trace**, *qc maps of the smooth solid onto the ball with the radial boundary values*: proved; **trace C1** if
  the map is C^1 up to the boundary.
- **radial K**, the largest K of the radial map of the smooth solid, the limit of finer meshes.
- **our K**, the *piecewise-linear* map of this mesh, its boundary vertices on the sphere at their radial images.
- **certified**, a bound for K of *all piecewise-linear maps of this mesh with this boundary*, and its name; **gap** = our K / certified.
- **before**, that bound in before-the-checks.tsv, from the time when what was called proved had not to pass a checker in interval
  arithmetic.

The image of a mesh is a polyhedron inscribed in the ball, and so its corners open less than on the ball: on a coarse mesh our K and
the certified bound may be below what holds for the smooth solid. No gap is taken between the two.

The star centre is the centre of the largest ball in the kernel. For all solids but the pyramids that is the volume centroid, and
the columns of the smooth solid are closed forms.

| solid | subdivisions | tets | pi/a | (41) | vertex | trace | trace C1 | radial K | our K | certified | by | before | gap |
|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|--:|--:|
TEXT

for config in coefficients coefficients-prisms; do
    "$qcball" sweep "configs/$config.toml" --out "$out/$config"
    tail -n +2 "$out/$config/index.csv" | cut -d, -f2 | while read -r id; do
        folder=$out/$config/cases/$id
        "$qcball" verify "$folder" > /dev/null || { echo "FAILED: $folder is not verified" >&2; exit 1; }
        jq -r --rawfile before "$out/before-the-checks.tsv" '
            def value(name): [.bounds[] | select(.name == name) | .value] | max;
            def decimals: tostring | if test("[.]") then . else . + "." end | . + "000" | capture("^(?<n>[0-9]*[.][0-9]{3})").n;
            # 1e-9 is for decimal fractions that a float just misses.
            def down: if . == null then "-" else (. * 1e3 + 1e-9 | floor) / 1e3 | decimals end;
            def up: if . == null then "-" else (. * 1e3 - 1e-9 | ceil) / 1e3 | decimals end;
            (.overrides | map(split("=") | {(.[0]): .[1]}) | add) as $keys
            | ([.bounds[] | select(.applies and .certified)] | max_by(.value)) as $best
            | ($keys["domain.solid"]
                + (if $keys["domain.sides"] then ", \($keys["domain.sides"]) sides, height \($keys["domain.height"][0:6])" else "" end)) as $solid
            | [$before | split("\n")[] | split("\t") | select(.[0] == $solid and .[1] == $keys["mesh.subdivisions"]) | .[2]][0] as $earlier
            | [ $solid, $keys["mesh.subdivisions"], .domain.tets,
                (value("wedge") | down), (value("caraman") | down), (value("vertex-smooth") | down),
                (value("trace-smooth") | down), (value("trace-smooth-c1") | down), (.radial_smooth_k | up),
                (.final.max_k | up), ($best.value | down), $best.name, ($earlier // "-"), (.gap * 1e3 | round / 1e3 | decimals) ]
            | "| " + (map(tostring) | join(" | ")) + " |"' "$folder/report.json" >> "$table"
    done
done
mkdir -p "$out"
mv "$table" "$out/table.md"
chmod 644 "$out/table.md"
trap - EXIT
echo "$out/table.md"
