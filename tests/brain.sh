#!/usr/bin/env bash
# A brain, results/brain: the inflated, pial and white surface of the left hemisphere of fsaverage5 (10,242 vertices each) on the sphere,
# and filled by TetGen and mapped onto the ball from there, boundary values fixed. Needs TetGen.
#
#   tests/brain.sh DATA RUNS [QCBALL [ITERATIONS]]      by default target/release/qcball, and at most 150 iterations
#
# DATA is a folder with infl_left.gii.gz, pial_left.gii.gz and white_left.gii.gz: nilearn/datasets/data/fsaverage5 in the Python package
# nilearn (`pip download --no-deps nilearn`, then unzip). The data is FreeSurfer's and is not kept here. A run that is in RUNS already is
# not made again.
set -euo pipefail
data=$(cd "$1" && pwd)
mkdir -p "$2" && runs=$(cd "$2" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${3:-target/release/qcball}") iterations=${4:-150}
mkdir -p results/brain
for surface in infl pial white; do
    file=$data/${surface}_left.gii.gz case=$runs/$surface
    "$qcball" sphere "$file" "$runs/$surface.off" --json > "results/brain/$surface-sphere.json"
    if [ ! -e "$case/report.json" ]; then
        printf '[domain]\nfile = "%s"\n[mesh]\nkind = "tetgen"\nprogram_time_limit = 900\n[map]\nkind = "spherical"\n[optimize]\nmax_iterations = %s\n' \
            "$file" "$iterations" > "$case.toml"
        "$qcball" run "$case.toml" --out "$case" --threads 1 --quiet || [ $? = 1 ]
    fi
    # Paths are those of a machine.
    sed "s|$data/||g; s|$runs/||g" "$case/summary.txt" > "results/brain/$surface.txt"
done
