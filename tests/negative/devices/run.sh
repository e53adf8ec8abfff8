#!/usr/bin/env bash
# run.sh TELETACT TWIN_LIBRARY
set -uo pipefail
teletact=${1:?} twin=${2:?}
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
cd "$temporary"
unset FORCEDIM_SDK
bad=0

# refused PATTERN ARGUMENTS...: nothing on stdout, one line with PATTERN on stderr, exit code 2.
refused() {
  local pattern=$1 out err code
  shift
  out=$("$teletact" "$@" 2>err.txt)
  code=$?
  err=$(cat err.txt)
  if [ $code -ne 2 ] || [ -n "$out" ] || [ "$(wc -l <err.txt)" -ne 1 ] || ! grep -qE -- "$pattern" err.txt; then
    echo "FAILED: teletact $*: exit $code, wanted 2 and one line with: $pattern"
    echo "stdout: $out"
    echo "stderr: $err"
    bad=1
  fi
}
opens() {
  if ! "$teletact" "$@" >out.txt 2>&1; then
    echo "FAILED: teletact $*:"
    cat out.txt
    bad=1
  fi
}

for command in device demo; do
  refused "$command: omega: SDK not found: tried /nonexistent/sdk, " \
    $command --set 'device.kind="omega"' --set 'device.omega.sdk="/nonexistent/sdk"'
  refused "$command: falcon: (not plugged in|USB can not be read)" $command --set 'device.kind="falcon"'
  refused "$command: mouse: /dev/input/none: No such file" \
    $command --set 'device.kind="mouse"' --set 'device.mouse.path="/dev/input/none"'
  refused "$command: .*device.kind.*phantom.*twin.*omega.*falcon.*mouse" $command --set 'device.kind="phantom"'
done
refused "demo: device.kind = \"omega\": a device lives in real time" \
  demo --clock virtual --set 'device.kind="omega"'

# The real drivers, on their twins.
opens device --seconds 0.2
opens device --kind omega --seconds 0.2 --set "device.omega.sdk=\"$twin\""
FORCEDIM_SDK=$twin opens device --kind omega --seconds 0.2
opens device --kind falcon --seconds 0.2 --set device.falcon.twin=true
opens device --kind mouse --seconds 0.2 --set 'device.mouse.path=""'

# So is ring-down, all the way through them; each takes its time in real time, so beside each other,
# and what it finds depends on what else runs: any residual will do.
# A stall of this machine beyond the device's watchdog brakes it in mid-swing, which identify says:
# then once more. With real-time priority, where that is allowed, other work stalls it no more.
calm=()
chrt -f 20 true 2>/dev/null && calm=(chrt -f 20)
rings() {
  local n
  for n in {1..10}; do
    "${calm[@]}" "$teletact" "$@" >out.txt 2>&1 && return
    grep -q 'braked during a swing' out.txt || break
  done
  echo "FAILED: teletact $*:"
  cat out.txt
  return 1
}
mkdir omega falcon
(cd omega && rings identify --kind omega --seconds 0.5 --residual 10000 --out keys.toml --set "device.omega.sdk=\"$twin\"") &
omega=$!
(cd falcon && rings identify --kind falcon --seconds 0.5 --residual 10000 --out keys.toml --set device.falcon.twin=true) &
falcon=$!
wait $omega || bad=1
wait $falcon || bad=1
for kind in omega falcon; do
  if ! grep -q "^\[device.$kind\]$" $kind/keys.toml; then
    echo "FAILED: identify --kind $kind wrote no keys"
    bad=1
  fi
done
exit $bad
