#!/usr/bin/env bash
# run, optimize, bench, sweep and the meshers ended by SIGTERM, SIGINT and SIGKILL at random moments: what is there afterwards is
# whole or says that it is not, what was there before is not lost, and no process is left. (tests/sweep-kills.sh has more on
# sweeps.) Without TetGen or Gmsh their runs are left out.
#
#   tests/kills.sh [QCBALL [KILLS [SEED]]]      by default target/release/qcball, 200, 1
set -euo pipefail
cd "$(dirname "$0")/.."
qcball=$(realpath "${1:-target/release/qcball}")
kills=${2:-200}
RANDOM=${3:-1}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
mkdir "$dir/bench" "$dir/tmp"
# All processes of a command, whatever became of their parents, have this in their environment, and their temporary files there.
mark="QCBALL_KILLS=$dir"
left() { grep -lzs "^$mark\$" /proc/[0-9]*/environ 2>/dev/null | cut -d/ -f3 || true; }
# A number that has become another process's is left alone.
end() { grep -qzs "^$mark\$" "/proc/$2/environ" && kill -"$1" "$2" 2>/dev/null; }
failed=0
fail() { echo "FAILED: $*"; sed 's/^/    /' "$dir/log"; failed=1; }

printf '[domain]\nsolid = "cube"\n[mesh]\nsubdivisions = 2\nlayers = 4\n' > "$dir/run.toml"
cat "$dir/run.toml" - > "$dir/sweep.toml" <<< $'[sweep.grid]\n"map.exponent" = { from = 0.5, to = 2, step = 0.0625 }'
printf '[optimize]\nengine = "newton"\n' > "$dir/bench.toml"
"$qcball" run "$dir/run.toml" --quiet --threads 1 --out "$dir/whole"
for name in a b; do
    cp "$dir/whole/domain.vtu" "$dir/bench/$name-rest.vtu"
    cp "$dir/whole/image.vtu" "$dir/bench/$name-init.vtu"
done
"$qcball" map power exponent=1.5 "$dir/whole/image.vtu" "$dir/start.vtu" > /dev/null

# Name, the longest wait before the kill in ms, and the command.
commands=(
    "run 1200 run $dir/run.toml --threads 1 --out $dir/out"
    "optimize 800 optimize $dir/whole/domain.vtu $dir/start.vtu $dir/out.vtu --threads 1"
    "bench 1500 bench $dir/bench.toml $dir/bench --out $dir/out.md --threads 1"
    "sweep 1500 sweep $dir/sweep.toml --out $dir/sweep"
)
for mesher in tetgen gmsh; do
    if command -v $mesher > /dev/null; then
        printf '[domain]\nsolid = "cube"\n[mesh]\nkind = "%s"\nmax_volume = 0.001\n' $mesher > "$dir/$mesher.toml"
        commands+=("$mesher 1500 run $dir/$mesher.toml --threads 1 --out $dir/out")
    fi
done
signals=(TERM INT KILL)

# Whether a results folder is whole, or says that it is not.
whole_or_told() {
    if [ -e "$1/incomplete.txt" ]; then
        [ "$signal" = KILL ] || fail "$name: SIG$signal leaves results that are not whole"
    elif ! "$qcball" verify "$1" > "$dir/log" 2>&1; then
        fail "$name: SIG$signal: the results are not what they claim"
    fi
}

declare -A count
for ((kill = 0; kill < kills; kill++)); do
    read -r name longest command <<< "${commands[kill % ${#commands[@]}]}"
    signal=${signals[kill / ${#commands[@]} % ${#signals[@]}]}
    rm -rf "$dir/out" "$dir/out.vtu" "$dir/out.md"
    # Every other time there are results already.
    if ((RANDOM % 2)); then cp -r "$dir/whole" "$dir/out"; cp "$dir/whole/image.vtu" "$dir/out.vtu"; fi
    wait=$((RANDOM % longest + 1))
    # A background job of a script ignores SIGINT unless told otherwise.
    # shellcheck disable=SC2086
    env --default-signal=INT "$mark" TMPDIR="$dir/tmp" "$qcball" $command > /dev/null 2> "$dir/log" &
    pid=$!
    sleep "$(printf '%d.%03d' $((wait / 1000)) $((wait % 1000)))"
    if end "$signal" $pid; then how=$signal; else how=ended; fi
    for ((waited = 0; waited < 200; waited++)); do [ -n "$(jobs -r)" ] || break; sleep 0.1; done
    if [ -n "$(jobs -r)" ]; then fail "$name: alive 20 s after SIG$signal"; end KILL $pid || true; fi
    code=0
    { wait $pid || code=$?; } 2>/dev/null
    case $how-$code in
        # 143: before anything was begun; 1: a bench that could not end a mesh.
        TERM-130 | TERM-143 | INT-130 | KILL-137 | *-0 | *-1) ;;
        *) fail "$name: exit code $code after SIG$signal" ;;
    esac
    # What guards a child looks for its end every so often.
    for _ in 1 2 3 4 5 6 7 8 9 10; do
        orphans=$(left)
        [ -n "$orphans" ] || break
        sleep 0.1
    done
    for orphan in $orphans; do
        fail "$name: SIG$signal leaves $orphan: $(tr '\0' ' ' < "/proc/$orphan/cmdline" 2>/dev/null)"
        end KILL "$orphan" || true
    done
    if [ "$signal" != KILL ] && [ -n "$(ls -A "$dir/tmp")" ]; then fail "$name: SIG$signal leaves $(ls -A "$dir/tmp")"; fi
    rm -rf "${dir:?}/tmp"
    mkdir "$dir/tmp"
    if [ -e "$dir/out" ]; then whole_or_told "$dir/out"; fi
    if [ -e "$dir/out.vtu" ] && ! "$qcball" measure "$dir/whole/domain.vtu" "$dir/out.vtu" > "$dir/log" 2>&1; then
        fail "$name: SIG$signal: the image is not whole"
    fi
    if [ -e "$dir/out.md" ] && ! grep -q '^| a |' "$dir/out.md"; then fail "$name: SIG$signal: the table is not whole"; fi
    for folder in "$dir"/sweep/cases/*/; do
        if [ -d "$folder" ] && [ ! -e "$folder/report.json" ]; then fail "$name: SIG$signal leaves $folder without a report"; fi
    done
    count[$name-$how]=$((${count[$name-$how]:-0} + 1))
done

# The sweep that was ended so often goes on, and has the index of one that was not.
"$qcball" sweep "$dir/sweep.toml" --quiet --out "$dir/sweep" > "$dir/log" 2>&1 || fail "the sweep does not go on"
"$qcball" sweep "$dir/sweep.toml" --quiet --out "$dir/once" > "$dir/log" 2>&1 || fail "the sweep fails"
for file in index.csv index.jsonl; do cmp "$dir/sweep/$file" "$dir/once/$file" || fail "the sweep's $file differs"; done

for key in $(printf '%s\n' "${!count[@]}" | sort); do printf '%s %s, ' "$key" "${count[$key]}"; done
echo
[ "$failed" = 0 ] && echo "$kills kills: all that is there is whole or says that it is not, and no process is left"
exit "$failed"
