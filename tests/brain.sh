#!/usr/bin/env bash
# A brain, results/brain: the inflated, pial and white surface of the left hemisphere of fsaverage5 (10,242 vertices each), meshed by
# TetGen and mapped onto the ball, boundary values fixed; and FreeSurfer's own sphere of the same vertices beside ours. Needs jq, TetGen.
#
#   tests/brain.sh DATA RUNS [QCBALL [ITERATIONS]]      by default target/release/qcball, and at most 300 iterations
#
# DATA is a folder with infl_left.gii.gz, pial_left.gii.gz, white_left.gii.gz: nilearn/datasets/data/fsaverage5 of the Python package
# nilearn (`pip download --no-deps nilearn`, then unzip). The data is FreeSurfer's and is not kept here.
set -euo pipefail
data=$(cd "$1" && pwd)
mkdir -p "$2" && runs=$(cd "$2" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${3:-target/release/qcball}") iterations=${4:-300}
mkdir -p results/brain
for surface in infl pial white; do
    case=$runs/$surface
    printf '[domain]\nfile = "%s"\n[mesh]\nkind = "tetgen"\nquality = 1.5\n[optimize]\nmax_iterations = %s\n' \
        "$data/${surface}_left.gii.gz" "$iterations" > "$case.toml"
    [ -e "$case/report.json" ] || "$qcball" run "$case.toml" --out "$case" --threads 1 --quiet || [ $? = 1 ]
    # The path is of a machine.
    sed "s|$data/||; s|$runs/||g" "$case/summary.txt" > "results/brain/$surface.txt"
done
cp "$runs/pial/map.png" results/brain/pial.png 2> /dev/null || true
