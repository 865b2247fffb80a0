#!/usr/bin/env bash
# Two-sided bounds of the quasi-conformal coefficient of polyhedra: results/brackets: table.csv, table.md, plot.svg. Some 40
# minutes of one core in all. Needs jq and Python.
#
#   tests/brackets.sh QCBALL [SOLID]...     makes the rows of these solids anew and keeps the others; all without names
set -euo pipefail
cd "$(dirname "$0")/.."
qcball=$(realpath "${1:-target/release/qcball}")
shift || true
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
csv=results/brackets/table.csv

# Name; config; overrides; those of the two linear maps, if their mesh is another, coarser one.
rows() {
    cat <<ROWS
tetrahedron|brackets|domain.solid=tetrahedron boundary.corners=2.5 mesh.sectors=7 mesh.rings=11 mesh.layers=10
cube|brackets|
octahedron|brackets|domain.solid=octahedron boundary.corners=1.8 mesh.sectors=8 mesh.rings=10 mesh.layers=9|domain.solid=octahedron mesh.rings=8 mesh.layers=8
dodecahedron|brackets|domain.solid=dodecahedron boundary.corners=1.25 mesh.sectors=5 mesh.rings=7 mesh.layers=7
icosahedron|brackets|domain.solid=icosahedron boundary.corners=1.4 mesh.sectors=11 mesh.rings=10 mesh.layers=11 mesh.grading=1.1 mesh.layer_grading=1|domain.solid=icosahedron mesh.sectors=5 mesh.rings=7 mesh.layers=7
box 1 x 1 x 2|brackets|domain.solid=box domain.size=[1,1,2] boundary.corners=1.578 mesh.sectors=5 mesh.rings=10 mesh.layers=10 mesh.grading=1 mesh.layer_grading=1|domain.solid=box domain.size=[1,1,2] mesh.sectors=4 mesh.rings=7 mesh.layers=7 mesh.grading=1 mesh.layer_grading=1
3-sided prism|brackets|domain.solid=prism domain.sides=3 boundary.corners="power" mesh.sectors=4 mesh.rings=7 mesh.layers=7
5-sided prism|brackets|domain.solid=prism domain.sides=5 boundary.corners="power" mesh.sectors=4 mesh.rings=7 mesh.layers=7
6-sided prism|brackets|domain.solid=prism domain.sides=6 boundary.corners="power" mesh.sectors=4 mesh.rings=7 mesh.layers=7 mesh.grading=1 mesh.layer_grading=1
3-sided pyramid|brackets|domain.solid=pyramid domain.sides=3 boundary.corners="power" mesh.sectors=4 mesh.rings=7 mesh.layers=7
4-sided pyramid|brackets|domain.solid=pyramid domain.sides=4 boundary.corners="power" mesh.sectors=4 mesh.rings=7 mesh.layers=7 mesh.grading=1 mesh.layer_grading=1
5-sided pyramid|brackets|domain.solid=pyramid domain.sides=5 boundary.corners="power" mesh.sectors=4 mesh.rings=7 mesh.layers=7 mesh.grading=1 mesh.layer_grading=1
5-sided bipyramid|brackets|domain.solid=bipyramid domain.sides=5 domain.height=0.75 boundary.corners="power" mesh.sectors=4 mesh.rings=7 mesh.layers=7
gem|brackets-gem|
ellipsoid 1 1 2|brackets-ellipsoid|
ROWS
}

# run FOLDER CONFIG KEY=VALUE...
run() {
    local out=$1 config=$2
    shift 2
    "$qcball" run "configs/$config.toml" --quiet --threads 1 --out "$out" "${@/#/--set=}"
}

header=solid,lower,certified,limit,max_k,exponents,radial,fixed,tets,seconds
mkdir -p results/brackets
# The rows that are not made anew are those of the table.
if [[ ! -f $csv ]]; then
    echo "$header" >"$csv"
    awk -F ' *[|] *' '/^[|] / && !/^[|] solid/ { row = $2; for (i = 3; i <= 11; i++) row = row "," $i; print row }' results/brackets/table.md >>"$csv"
fi
while IFS='|' read -r name config keys coarser; do
    wanted=$#
    for asked; do [[ $asked == "$name" ]] && wanted=0; done
    ((wanted == 0)) || continue
    read -ra coarser <<<"${coarser:-$keys}"
    read -ra keys <<<"$keys"
    linear=()
    for key in ${coarser[@]+"${coarser[@]}"}; do [[ $key == boundary.corners=* ]] || linear+=("$key"); done
    linear+=('boundary.corners="linear"' 'boundary.values="fixed"' 'optimize.objective="max"')
    run "$dir/radial" "$config" "${linear[@]}" optimize.symmetric=false optimize.max_iterations=0
    run "$dir/fixed" "$config" "${linear[@]}"
    { TIMEFORMAT=%U; time run "$dir/best" "$config" ${keys[@]+"${keys[@]}"} 2>&3; } 3>&2 2>"$dir/seconds"
    seconds=$(printf %.0f "$(tail -1 "$dir/seconds")")
    "$qcball" verify "$dir/best" >"$dir/verified" || { tail -5 "$dir/verified" >&2; exit 1; }
    tests/differences.py "$qcball" "$dir/best" >&2
    [[ $name == cube || $config != brackets ]] && mkdir -p "results/$config" && cp "$dir/best/summary.txt" "results/$config/summary.txt"
    row=$(jq -rs --arg name "$name" --arg seconds "$seconds" '
        def digits($n): if . == null then "" else . * pow(10; $n) | round / pow(10; $n) | tostring end;
        def up: . * 1e4 | ceil / 1e4 | tostring;
        # What rounding took off a number such as 2 is given back.
        def down: if . == null then "" else . * 1e4 + 1e-6 | floor / 1e4 | tostring end;
        def range: if length == 0 then "" elif (.[0] | digits(3)) == (.[-1] | digits(3)) then (.[0] | digits(3)) else (.[0] | digits(3)) + " to " + (.[-1] | digits(3)) end;
        .[0] as $radial | .[1] as $fixed | .[2] as $best
        | ([$best.bounds[] | select(.name == "wedge") | .value] | max) as $lower
        | [$name, ($lower | down), ($best.final.ball_k.certified | up), (if $lower then pow($lower; 1.5) else null end | digits(4)),
          ($best.final.max_k | digits(4)), ([($best.corners // [])[].exponent] | sort | range), ($radial.final.ball_k.certified | up),
          ($fixed.final.ball_k.certified | up), ($best.domain.tets | tostring), $seconds]
        | join(",")' "$dir/radial/report.json" "$dir/fixed/report.json" "$dir/best/report.json")
    # In the order of the rows above.
    grep -v "^$name," "$csv" >"$dir/others" || true
    echo "$row" >>"$dir/others"
    {
        echo "$header"
        while IFS='|' read -r name _; do
            grep "^$name," "$dir/others" || true
        done < <(rows)
    } >"$dir/table.csv"
    cp "$dir/table.csv" "$csv"
    echo "$row"
done < <(rows)

{
    cat <<TEXT
# Brackets of the quasi-conformal coefficient

Made by \`tests/brackets.sh\`. The coefficient K(D) of a solid D is the least largest K of all quasi-conformal maps of D onto the ball. It is at
least pi over the sharpest dihedral angle alpha of D, and at most K onto the ball of any map; *certified*, rounded up, is that of one whose
boundary slides and which is like r^p at the corners. Whether (pi / alpha)^(3/2), which no piecewise-linear map of a fine mesh goes below, with powers
at the corners or without, is the coefficient is not known. *K*: of the same map onto the polyhedron. *Radial* and *fixed*: K onto the ball of the radial
piecewise-linear map of the same mesh or a coarser one, and of the one optimized with the radial boundary values, symmetric too. Every certified value is
of a folder that \`qcball verify\` accepted; \`tests/differences.py\` looks for larger K at 100,000 random points. Seconds are CPU time of the run that gave it, one thread. The ellipsoid is the polyhedron
inscribed in it that the mesh fills. Rows were made by the programs of different commits; \`tests/brackets.sh QCBALL NAME\` makes one anew.

| solid | pi / alpha | certified | (pi / alpha)^(3/2) | K | p | radial | fixed | tets | s |
|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|
TEXT
    awk -F, 'NR > 1 { line = "|"; for (i = 1; i <= 10; i++) line = line " " $i " |"; print line }' "$csv"
} >"$dir/table.md"
awk -F, '
    function x(k) { return 150 + 430 * log(k) / log(16) }
    NR > 1 { for (i = 1; i <= 10; i++) cell[NR - 1, i] = $i; rows = NR - 1 }
    END {
        height = 22 * rows + 60
        printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"620\" height=\"%d\" font-family=\"sans-serif\" font-size=\"12\">\n", height
        print "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
        for (k = 1; k <= 16; k *= 2) {
            printf "<line x1=\"%.1f\" x2=\"%.1f\" y1=\"10\" y2=\"%d\" stroke=\"#ddd\"/>\n", x(k), x(k), height - 45
            printf "<text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">%d</text>\n", x(k), height - 30, k
        }
        printf "<text x=\"365\" y=\"%d\" text-anchor=\"middle\">coefficient K(D): proved interval; tick: (pi / alpha)^(3/2); ring: radial map</text>\n", height - 10
        for (r = 1; r <= rows; r++) {
            y = 22 * r
            low = cell[r, 2] == "" ? 1 : cell[r, 2]
            printf "<text x=\"140\" y=\"%d\" text-anchor=\"end\">%s</text>\n", y + 4, cell[r, 1]
            printf "<rect x=\"%.1f\" y=\"%d\" width=\"%.1f\" height=\"10\" fill=\"#4878a8\"/>\n", x(low), y - 5, x(cell[r, 3]) - x(low)
            if (cell[r, 4] != "") printf "<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%d\" y2=\"%d\" stroke=\"#c04000\" stroke-width=\"2\"/>\n", x(cell[r, 4]), x(cell[r, 4]), y - 8, y + 8
            if (cell[r, 7] <= 16) printf "<circle cx=\"%.1f\" cy=\"%d\" r=\"4\" fill=\"none\" stroke=\"black\"/>\n", x(cell[r, 7]), y
        }
        print "</svg>"
    }' "$csv" >"$dir/brackets.svg"
cp "$dir/table.md" results/brackets/table.md
cp "$dir/brackets.svg" results/brackets/plot.svg
