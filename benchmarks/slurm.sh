#!/usr/bin/env bash
# A real SLURM of two nodes on this machine, in a folder of its own: slurm.sh start|stop|controller DIR (as root).
# Needs Debian's slurmctld, slurmd, slurm-client and munge. /etc/slurm/slurm.conf is its own until it stops: jobs get no
# SLURM_CONF. Where that file is there already nothing is started.
#   controller         kills the controller and starts it again from the state that it has saved
set -euo pipefail
command=$1 dir=$(realpath -m "$2") host=$(hostname -s)
conf=/etc/slurm/slurm.conf

end() { # a daemon by its pid file
  local pid
  pid=$(cat "$1" 2>/dev/null) || return 0
  kill "-${2:-TERM}" "$pid" 2>/dev/null || return 0
  for _ in $(seq 100); do kill -0 "$pid" 2>/dev/null || return 0; sleep 0.1; done
  kill -KILL "$pid" 2>/dev/null || true
}

wait_for() { # until a command succeeds, at most 30 s
  for _ in $(seq 150); do "$@" >/dev/null 2>&1 && return 0; sleep 0.2; done
  echo "slurm.sh: not up after 30 s: $*; see $dir/*.log" >&2
  return 1
}

up() { [ "$(sinfo -h -o '%t' | grep -c -E '^(idle|mix|alloc)$')" -ge 1 ]; }

case $command in
start)
  [ ! -e "$conf" ] || { echo "slurm.sh: $conf is there: a cluster of somebody else" >&2; exit 3; }
  mkdir -p "$dir/state"
  head -c 1024 /dev/urandom >"$dir/munge.key"
  chmod 700 "$dir" && chmod 400 "$dir/munge.key"
  port=$((20000 + RANDOM % 20000))
  cat >"$dir/slurm.conf" <<CONF
ClusterName=jumpvision
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$dir/munge.socket
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool.%n
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/%n.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill
AccountingStorageType=accounting_storage/none
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=5,batch_sched_delay=0
MinJobAge=600
SlurmctldTimeout=30
SlurmdTimeout=60
KillWait=2
ReturnToService=2
NodeName=node1 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=1 RealMemory=6000
NodeName=node2 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=1 RealMemory=6000
PartitionName=main Nodes=node1,node2 Default=YES MaxTime=INFINITE State=UP
CONF
  ln -s "$dir/slurm.conf" "$conf"
  munged --force --key-file="$dir/munge.key" --socket="$dir/munge.socket" --pid-file="$dir/munge.pid" \
    --log-file="$dir/munge.log" --seed-file="$dir/munge.seed"
  slurmctld
  slurmd -N node1
  slurmd -N node2
  wait_for up
  ;;
controller)
  end "$dir/slurmctld.pid" KILL
  sleep "${3:-3}"
  slurmctld
  wait_for up
  ;;
stop)
  scancel --user "$(id -un)" 2>/dev/null || true
  for daemon in node1 node2 slurmctld munge; do end "$dir/$daemon.pid"; done
  [ "$(readlink "$conf")" != "$dir/slurm.conf" ] || rm "$conf"
  ;;
*)
  echo "slurm.sh start|stop|controller DIR" >&2
  exit 2
  ;;
esac
