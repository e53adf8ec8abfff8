#!/usr/bin/env bash
# run.sh PROGRAM [RUNS [BUSY_RUNS]]: the whole demo as a user without any right (no capability,
# rtprio 0, 8 MiB of locked memory), on two cores and on one: it marks, plans, arrives, and says
# that it is not real-time, why, and what gives the right. BUSY_RUNS: so often again with a compiler
# at work on every core.
set -uo pipefail
program=${1:?usage: run.sh PROGRAM [RUNS [BUSY_RUNS]]}
runs=${2:-1}
busy_runs=${3:-0}
[ "$(id -u)" -eq 0 ] || { echo "skipped: only root can become a user without rights"; exit 77; }
for tool in setpriv prlimit taskset; do
  command -v $tool >/dev/null || { echo "skipped: no $tool here"; exit 77; }
done
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
# Where it was built another user may not look: the program and its configuration lie beside each
# other, as installed.
source_root=$(cd "$(dirname "$0")/../.." && pwd)
mkdir -p "$folder/bin" "$folder/share/teletact"
cp "$program" "$folder/bin/teletact"
cp -r "$source_root/config" "$folder/share/teletact/"
chmod -R a+rX "$folder"
failed=0
complain() { echo "FAILED: $*"; failed=1; }

as_nobody() {  # CPUS COMMAND...
  local cpus=$1
  shift
  prlimit --rtprio=0:0 --memlock=8388608:8388608 taskset -c "$cpus" \
    setpriv --reuid 65534 --regid 65534 --clear-groups --inh-caps=-all --bounding-set=-all "$@"
}
as_nobody 0 "$folder/bin/teletact" --version >/dev/null || { echo "skipped: can not become a user without rights here"; exit 77; }

value() { awk -v name="$1" '$1 == name {print $2}' "$folder/out"; }
check() {  # NAME, expected
  local v
  v=$(value "$1")
  [ "$v" = "$2" ] || complain "$cpus: $1 is '$v', not $2"
}
demo() {  # CPUS
  local cpus=$1 report="$folder/report-$1" code began
  rm -rf "$report"
  mkdir -p "$report"
  chown 65534:65534 "$report"
  began=$SECONDS
  (cd "$report" && as_nobody "$cpus" env HOME="$report" "$folder/bin/teletact" demo --quiet --report "$report") >"$folder/out" 2>&1
  code=$?
  [ $code -eq 0 ] || complain "$cpus: exit code $code: $(grep -a '^teletact' "$folder/out")"
  check mark.count 1
  check plan.paths 1
  check robot.collisions 0
  check run.realtime 0
  check run.measured 0
  check run.problems 0
  awk -v e="$(value robot.goal_error_m)" 'BEGIN {exit !(e != "" && e + 0 <= 0.10)}' || complain "$cpus: robot.goal_error_m $(value robot.goal_error_m)"
  awk -v c="$(value haptic.contacts)" 'BEGIN {exit !(c + 0 >= 3)}' || complain "$cpus: haptic.contacts $(value haptic.contacts)"
  # One line, before the run and after it; the same on the page.
  [ "$(grep -c '^not real-time, timing not measured: .*no real-time priority.*; to change it: sudo setcap cap_sys_nice,cap_ipc_lock=ep ' "$folder/out")" = 2 ] ||
    complain "$cpus: does not say that it is not real-time, why, and the command"
  grep -q 'class="note">.*not real-time, timing not measured: .*sudo setcap ' "$report/report.html" || complain "$cpus: the page does not say it"
  ! grep -q 'class="bad"' "$report/report.html" || complain "$cpus: the verdict is red"
  # Simulated time was not ahead of the real one.
  awk -v w="$(value run.wall_s)" 'BEGIN {exit !(w >= 20)}' || complain "$cpus: 20 s took $(value run.wall_s) s"
  echo "cores $cpus$beside: exit $code, marks $(value mark.count), paths $(value plan.paths), collisions $(value robot.collisions), goal error $(value robot.goal_error_m) m," \
    "contacts $(value haptic.contacts), 20 s took $(value run.wall_s) s, $(value run.lag_s) s behind; all in all $((SECONDS - began)) s"
}
demos() {
  if [ "$(nproc)" -ge 2 ]; then demo 0,1; fi
  demo 0
}
# A compiler on core $1 until the file is taken away, or this script is gone. Its rounds are
# counted.
compile_on() {
  while [ -e "$folder/busy" ] && kill -0 $$ 2>/dev/null; do
    taskset -c "$1" c++ -x c++ -std=c++20 -O2 -fsyntax-only - <<<'#include <bits/stdc++.h>' && echo round >>"$folder/compiled.$1"
  done
}
busy_demos() {
  local core rounds loops=()
  touch "$folder/busy"
  for core in $(seq 0 $(($(nproc) - 1))); do
    compile_on "$core" &
    loops+=($!)
  done
  demos
  rm "$folder/busy"
  wait "${loops[@]}"
  for core in $(seq 0 $(($(nproc) - 1))); do
    rounds=$(grep -c . "$folder/compiled.$core" 2>/dev/null)
    [ "${rounds:-0}" -ge 5 ] || complain "core $core was not kept busy: ${rounds:-0} rounds of the compiler"
  done
}
beside=""
for _ in $(seq "$runs"); do demos; done
beside=", a compiler on every core"
for _ in $(seq "$busy_runs"); do busy_demos; done
as_nobody 0 "$folder/bin/teletact" doctor >"$folder/doctor" 2>&1
tail -1 "$folder/doctor" | grep -q '^a demo here is not real-time, timing not measured: .*setcap' || complain "the doctor does not end with the advice"
as_nobody 0 "$folder/bin/teletact" doctor --rights >/dev/null 2>&1
[ $? -eq 1 ] || complain "doctor --rights does not end with 1"
exit $failed
