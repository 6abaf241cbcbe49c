#!/bin/sh
# Batches on a Slurm of one node that this script starts and ends: what an array merges is what one process makes of it,
# and one that was cancelled goes on where it was.
#
#   tests/scenarios/slurm.sh PATH_OF_PROACT OUTPUT_FOLDER
set -eu

proact=$1
output=$2
rm -rf "$output"
mkdir -p "$output/state" "$output/spool"
output=$(cd "$output" && pwd)
PATH=$PATH:/usr/sbin
export SLURM_CONF="$output/slurm.conf"
control=
node=
# shellcheck disable=SC2086 # none, one or two
trap '[ -z "$control$node" ] || kill $node $control 2>/dev/null || true' EXIT

# Slurm knows a node by the machine's name. Its own ports and folders: another Slurm on this machine is not disturbed.
cat >"$SLURM_CONF" <<CONF
ClusterName=proact
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
SlurmctldPort=26817
SlurmdPort=26818
AuthType=auth/none
CredType=cred/none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=1
MpiDefault=none
ReturnToService=2
StateSaveLocation=$output/state
SlurmdSpoolDir=$output/spool
SlurmctldPidFile=$output/slurmctld.pid
SlurmdPidFile=$output/slurmd.pid
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
CONF

slurmctld -D >"$output/slurmctld.log" 2>&1 &
control=$!
slurmd -D >"$output/slurmd.log" 2>&1 &
node=$!

# Waits until the words of a command say what they should.
wait_for() {
    what=$1
    shift
    tries=0
    until "$@" 2>/dev/null | grep -q "$what"; do
        tries=$((tries + 1))
        if [ "$tries" -gt 600 ] || ! kill -0 "$control" "$node" 2>/dev/null; then
            "$@" || true
            tail -n 5 "$output"/slurm*.log
            echo "FAILED: waited in vain for \"$what\" of $*"
            exit 1
        fi
        sleep 0.2
    done
}

wait_for idle sinfo --noheader --format=%T

# Short trials, in which nobody gets anywhere: what is tested is what is kept of them.
batch() {
    folder=$1
    people=$2
    shift 2
    "$proact" simulate --methods C,D --participants "$people" --time-limit 2 --seed 5 --out "$folder" --jobs 1 "$@"
}

# Submits a batch; its job is in $job.
submit() {
    batch "$@" --slurm=3 --json >"$1.json"
    job=$(sed -n 's/.*"job": *"\([0-9]*\)".*/\1/p' "$1.json")
    [ -n "$job" ] || { cat "$1.json"; echo "FAILED: it is not said which job it is"; exit 1; }
}

wait_until_finished() {
    wait_for '^0$' sh -c "squeue --noheader --jobs=$job 2>/dev/null | wc -l"
}

same() {
    for file in trials.jsonl trials.csv blocks.csv measures.csv objects.csv phases.csv faults.csv; do
        if ! cmp "$output/local$1/$file" "$output/array$1/$file"; then
            tail -n 3 "$output/array$1"/slurm/*.log
            echo "FAILED: $file is another one"
            exit 1
        fi
    done
}

batch "$output/local6" 3 >/dev/null 2>&1
submit "$output/array6" 3
wait_until_finished
same 6
echo "ok  six trials by an array of three tasks, the same bytes as by one process"

# Cancelled in the middle, and submitted again.
batch "$output/local80" 40 >/dev/null 2>&1
submit "$output/array80" 40
wait_for '^[1-9]' sh -c "cat '$output'/array80/shard-*.log | grep -c digest"
scancel "$job"
wait_until_finished
[ ! -e "$output/array80/trials.jsonl" ] || { echo "FAILED: the batch was over before it was cancelled"; exit 1; }
done_before=$(cat "$output"/array80/shard-*.log | grep -c digest)
submit "$output/array80" 40
wait_until_finished
same 80
echo "ok  80 trials by an array that was cancelled after $done_before and submitted again"
echo "2 passed, 0 failed"
