# bed.sh - Debian's Slurm as a little cluster of one machine: slurmctld and munged, and two nodes, each a slurmd
# with a host name, processes and mounts of its own.  Sourced; `bed_enter` makes the room, `bed_start` the cluster in it.
# shellcheck shell=bash
# Everything is in namespaces made for it: what is started here ends, and what is mounted here is gone, with its first
# process, however that ends.  No port, socket, folder or service of the machine is used.

bed_enter() { # command...: run it as the first process of the bed, with the empty folder /run/bed
    exec setpriv --pdeathsig KILL unshare --mount --pid --uts --ipc --net --fork --kill-child --mount-proc -- sh -euc '
        mount --make-rshared /
        mount -t tmpfs tmpfs /run; mkdir /run/bed; mount -t tmpfs tmpfs /dev/shm
        hostname head
        ip link set lo up; for n in 1 2 3; do ip addr add 10.9.0.$n/24 dev lo; done
        exec "$@"' - "$@"
}
dir=/run/bed node=()
bed_start() {
    mkdir -p "$dir"/{slurm/{state,log},local}
    chmod 700 "$dir/slurm"
    dd if=/dev/urandom of="$dir/slurm/munge.key" bs=1k count=1 status=none
    chmod 600 "$dir/slurm/munge.key"
    /usr/sbin/munged --force --foreground --key-file="$dir/slurm/munge.key" --socket="$dir/slurm/munge" --pid-file="$dir/slurm/munged.pid" \
        --seed-file="$dir/slurm/munge.seed" --log-file="$dir/slurm/log/munged.log" > "$dir/slurm/log/munged.out" 2>&1 &
    # A node is down 10 s after it was last heard; a job of it may start anew when its credential has expired.
    cat > "$dir/slurm/slurm.conf" <<CONF
ClusterName=bed
SlurmctldHost=head(10.9.0.3)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$dir/slurm/munge,cred_expire=20
CredType=cred/munge
StateSaveLocation=$dir/slurm/state
SlurmdSpoolDir=$dir/slurm/spool-%n
SlurmctldPidFile=$dir/slurm/slurmctld.pid
SlurmdPidFile=$dir/slurm/slurmd-%n.pid
SlurmctldLogFile=$dir/slurm/log/slurmctld.log
SlurmdLogFile=$dir/slurm/log/slurmd-%n.log
SlurmctldPort=6817
SlurmdTimeout=10
SlurmctldTimeout=10
MinJobAge=3600
KillWait=2
UnkillableStepTimeout=300
ReturnToService=2
TmpFS=/run/bed/local
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_interval=1
MpiDefault=none
NodeName=node1 NodeAddr=10.9.0.1 Port=6821 CPUs=1
NodeName=node2 NodeAddr=10.9.0.2 Port=6822 CPUs=1
PartitionName=all Nodes=node1,node2 Default=YES MaxTime=INFINITE State=UP
CONF
    export SLURM_CONF=$dir/slurm/slurm.conf
    wait_for test -S "$dir/slurm/munge" || return
    slurmctld -D > "$dir/slurm/log/slurmctld.out" 2>&1 &
    node_start 1
    node_start 2
    node_up 1 && node_up 2 || { tail "$dir"/slurm/log/*; return 1; }
}
# Mounts of the bed are seen on its nodes.  What is a node's own: /run/bed/local and /dev/shm.
node_start() { # N [size of both, 256m]
    rm -f "$dir/slurm/log/slurmd-node$1.log"
    # shellcheck disable=SC2016 # the node's own
    unshare --mount --propagation slave --pid --uts --ipc --fork --kill-child --mount-proc -- bash -c '
        hostname "node$1"
        for d in /run/bed/local /dev/shm; do mount -t tmpfs -o "size=$2" tmpfs "$d" || exit; done
        slurmd -D -N "node$1" & wait' - "$1" "${2:-256m}" > "$dir/slurm/log/node$1.out" 2>&1 &
    node[$1]=$!
}
node_up() { wait_for grep -qs 'slurmd started' "$dir/slurm/log/slurmd-node$1.log" && wait_for node_is "$1" idle; } # N
# As a power cut: every process of it at once.
node_kill() { kill -9 "${node[$1]}" 2> /dev/null; wait "${node[$1]}" 2> /dev/null; } # N
node_is() { local s; s=$(sinfo -h -n "node$1" -o %t) && [[ ${s%\*} == "$2" ]]; } # N, state
on_node() { # N, command...: as a process of that node
    local n=$1 first; shift
    first=$(pgrep -P "${node[$n]}") || return
    nsenter -t "$first" -m -u -i -p -- "$@"
}
wait_for() { # command...: until it succeeds; the end is for what hangs
    local end=$((SECONDS + 900))
    until "$@"; do [ $SECONDS -lt $end ] || { echo "  waited in vain: $*"; return 1; }; sleep 0.2; done
}
