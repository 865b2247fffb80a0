#!/usr/bin/env bash
# How the time grows with the mesh, results/growth/table.md: cube and bumpy at 1k, 10k and 100k tets from a folder of meshes, and at 500k
# tets made with TetGen, each optimised by two threads. Some five minutes on two idle cores. Needs jq and TetGen.
#
#   tests/growth.sh MESHES_DIR [QCBALL]      by default target/release/qcball; MESHES_DIR holds bumpy.obj too
set -euo pipefail
meshes=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${2:-target/release/qcball}")
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
load() { cut -d ' ' -f 1-3 /proc/loadavg; }

# NAME TETS TRACE REPORT WALL PEAK -> a row of the table, and "shape log(tets) log(seconds)" for the fit.
row() {
    local max_k seconds
    max_k=$(jq .final.max_k "$4")
    seconds=$(awk -F , -v most="$max_k" '
        NR == 1 { for (i = 1; i <= NF; i++) column[$i] = i; next }
        $column["max_k"] != "" && $column["max_k"] + 0 <= 1.01 * most { print $column["seconds"]; exit }' "$3")
    jq -r --arg name "$1" --argjson tets "$2" --arg seconds "$seconds" --arg wall "$5" --arg peak "$6" '
        def digits($n): . * pow(10; $n) | round / pow(10; $n) | tostring;
        "| \([$name, ($tets | tostring), (.final.max_k | digits(4)), .stop, (.kkt | [.primal, .dual, .complementarity] | max * 1e8 | digits(1) + "e-8"),
        ($seconds | tonumber | digits(3)), $wall, $peak] | join(" | ")) |"' "$4" >> "$dir/rows"
    echo "${1%-*} $2 $seconds" >> "$dir/points"
}

start=$(load)
for name in {cube,bumpy}-{1k,10k,100k}; do
    /usr/bin/time -f '%e %M' -o "$dir/time" "$qcball" optimize "$meshes/$name-rest.mesh" "$meshes/$name-init.mesh" "$dir/$name.mesh" \
        --threads 2 --quiet --json --trace "$dir/$name.csv" > "$dir/$name.json"
    read -r wall peak < "$dir/time"
    row "$name" "$(jq .tets "$dir/$name.json")" "$dir/$name.csv" "$dir/$name.json" "$wall" $((peak / 1024))
done
cube='solid = "cube"' bumpy="file = \"$meshes/bumpy.obj\""
cube_volume=4.7e-5 bumpy_volume=1.05e-3
for shape in cube bumpy; do
    name=$shape-500k volume=${shape}_volume
    printf 'threads = 2\n[domain]\n%s\n[mesh]\nkind = "tetgen"\nmax_volume = %s\n' "${!shape}" "${!volume}" > "$dir/$name.toml"
    (cd "$dir" && /usr/bin/time -f '%e %M' -o "$dir/time" "$qcball" run "$name.toml" --quiet > /dev/null)
    read -r wall peak < "$dir/time"
    result=$dir/results/$name
    row "$name" "$(jq .domain.tets "$result/report.json")" "$result/trace.csv" "$result/report.json" "$wall" $((peak / 1024))
done

mkdir -p results/growth
{
    cat <<TEXT
# Growth

Made by \`tests/growth.sh\`; qcball revision $(git rev-parse --short HEAD), 2 threads, load averages $start at the start and $(load) at the end. *To 1.01*:
seconds of the optimisation until max K was 1.01 times the final one (untangling not counted). *Wall* and *peak* are those of the whole
process; the last two rows include TetGen's meshing (max_volume $cube_volume and $bumpy_volume), splits, untangling and the report.

| mesh | tets | max K | stop | KKT residual | to 1.01, s | wall, s | peak, MiB |
|---|--:|--:|---|--:|--:|--:|--:|
TEXT
    cat "$dir/rows"
    awk '
        function exponent(shape,    n, x, y, xx, xy, i) {
            for (i = 1; i <= NR; i++) if (shape == "" || shapes[i] == shape) { n++; x += a[i]; y += b[i]; xx += a[i]^2; xy += a[i] * b[i] }
            return (n * xy - x * y) / (n * xx - x^2)
        }
        { shapes[NR] = $1; a[NR] = log($2); b[NR] = log($3) }
        END {
            printf "\nExponent of the time to 1.01 by the number of tets, least squares in logarithms: cube %.2f, bumpy %.2f, ", exponent("cube"), exponent("bumpy")
            printf "both together %.2f.\n", exponent("")
        }' "$dir/points"
} > "$dir/table.md"
cp "$dir/table.md" results/growth/table.md
echo results/growth/table.md
