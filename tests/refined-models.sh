#!/usr/bin/env bash
# What refinement where the largest K sits comes to on solids of any shape, results/refined-models/table.md: each NAME.mesh of a folder mapped from a
# spherical start with its boundary fixed, as it is and with at most 20 % more tets. The runs are kept in RUNS, and one that is there
# already is not made again. Needs jq.
#
#   tests/refined-models.sh MODELS_DIR RUNS [QCBALL [NAME...]]      by default target/release/qcball and all names
set -euo pipefail
models=$(cd "$1" && pwd)
mkdir -p "$2" && runs=$(cd "$2" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${3:-target/release/qcball}")
names=("${@:4}")
[ ${#names[@]} -gt 0 ] || names=($(basename -s .mesh "$models"/*.mesh))
for name in "${names[@]}"; do
    for rounds in 0 8; do
        case=$runs/$name-$rounds
        if [ ! -e "$case/report.json" ]; then
            printf '[domain]\nfile = "%s"\n[map]\nkind = "spherical"\n[refine]\nrounds = %s\ntets = "20 %%"\n' "$models/$name.mesh" "$rounds" > "$case.toml"
            # Exit code 1 is a map that is not bijective.
            "$qcball" run "$case.toml" --out "$case" --threads 1 --quiet > /dev/null || [ $? = 1 ]
        fi
    done
    "$qcball" verify "$runs/$name-8" > "$runs/$name-verify" && verified=yes || verified=no
    jq -r --arg name "$name" --arg verified "$verified" --slurpfile plain "$runs/$name-0/report.json" '
        def up($n): if . == null then "inf" else . * pow(10; $n) | ceil / pow(10; $n) | tostring end;
        def down: . * 100 | floor / 100;
        # Where K has not fallen by half: the worst tet of the refined domain.
        def worst: if .final.max_k > $plain[0].final.max_k / 2 then "\(.bottleneck.tet), at \(.bottleneck.place.kind) \(.bottleneck.place | if .vertices then .vertices | map(tostring) | join("-") else .vertex end)" else "" end;
        ([.bounds[] | select(.name == "edge-ratio" or .name == "trace" or .name == "vertex") | .value] | max) as $bound
        | [ $name, .refined.tets_before, ($plain[0].final.max_k | up(2)), "\(.domain.tets - .refined.tets_before) (\((.domain.tets / .refined.tets_before - 1) * 1000 | round / 10) %)",
            (.final.max_k | up(2)), (.final.max_k / $plain[0].final.max_k | up(3)), ($bound | down), .refined.end, ($plain[0].cpu_seconds | up(0)), (.cpu_seconds | up(0)), $verified, worst, .limit.sentence ]
        | "| " + (map(tostring) | join(" | ")) + " |"' "$runs/$name-8/report.json" >> "$runs/rows.new"
done
mv "$runs/rows.new" "$runs/rows"
mkdir -p results/refined-models
{
    cat <<'TEXT'
# Refinement where the largest K sits, on solids of any shape

Made by `tests/refined-models.sh`: tet meshes as they came, mapped onto the ball from a spherical start with the boundary fixed, as they are
and with 8 rounds of refinement and at most 20 % more tets. *Ratio*: max K refined over max K. *Bound*: what the boundary's values allow at
best on any mesh inside, as far as it is known. *Verified*: by `qcball verify`. *CPU*: processor seconds of the two runs.
*Worst tet*: where max K has not fallen by half, the tet of `domain.vtu` that holds it, and the bottleneck it is at.

| model | tets | max K | tets added | max K refined | ratio | bound | ended | CPU s | refined | verified | worst tet | what limits K |
|---|--:|--:|--:|--:|--:|--:|---|--:|--:|---|---|---|
TEXT
    cat "$runs/rows"
} > results/refined-models/table.md
echo results/refined-models/table.md
