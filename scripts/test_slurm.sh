#!/bin/bash
# SPDX-License-Identifier: MIT
# test_slurm.sh BUILD: the jobs of docs/guide/cluster.md on a Slurm of one node, which this starts in a folder of its own and ends. Needs
# root and the Debian packages slurm-wlm, munge and openmpi-bin, and a BUILD with -Dmpi=enabled. Ends with 77 where they are not there.
set -eu

build=$(realpath "$1")
pellucid=$build/src/cli/pellucid
pellucid_mpi=$build/src/cli/pellucid-mpi
for program in munged slurmctld slurmd sbatch mpirun; do
    PATH=$PATH:/usr/sbin command -v $program >/dev/null || { echo "skipped: $program is not installed"; exit 77; }
done
[ "$(id -u)" = 0 ] || { echo "skipped: the daemons of Slurm need root"; exit 77; }
PATH=$PATH:/usr/sbin
work=$(mktemp -d)
chmod 755 "$work"
cpus=$(nproc)
passed=0 failed=0 daemons=()

finish()
{
    scancel --user=root 2>/dev/null || true
    sleep 1
    [ ${#daemons[@]} = 0 ] || kill "${daemons[@]}" 2>/dev/null || true
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap finish EXIT

# --- A Slurm of one node ---

start_slurm()
{
    local name
    name=$(hostname -s)
    mkdir -p "$work/munge" "$work/spool" "$work/state"
    dd if=/dev/urandom of="$work/munge/key" bs=1024 count=1 2>/dev/null
    chmod 400 "$work/munge/key"
    chmod 700 "$work/munge"
    munged --foreground --force --key-file="$work/munge/key" --socket="$work/munge.socket" --pid-file="$work/munge/pid" \
        --log-file="$work/munge/log" --seed-file="$work/munge/seed" 2>"$work/munge/errors" &
    daemons+=($!)
    cat >"$work/slurm.conf" <<EOF
ClusterName=test
SlurmctldHost=$name(127.0.0.1)
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.log
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=2
KillWait=20
ReturnToService=2
NodeName=$name NodeAddr=127.0.0.1 CPUs=$cpus State=UNKNOWN
PartitionName=main Nodes=$name Default=YES MaxTime=INFINITE OverSubscribe=YES State=UP
EOF
    export SLURM_CONF=$work/slurm.conf
    slurmctld -D -f "$SLURM_CONF" 2>/dev/null &
    daemons+=($!)
    slurmd -D -f "$SLURM_CONF" 2>/dev/null &
    daemons+=($!)
    for _ in $(seq 60); do
        sinfo -h -o %T 2>/dev/null | grep -q '^idle' && return
        sleep 0.5
    done
    cat "$work"/*.log >&2
    echo "Slurm did not start" >&2
    exit 1
}

wait_for() # JOB
{
    while squeue -h -j "$1" 2>/dev/null | grep -q .; do sleep 0.5; done
}

check() # TITLE COMMAND...
{
    local title=$1
    shift
    if "$@" >"$work/check.log" 2>&1; then
        passed=$((passed + 1))
        echo "ok: $title"
    else
        failed=$((failed + 1))
        echo "FAILED: $title"
        cat "$work/check.log" "$work"/*.out 2>/dev/null | tail -40
    fi
}

start_slurm
cd "$work"
python3 - <<'EOF'
import math
rows, columns, r = 24, 32, 30.0
a = [math.pi * (i / rows - .5) for i in range(rows)]
b = [2 * math.pi * j / columns for j in range(columns)]
v = [(r * math.cos(x) * math.sin(y), r * math.sin(x), r * math.cos(x) * math.cos(y)) for x in a[1:] for y in b]
v = [(0, -r, 0)] + v + [(0, r, 0)]
at = lambda i, j: 2 + (i - 1) * columns + j % columns
f = [(1, at(1, j + 1), at(1, j)) for j in range(columns)] + [(at(rows - 1, j), at(rows - 1, j + 1), len(v)) for j in range(columns)]
for i in range(1, rows - 1):
    for j in range(columns):
        f += [(at(i, j), at(i, j + 1), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i + 1, j))]
open('ball.obj', 'w').write(''.join('v %g %g %g\n' % p for p in v) + ''.join('f %d %d %d\n' % t for t in f))
EOF
scene="ball.obj --unit 1mm --material marble -m path-trace --width 64 --height 48 --msaa 2 --set events=64"
"$pellucid" render $scene --samples 56 -q -o whole.pfm
"$pellucid" render $scene --samples 4000 -q -o long.pfm &
long=$!

# --- An array of seven parts, merged ---

cat >array.sh <<EOF
#!/bin/bash
#SBATCH --array=0-6 --cpus-per-task=1 --output=array-%a.out
$pellucid render $scene --samples 56 --threads 1 --sample-range \$SLURM_ARRAY_TASK_ID/\$SLURM_ARRAY_TASK_COUNT \\
    --checkpoint part-\$SLURM_ARRAY_TASK_ID.ckpt
EOF
job=$(sbatch --parsable array.sh)
merge=$(sbatch --parsable --dependency="afterok:$job" --output=merge.out --wrap "$pellucid merge part-*.ckpt -o array.pfm")
wait_for "$merge"
check "an array of seven parts, merged by a job that waits for it: the bits of one run" cmp whole.pfm array.pfm

# --- An MPI job ---

cat >mpi.sh <<EOF
#!/bin/bash
#SBATCH --ntasks=2 --cpus-per-task=1 --overcommit --output=mpi.out
mpirun --allow-run-as-root --oversubscribe -n 2 $pellucid_mpi render $scene --samples 56 --threads 1 -o mpi.pfm
EOF
wait_for "$(sbatch --parsable mpi.sh)"
check "an MPI job of two ranks: the bits of one run" cmp whole.pfm mpi.pfm

# --- A time limit: SIGTERM, exit code 75, the job puts itself back into the queue ---

wait $long
cat >resume.sh <<EOF
#!/bin/bash
#SBATCH --cpus-per-task=1 --requeue --open-mode=append --output=resume.out
echo "run \${SLURM_RESTART_COUNT:-0}"
$pellucid render $scene --samples 4000 --threads 1 --checkpoint long.ckpt -o resumed.pfm &
trap 'kill -TERM \$!' TERM
wait \$!
code=\$?
while kill -0 \$! 2>/dev/null; do wait \$!; code=\$?; done
echo "code \$code"
[ \$code != 75 ] || scontrol requeue \$SLURM_JOB_ID
EOF
job=$(sbatch --parsable resume.sh)
while [ "$(squeue -h -j "$job" -o %T)" != RUNNING ]; do sleep 0.2; done
sleep 3
scancel --batch --signal=TERM "$job"
wait_for "$job"
check "SIGTERM ends a run with 75" grep -q "code 75" resume.out
check "the job was put back and ended" grep -q "code 0" resume.out
check "a run that was resumed has the bits of one that was not" cmp long.pfm resumed.pfm

# --- The job's own time limit ---

cat >limit.sh <<EOF
#!/bin/bash
#SBATCH --cpus-per-task=1 --time=0:01 --output=limit.out
$pellucid render $scene --samples 100000000 --threads 1 --time-limit 3s --checkpoint limit.ckpt -o limit.pfm
echo "code \$?"
EOF
wait_for "$(sbatch --parsable limit.sh)"
check "--time-limit below the job's: 75, a picture and a checkpoint" grep -q "code 75" limit.out
check "both are there" test -s limit.pfm -a -s limit.ckpt

echo "$passed passed, $failed failed"
[ "$failed" = 0 ]
