#!/usr/bin/env bash
# teletact robot, operator and status with command lines that must be refused.
#   run.sh TELETACT
set -uo pipefail
program=${1:?usage: run.sh TELETACT}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder" || exit 1
failed=0

# refused CODE PATTERN WORDS...: that exit code, one line on stderr that matches, and no report
# folder.
refused() {
  local code=$1 pattern=$2
  shift 2
  timeout 60 "$program" "$@" >out 2>err
  local got=$?
  if [ $got -ne "$code" ] || [ "$(wc -l <err)" -ne 1 ] || ! grep -qE -e "$pattern" err; then
    echo "teletact $*: code $got, wanted $code and /$pattern/; it said:" >&2
    cat err >&2
    failed=1
  fi
  if [ -e robot_report ] || [ -e operator_report ]; then
    echo "teletact $*: something was started" >&2
    failed=1
  fi
}

for box in robot operator; do
  refused 2 '--keys is missing.*--plain' "$box"
  refused 2 '--plain 0.0.0.0.*loopback only' "$box" --plain --listen 0.0.0.0:47110
  refused 2 '--plain 192.168.1.5.*loopback only' "$box" --plain --listen 192.168.1.5:47110
  refused 2 '--listen 127.0.0.1: no port' "$box" --plain --listen 127.0.0.1
  refused 2 'port is out of range.*0..65535' "$box" --plain --listen 127.0.0.1:65536
  refused 2 'port is no number' "$box" --plain --listen 127.0.0.1:7a
  refused 2 '--seconds' "$box" --plain --seconds 0
  refused 2 '--keys excludes --plain|--plain excludes --keys' "$box" --plain --keys keys
  refused 2 '--peer requires --keys' "$box" --plain --peer robot1
  refused 2 'no_such_scene' "$box" --plain --robot no_such_scene
done
refused 2 '--operator-address 127.0.0.1:0: the port is out of range' robot --plain --operator-address 127.0.0.1:0
refused 2 '--robot-address 10.0.0.1|--plain 10.0.0.1' operator --plain --robot-address 10.0.0.1:5
refused 2 '--operator-address excludes --listen' robot --plain --listen 127.0.0.1:0 --operator-address 127.0.0.1:5
refused 2 '--robot-address' robot --plain --robot-address 127.0.0.1:5
XDG_RUNTIME_DIR=$folder refused 1 'no box of this user runs' status
XDG_RUNTIME_DIR=$folder refused 1 'robot.sock: no box runs there' status --box robot
XDG_RUNTIME_DIR=relative refused 2 'XDG_RUNTIME_DIR' status
exit $failed
