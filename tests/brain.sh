#!/usr/bin/env bash
# A brain, results/brain: the inflated, pial and white surface of the left hemisphere of fsaverage5 (10,242 vertices each) on the sphere,
# and filled by TetGen, its triangles kept, and mapped onto the ball from there, the boundary's values fixed and then sliding. Needs TetGen.
#
#   tests/brain.sh DATA RUNS [QCBALL [ITERATIONS]]      by default target/release/qcball, and at most 400 iterations
#
# DATA is a folder with infl_left.gii.gz, pial_left.gii.gz and white_left.gii.gz: nilearn/datasets/data/fsaverage5 in the Python package
# nilearn (`pip download --no-deps nilearn`, then unzip). The data is FreeSurfer's and is not kept here. A run that is in RUNS already is
# not made again.
set -euo pipefail
data=$(cd "$1" && pwd)
mkdir -p "$2" && runs=$(cd "$2" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${3:-target/release/qcball}") iterations=${4:-400}
mkdir -p results/brain
for surface in infl pial white; do
    file=$data/${surface}_left.gii.gz
    "$qcball" sphere "$file" "$runs/$surface.off" --json > "$runs/$surface-sphere.json"
    for values in fixed sliding; do
        case=$runs/$surface-$values
        if [ ! -e "$case/report.json" ]; then
            printf '[domain]\nfile = "%s"\n[mesh]\nkind = "tetgen"\nkeep_boundary = true\nquality = 1.2\nprogram_time_limit = 900\n[map]\nkind = "spherical"\n[boundary]\nvalues = "%s"\n[optimize]\nmax_iterations = %s\n' \
                "$file" "$values" "$iterations" > "$case.toml"
            "$qcball" run "$case.toml" --out "$case" --threads 1 --quiet || [ $? = 1 ]
        fi
    done
done
{
    cat <<'TEXT'
# A brain

Made by `tests/brain.sh`. The boundary's map of each surface: largest, mean and 99 % of s1/s2 over the triangles, and the deviation of the
logarithm of areas; beside it those of the sphere that FreeSurfer keeps for the same vertices, as measured before, which is made
to keep areas (0.50).

| surface | max s1/s2 | mean | 99 % | log area | FreeSurfer's: max | mean | 99 % |
|---|--:|--:|--:|--:|--:|--:|--:|
TEXT
    for surface in infl pial white; do
        case $surface in infl) theirs='4.05 | 1.69 | 3.00' ;; pial) theirs='48.3 | 1.94 | 5.14' ;; *) theirs='9.32 | 1.78 | 3.73' ;; esac
        jq -r --arg name "$surface" --arg theirs "$theirs" '
            def digits: . * 1000 | round / 1000 | tostring;
            "| \($name) | \(.max_stretch | digits) | \(.mean_stretch | digits) | \(.p99_stretch | digits) | \(.log_area_deviation | digits) | \($theirs) |"' \
            "$runs/$surface-sphere.json"
    done
    cat <<TEXT

The solids, meshed by TetGen with the triangles kept, at most $iterations iterations, one thread: *start*: flipped tets of the start, *splits*: edges halved
for them; *K deviation* and *volume*: standard deviations of K and of the ratio of volumes, and of its logarithm, over the tets; *best bound*: of maps of this mesh
with the positions on the sphere that the boundary has at the end; *CPU*: all of a run.

| surface | boundary | tets | start | splits | trace bound | best bound | max K | mean K | K deviation | volume | log volume | K onto the ball | bijective | stop | CPU, s |
|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|---|
TEXT
    for surface in infl pial white; do
        for values in fixed sliding; do jq -r --arg name "$surface" --arg values "$values" '
            def digits($n): if . == null then "-" else . * pow(10; $n) | round / pow(10; $n) | tostring end;
            def bound($name): [.bounds[] | select(.name == $name) | .value] | max | digits(2);
            [ $name, $values, .domain.tets, .untangling.flipped_before // 0, .untangling.refinement_splits // 0, bound("trace"),
              (.best_bound | digits(2)), (.final.max_k | digits(2)), (.final.mean_k | digits(2)), (.distortion.k_deviation? | digits(2)),
              (.distortion.volume_ratio_deviation? | digits(2)), (.distortion.log_volume_ratio_deviation? | digits(2)),
              (.final.ball_k.certified? | digits(2)), (if .bijective then "yes" else "no" end), .stop, (.cpu_seconds | round) ]
            | "| " + (map(tostring) | join(" | ")) + " |"' "$runs/$surface-$values/report.json"
        done
    done
} > "$runs/table.md"
cp "$runs/table.md" results/brain/table.md
"$qcball" picture "$runs/pial-sliding/domain.vtu" "$runs/pial-sliding/image.vtu" results/pictures/brain.png
echo results/brain/table.md
