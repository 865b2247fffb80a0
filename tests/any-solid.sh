#!/usr/bin/env bash
# Solids of any shape, results/any-solid/table.md: each NAME.mesh of a folder mapped onto the ball by a config that names the file and
# nothing else but the limit of the optimisation. Needs jq.
#
#   tests/any-solid.sh MODELS_DIR [QCBALL [SECONDS]]      by default target/release/qcball and 60 s
set -euo pipefail
models=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${2:-target/release/qcball}") seconds=${3:-60}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
for mesh in "$models"/*.mesh; do
    name=$(basename "$mesh" .mesh)
    printf '[domain]\nfile = "%s"\n[optimize]\ntime_limit = %s\n' "$mesh" "$seconds" > "$dir/$name.toml"
    # Exit code 1 is a map that is not bijective, which the table says.
    "$qcball" run "$dir/$name.toml" --out "$dir/$name" --quiet || [ $? = 1 ]
    jq -r --arg name "$name" '
        def digits($n): if . == null then "inf" else . * pow(10; $n) | round / pow(10; $n) | tostring end;
        def bound($name): [.bounds[] | select(.name == $name) | .value] | max | digits(2);
        [ $name, .splits.tets_before // .domain.tets, .domain.tets, (.boundary_map | if . then .max_stretch | digits(2) else "radial" end),
          .untangling.flipped_before // 0, .untangling.iterations // 0, .untangling.refinement_splits // 0,
          (.untangling_seconds | digits(1)), (.seconds | digits(0)), bound("trace"), (.best_bound | digits(2)),
          (.final.max_k | digits(2)), (.final.mean_k | digits(2)), (.final.p99_k | digits(1)), .final.flipped,
          (if .bijective then "yes" else "no" end), .stop ]
        | "| " + (map(tostring) | join(" | ")) + " |"' "$dir/$name/report.json" | tee -a "$dir/rows"
done
mkdir -p results/any-solid
{
    cat <<TEXT
# Solids of any shape

Made by \`tests/any-solid.sh\`; qcball revision $(git rev-parse --short HEAD). Each is a tet mesh as it came, mapped onto the ball by a
config that names its file, the optimisation limited to $seconds s. *Tets* as they came and after the splits that free locked ones
and help resisting ones. The boundary is mapped by progressive embedding, no triangle flipped and the sphere covered once by exact
predicate; *s1/s2* is its largest stretch there, *radial* where the solid is star-shaped. *Start*: flipped tets of the hyperbolic harmonic start inside; *steps* and
*splits*: sweeps until none was, and edges halved for it. *Untangling* and *all*: seconds of a clock, on a machine with other work.

| model | tets | after splits | s1/s2 | start | steps | splits | untangling, s | all, s | trace bound | best bound | max K | mean K | 99 % K | flipped | bijective | stop |
|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|---|
TEXT
    cat "$dir/rows"
} > "$dir/table.md"
cp "$dir/table.md" results/any-solid/table.md
echo results/any-solid/table.md
