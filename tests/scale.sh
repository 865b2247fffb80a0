#!/usr/bin/env bash
# How time and memory of `qcball run`, from config to report, grow with the mesh, results/growth/shells.md: shells of the cube and of
# star-harmonics with 10,000 to 5,000,000 tets, on two threads. Some half an hour on two idle cores, and 6 GiB. Needs jq.
#
#   tests/scale.sh DIR [QCBALL]      by default target/release/qcball; runs that DIR has already are not made again
set -euo pipefail
mkdir -p "$1"
dir=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
qcball=$(realpath "${2:-target/release/qcball}")
load() { cut -d ' ' -f 1-3 /proc/loadavg; }

start=$(load)
rm -f "$dir/rows" "$dir/points"
for cells in 10000 100000 1000000 2000000 5000000; do
    for solid in cube star-harmonics; do
        name=$solid-$cells
        # So many tets of one layer each would be flat.
        layers=$([ "$cells" -ge 1000000 ] && echo 'layers = 16' || true)
        printf 'threads = 2\n[domain]\nsolid = "%s"\n[mesh]\ncells = %s\n%s\n' "$solid" "$cells" "$layers" > "$dir/$name.toml"
        if [ ! -f "$dir/$name.time" ]; then
            /usr/bin/time -f '%e %U %M' -o "$dir/$name.taken" "$qcball" run "$dir/$name.toml" --out "$dir/$name" --quiet > /dev/null
            rm -f "$dir/$name"/{cells.csv,*.vtu}
            mv "$dir/$name.taken" "$dir/$name.time"
        fi
        read -r wall cpu peak < "$dir/$name.time"
        jq -r --arg solid "$solid" --argjson wall "$wall" --argjson cpu "$cpu" --argjson peak "$peak" '
            def digits($n): . * pow(10; $n) | round / pow(10; $n) | tostring;
            "| \([$solid, (.domain.tets | tostring), (.final.max_k | digits(4)), (.final.mean_k | digits(4)), .stop, (.iterations | tostring),
            ($wall | digits(1)), ($cpu | digits(1)), ((1 - .seconds / $wall) * 100 | digits(1) + " %"), ($peak / 1024 | round | tostring),
            ($peak * 1024 / .domain.tets | round | tostring)] | join(" | ")) |"' "$dir/$name/report.json" >> "$dir/rows"
        echo "$solid $(jq .domain.tets "$dir/$name/report.json") $wall" >> "$dir/points"
    done
done

{
    cat <<TEXT
# Growth of whole runs

Made by \`tests/scale.sh\`; qcball revision $(git rev-parse --short HEAD), 2 threads, load averages $start at the start and $(load) at the end.
\`qcball run\` of shells, from the config to the report: with 16 layers from a million tets on. *Wall*, *CPU* (seconds) and *peak* are those of the whole
process; *writing*: the share of the wall time after the record was complete, which is files and page.

| solid | tets | max K | mean K | stop | iterations | wall, s | CPU, s | writing | peak, MiB | bytes a tet |
|---|--:|--:|--:|---|--:|--:|--:|--:|--:|--:|
TEXT
    cat "$dir/rows"
    awk '
        function exponent(shape,    n, x, y, xx, xy, i) {
            for (i = 1; i <= NR; i++) if (shapes[i] == shape) { n++; x += a[i]; y += b[i]; xx += a[i]^2; xy += a[i] * b[i] }
            return (n * xy - x * y) / (n * xx - x^2)
        }
        { shapes[NR] = $1; a[NR] = log($2); b[NR] = log($3) }
        END { printf "\nExponent of the wall time by the number of tets, least squares in logarithms: cube %.2f, star-harmonics %.2f.\n", exponent("cube"), exponent("star-harmonics") }' "$dir/points"
} > "$dir/shells.md"
mkdir -p results/growth
cp "$dir/shells.md" results/growth/shells.md
echo results/growth/shells.md
