#!/usr/bin/env bash
# run, optimize, bench and the meshers ended by SIGTERM, SIGINT and SIGKILL at random moments: what is written is whole, and a
# second later no process of theirs is left. (tests/sweep-kills.sh does the same for a sweep, and more.)
#
#   tests/kills.sh [QCBALL [KILLS]]      by default target/release/qcball, 200
set -euo pipefail
cd "$(dirname "$0")/.."
qcball=$(realpath "${1:-target/release/qcball}")
kills=${2:-200}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
mkdir "$dir/bench" "$dir/tmp"
# All their processes, whatever became of their parents, have this in their environment.
export QCBALL_KILLS=$dir TMPDIR=$dir/tmp
left() { grep -lzs "^QCBALL_KILLS=$dir\$" /proc/[0-9]*/environ 2>/dev/null | cut -d/ -f3 | grep -vxe $$ -e "$BASHPID" || true; }

printf '[domain]\nsolid = "cube"\n[mesh]\nlayers = 6\n' > "$dir/run.toml"
printf '[domain]\nsolid = "cube"\n[mesh]\nkind = "%s"\nmax_volume = 0.0001\n' tetgen > "$dir/tetgen.toml"
printf '[domain]\nsolid = "cube"\n[mesh]\nkind = "%s"\nmax_volume = 0.0001\n' gmsh > "$dir/gmsh.toml"
printf '[optimize]\nengine = "newton"\n' > "$dir/bench.toml"
"$qcball" run "$dir/run.toml" --quiet --out "$dir/whole" --set optimize.max_iterations=1 || true
cp "$dir/whole/domain.vtu" "$dir/bench/a-rest.vtu"
cp "$dir/whole/image.vtu" "$dir/bench/a-init.vtu"

commands=(
    "run $dir/run.toml --quiet --out $dir/out"
    "optimize $dir/whole/domain.vtu $dir/whole/image.vtu $dir/out.vtu --quiet"
    "bench $dir/bench.toml $dir/bench --out $dir/out.md"
    "run $dir/tetgen.toml --quiet --out $dir/out"
    "run $dir/gmsh.toml --quiet --out $dir/out"
)
signals=(TERM INT KILL)
failed=0
for ((kill = 0; kill < kills; kill++)); do
    command=${commands[kill % ${#commands[@]}]}
    signal=${signals[kill % ${#signals[@]}]}
    rm -rf "$dir/out" "$dir/out.vtu" "$dir/out.md"
    # A background job of a script ignores SIGINT unless told otherwise.
    # shellcheck disable=SC2086
    env --default-signal=INT "$qcball" $command > /dev/null 2> "$dir/log" &
    sleep "0.$((RANDOM % 900 + 50))"
    kill -"$signal" $! 2>/dev/null || true
    for wait in $(seq 100); do kill -0 $! 2>/dev/null || break; sleep 0.1; done
    if kill -0 $! 2>/dev/null; then echo "FAILED: $command: alive 10 s after SIG$signal"; kill -KILL $!; failed=1; fi
    wait $! 2>/dev/null || true
    sleep 0.2
    orphans=$(left)
    if [ -n "$orphans" ]; then
        sleep 1
        orphans=$(left)
        for pid in $orphans; do
            echo "FAILED: $command: SIG$signal leaves $pid: $(tr '\0' ' ' < "/proc/$pid/cmdline" 2>/dev/null)"
            kill -KILL "$pid" 2>/dev/null || true
            failed=1
        done
    fi
    if [ -e "$dir/out/report.json" ] && ! python3 -m json.tool "$dir/out/report.json" > /dev/null; then
        echo "FAILED: $command: report.json is not whole"; failed=1
    fi
    if [ -e "$dir/out.vtu" ] && ! "$qcball" measure "$dir/whole/domain.vtu" "$dir/out.vtu" > /dev/null; then
        echo "FAILED: $command: the image is not whole"; failed=1
    fi
done
[ "$failed" = 0 ] && echo "$kills kills: all that was written is whole, and no process is left"
exit "$failed"
