#!/usr/bin/env bash
# A sweep of 12 cases as a SLURM job array on this one machine, with a task killed in the middle and resumed: its index must be
# the one of a plain `qcball sweep`, bit for bit. Starts munged, slurmctld and slurmd (Debian: slurm-wlm, munge) with a
# config of its own, as root, and stops them again.
#
#   tests/slurm.sh [QCBALL]      by default target/release/qcball
set -euo pipefail
cd "$(dirname "$0")/.."
qcball=$(realpath "${1:-target/release/qcball}")
PATH=$PATH:/usr/sbin:/sbin

for program in munged slurmctld slurmd sbatch scancel squeue; do
    if ! command -v "$program" >/dev/null; then
        echo "skipped: no $program here (Debian: apt-get install slurm-wlm munge)"
        exit 0
    fi
done
if [ "$(id -u)" != 0 ]; then
    echo "skipped: the daemons of SLURM need root"
    exit 0
fi

dir=$(mktemp -d /tmp/qcball-slurm-XXXXXX)
munge_pid=
stop() {
    local daemon pid waited
    for daemon in slurmd slurmctld; do
        if [ -s "$dir/$daemon.pid" ]; then
            pid=$(cat "$dir/$daemon.pid")
            kill "$pid" 2>/dev/null || true
            # It saves its state into the folder as it ends.
            for waited in $(seq 100); do
                kill -0 "$pid" 2>/dev/null || break
                [ "$waited" -lt 100 ] || kill -KILL "$pid" 2>/dev/null || true
                sleep 0.1
            done
        fi
    done
    if [ -n "$munge_pid" ]; then kill "$munge_pid" 2>/dev/null || true; fi
    if [ "${kept:-}" ]; then echo "kept: $dir"; else rm -rf "$dir"; fi
}
trap stop EXIT
fail() { echo "FAILED: $*" >&2; kept=1; exit 1; }
# wait_for SECONDS COMMAND...: until the command succeeds.
wait_for() {
    local end=$((SECONDS + $1))
    shift
    until "$@" >/dev/null 2>&1; do
        [ $SECONDS -lt $end ] || fail "waited too long for: $*"
        sleep 0.1
    done
}

echo "== the daemons"
if ! munge -n >/dev/null 2>&1; then
    mkdir -p /run/munge
    chown munge:munge /run/munge
    runuser -u munge -- "$(command -v munged)" --pid-file=/run/munge/munged.pid
    munge_pid=$(cat /run/munge/munged.pid)
fi
host=$(hostname -s)
port=$((20000 + $$ % 20000))
memory=$(($(awk '/MemTotal/ { print $2 }' /proc/meminfo) / 1024 * 8 / 10))
mkdir "$dir/state" "$dir/spool"
cat > "$dir/slurm.conf" <<CONF
ClusterName=qcball
SlurmctldHost=$host
AuthType=auth/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/slurmd.log
SlurmctldPort=$port
SlurmdPort=$((port + 1))
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
MpiDefault=none
ReturnToService=2
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/filetxt
JobCompLoc=$dir/jobcomp.txt
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$memory State=UNKNOWN
PartitionName=local Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$dir/slurm.conf
slurmctld
slurmd
idle() { sinfo --noheader --format=%t | grep -q '^idle'; }
wait_for 60 idle
sinfo

echo "== the sweep on this machine alone"
cat > "$dir/twelve.toml" <<'CONF'
[domain]
solid = "cube"

[mesh]
subdivisions = 3
layers = 5

[sweep.grid]
"domain.solid" = ["cube", "octahedron", "icosahedron"]
"map.exponent" = { from = 0.5, to = 2, step = 0.5 }
CONF
"$qcball" sweep "$dir/twelve.toml" --out "$dir/alone"

echo "== as an array of four tasks"
array_of() {
    # submit.sh prints the merge's number; the array's is the one before.
    merge=$(sh "$dir/array/slurm/submit.sh")
    array=$((merge - 1))
    echo "array $array, merge $merge"
}
ended() { [ -z "$(squeue --noheader --jobs="$1" 2>/dev/null)" ]; }
list() { "$qcball" sweep "$dir/twelve.toml" --out "$dir/array" --dry-run "$@"; }
one_done() { list --shard 2/4 | grep -q '  done  '; }
"$qcball" sweep "$dir/twelve.toml" --out "$dir/array" --emit slurm --tasks 4
array_of
wait_for 300 one_done
# Not by scancel, which would send SIGTERM first: that is Ctrl-C to qcball, and leaves its best iterate.
job=$(squeue --noheader --jobs="${array}_2" --format=%A)
pids=$(scontrol listpids "$job" | awk '$1 ~ /^[0-9]+$/ { print $1 }')
[ "$pids" ] || fail "no process of task 2"
# shellcheck disable=SC2086
kill -KILL $pids
echo "killed task 2, job $job, processes" $pids
wait_for 300 ended "$merge"
list
list --shard 2/4 | grep -q '  missing  ' || fail "the task was killed too late to leave anything to do"
! cmp -s "$dir/array/index.csv" "$dir/alone/index.csv" || fail "the index cannot be whole yet"
state() { scontrol show job "$1" | grep -o 'JobState=[A-Z]*'; }
[ "$(state "$merge")" = JobState=FAILED ] || fail "the merge must fail while cases are missing, not $(state "$merge")"
stamps() { find "$dir/array/cases" -name report.json -not -path '*-incomplete/*' -printf '%p %i %T@\n' | sort; }
stamps > "$dir/before"

echo "== resumed"
array_of
wait_for 300 ended "$merge"
[ "$(state "$merge")" = JobState=COMPLETED ] || fail "the merge: $(state "$merge"), $(cat "$dir/array/slurm/merge.log")"
stamps > "$dir/after"
if [ -n "$(comm -23 "$dir/before" "$dir/after")" ]; then fail "a done case was computed again"; fi
echo "$(wc -l < "$dir/before") cases were kept, $(comm -13 "$dir/before" "$dir/after" | wc -l) computed"
for file in index.csv index.jsonl; do
    cmp "$dir/alone/$file" "$dir/array/$file" || fail "$file differs"
done
echo "the index of the array is that of one machine, bit for bit"
