#!/usr/bin/env bash
# configs/sweep.toml in one go, then again with ten SIGKILLs at random moments: the same index, bit for bit, and no case that was
# done is computed again.
#
#   tests/sweep-kills.sh [QCBALL]      by default target/release/qcball
set -euo pipefail
cd "$(dirname "$0")/.."
qcball=${1:-target/release/qcball}
dir=$(mktemp -d /tmp/qcball-kills-XXXXXX)
trap 'rm -rf "$dir"' EXIT

start=$(date +%s%N)
"$qcball" sweep configs/sweep.toml --out "$dir/whole" 2>/dev/null
took=$((($(date +%s%N) - start) / 1000000))
echo "in one go: $took ms"

stamps() { find "$dir/killed/cases" -name report.json -not -path '*/.*' -printf '%p %i %T@\n' 2>/dev/null | sort; }
: > "$dir/before"
for kill in 1 2 3 4 5 6 7 8 9 10; do
    # Together less than the whole takes, so that every kill falls into the work.
    wait=$((RANDOM * took / 32768 / 6 + 20))
    "$qcball" sweep configs/sweep.toml --out "$dir/killed" >/dev/null 2>>"$dir/log" &
    sleep "$(printf '%d.%03d' $((wait / 1000)) $((wait % 1000)))"
    if kill -KILL $! 2>/dev/null; then how=killed; else how="had ended"; fi
    wait $! 2>/dev/null || true
    stamps > "$dir/after"
    if [ -n "$(comm -23 "$dir/before" "$dir/after")" ]; then echo "FAILED: a done case was computed again"; exit 1; fi
    mv "$dir/after" "$dir/before"
    echo "$how after $wait ms, $(wc -l < "$dir/before") cases done"
done
"$qcball" sweep configs/sweep.toml --out "$dir/killed" 2>>"$dir/log"
stamps > "$dir/after"
if [ -n "$(comm -23 "$dir/before" "$dir/after")" ]; then echo "FAILED: a done case was computed again"; exit 1; fi
twice=$(grep ': max K ' "$dir/log" | sed 's/^note: //' | awk '{ print $2 }' | sort | uniq -d | wc -l)
echo "ended in the logs of two processes: $twice cases"
test "$twice" = 0
cmp "$dir/whole/index.csv" "$dir/killed/index.csv"
cmp "$dir/whole/index.jsonl" "$dir/killed/index.jsonl"
echo "the index is the same, bit for bit"
