#!/usr/bin/env bash
# Runs a command as a job array of N tasks on a Slurm of its own on this machine: on-slurm.sh N COMMAND...
set -euo pipefail
SHARDS=$1
shift
PLACE=$(mktemp -d)
HOST=$(hostname -s)
mkdir "$PLACE/state" "$PLACE/spool" "$PLACE/munge"
PIDS=()
finish() {
    for pid in "${PIDS[@]}"; do kill "$pid" 2>/dev/null || true; done
    for pid in "${PIDS[@]}"; do wait "$pid" 2>/dev/null || true; done
    rm -rf "$PLACE"
}
trap finish EXIT

chmod 711 "$PLACE"
chmod 755 "$PLACE/munge"
head -c 1024 /dev/urandom > "$PLACE/munge/key"
chmod 400 "$PLACE/munge/key"
munged --foreground --force --socket="$PLACE/munge/socket" --key-file="$PLACE/munge/key" --log-file="$PLACE/munge/log" \
    --pid-file="$PLACE/munge/pid" --seed-file="$PLACE/munge/seed" > /dev/null 2>&1 &
PIDS+=($!)

cat > "$PLACE/slurm.conf" <<CONF
ClusterName=shards
SlurmctldHost=$HOST(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
AuthType=auth/munge
AuthInfo=socket=$PLACE/munge/socket
CryptoType=crypto/munge
SlurmUser=root
StateSaveLocation=$PLACE/state
SlurmdSpoolDir=$PLACE/spool
SlurmctldPidFile=$PLACE/slurmctld.pid
SlurmdPidFile=$PLACE/slurmd.pid
SlurmctldLogFile=$PLACE/slurmctld.log
SlurmdLogFile=$PLACE/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
MailProg=/bin/true
NodeName=$HOST NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$PLACE/slurm.conf
slurmctld -D > "$PLACE/slurmctld.out" 2>&1 &
PIDS+=($!)
slurmd -D > "$PLACE/slurmd.out" 2>&1 &
PIDS+=($!)
for _ in $(seq 100); do
    [[ $(sinfo --noheader --format=%t 2>/dev/null) == idle ]] && break
    sleep 0.2
done
[[ $(sinfo --noheader --format=%t) == idle ]] || { tail -n 20 "$PLACE"/*.log "$PLACE"/*.out >&2; exit 1; }

cat > "$PLACE/job.sh" <<'JOB'
#!/bin/sh
exec "$@" --shard "$SLURM_ARRAY_TASK_ID/$SHARDS" --jobs 1
JOB
# A task whose run fails ends with code 1; the tables say what came of it.
SHARDS=$SHARDS sbatch --wait --array="1-$SHARDS" --cpus-per-task=1 --output="$PLACE/%a.out" "$PLACE/job.sh" "$@" || true
