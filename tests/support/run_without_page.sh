#!/usr/bin/env bash
# run_without_page.sh SOURCE: tools/run on a terminal, with a program and a build that only say what
# they were asked. Without the page it is the script's run, and the last line says why; the exit
# code is the program's.
set -euo pipefail
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root/tools" "$root/bin" "$root/build/release/share/teletact/console"
cp "$1/tools/run" "$1/tools/common.sh" "$root/tools/"
: >"$root/tools/packages"
printf '#!/bin/sh\nexit 0\n' >"$root/bin/cmake"
printf '#!/bin/sh\n[ "$1" = doctor ] && exit 0\necho "asked: $*"\nexit 3\n' >"$root/build/release/teletact"
chmod +x "$root/bin/cmake" "$root/build/release/teletact"
export PATH="$root/bin:$PATH"
on_terminal() { script -qec "$root/tools/run $*" /dev/null </dev/null | tr -d '\r' >"$root/said"; }

status=0
on_terminal || status=$?
cat "$root/said"
[ "$status" -eq 3 ]
grep -qx 'asked: demo' "$root/said"
tail -n 1 "$root/said" | grep -q "without the operator's page: n"

touch "$root/build/release/share/teletact/console/index.html"
on_terminal || true
cat "$root/said"
grep -qx 'asked: demo --console --open' "$root/said"
! grep -q 'without' "$root/said"
