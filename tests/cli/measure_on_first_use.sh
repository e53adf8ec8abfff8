#!/usr/bin/env bash
# measure_on_first_use.sh PROGRAM: in a build folder without teletact-measure, `teletact bench` has it
# built and then starts it; a build that fails is one clear error. The build here is a stand-in.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/bin" "$folder/build"
cp "$1" "$folder/build/teletact"
touch "$folder/build/CMakeCache.txt"
cat >"$folder/bin/cmake" <<'STAND_IN'
#!/bin/sh
echo "built: $*"
[ ! -e "$2/broken" ] || exit 1
printf '#!/bin/sh\necho "measured: $*"\n' >"$2/teletact-measure"
chmod +x "$2/teletact-measure"
STAND_IN
chmod +x "$folder/bin/cmake"
export PATH="$folder/bin:$PATH"
fail() { cat "$folder/out" "$folder/err"; echo "FAILED: $*"; exit 1; }
measure() { "$folder/build/teletact" bench rings >"$folder/out" 2>"$folder/err"; }

touch "$folder/build/broken"
status=0; measure || status=$?
[ "$status" -eq 2 ] && [ ! -s "$folder/out" ] || fail "a failed build ends with $status"
grep -q "teletact-measure could not be built in $folder/build" "$folder/err" || fail "it does not say why"
rm "$folder/build/broken"
measure || fail "it ends with $?"
[ "$(cat "$folder/out")" = "measured: bench rings" ] || fail "stdout is not the measurement's alone"
grep -q "built: --build $folder/build --target teletact_measure_program" "$folder/err" || fail "nothing was built"
measure || fail "the second use ends with $?"
[ ! -s "$folder/err" ] || fail "the second use builds again"
