#!/usr/bin/env bash
# rights_aside.sh SOURCE: tools/test with a program that tools/run --rights gave rights to. The tests
# see one without; afterwards it has them again, and after a build that made a new one it has not.
set -euo pipefail
export PATH="$PATH:/usr/sbin:/sbin"
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root/tools" "$root/bin" "$root/build/release/Testing/Temporary"
program="$root/build/release/teletact"
cp "$1/tools/test" "$1/tools/common.sh" "$1/tools/skipped_tests" "$root/tools/"
: >"$root/tools/packages"
touch "$root/build/release/Testing/Temporary/LastTest.log"
printf '#!/bin/sh\nexit 0\n' >"$root/bin/cmake"
# In place of the tests: which rights does the program have now?
printf '#!/bin/sh\necho "rights in tests: <$(getcap %s)>"\n[ ! -e %s ] || cp %s %s\n' \
  "$program" "$root/newer" "$root/newer" "$program" >"$root/bin/ctest"
chmod +x "$root/bin/cmake" "$root/bin/ctest"
export PATH="$root/bin:$PATH"
cp /bin/true "$program"
setcap cap_sys_nice=ep "$program" 2>/dev/null || { echo "skipped: file capabilities can not be set here"; exit 77; }
before=$(stat -c %y "$program")

fail() { cat "$root/said"; echo "FAILED: $*"; exit 1; }
"$root/tools/test" >"$root/said" 2>&1 || fail "tools/test ends with $?"
grep -q 'rights in tests: <>' "$root/said" || fail "the tests saw rights"
[ -n "$(getcap "$program")" ] || fail "the rights did not come back"
[ "$(stat -c %y "$program")" = "$before" ] || fail "a build would link it again"

printf '#!/bin/sh\necho teletact\necho demo\n' >"$root/tools/affected.py"
chmod +x "$root/tools/affected.py"
"$root/tools/test" --changed >"$root/said" 2>&1 || fail "tools/test --changed ends with $?"
grep -q 'rights in tests: <>' "$root/said" || fail "the tests of --changed saw rights"
[ -n "$(getcap "$program")" ] || fail "the rights did not come back after --changed"

cp /bin/false "$root/newer"
"$root/tools/test" >"$root/said" 2>&1 || fail "tools/test ends with $?"
[ -z "$(getcap "$program")" ] && cmp -s "$program" /bin/false || fail "the newer program was lost"
[ ! -e "$program.with_rights" ] || fail "the older program lies about"
