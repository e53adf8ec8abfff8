#!/usr/bin/env bash
# Installs a build to a temporary prefix, moves the prefix (it must not know where it was), builds the
# consumer against it and runs it. Negative: the consumer must not be found at a wrong version.
#
#   tests/install/run.sh BUILD_FOLDER [PART...]      parts: rt perception drivers tasks program
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$(cd "${1:?usage: run.sh BUILD_FOLDER [PART...]}" && pwd)
shift
parts=("$@")
[ ${#parts[@]} -gt 0 ] || parts=(rt perception drivers tasks program)
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT

for part in "${parts[@]}"; do
  cmake --install "$build" --prefix "$temporary/first" --component "$part" >>"$temporary/install.log" || {
    cat "$temporary/install.log" >&2
    exit 1
  }
done
mv "$temporary/first" "$temporary/prefix"
prefix=$temporary/prefix

libraries=()
for part in "${parts[@]}"; do [ "$part" = program ] || libraries+=("$part"); done
configure() {
  cmake -S "$here" -B "$temporary/$1" -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$prefix" \
    -DCONSUMER_PARTS="$(IFS=';'; echo "${libraries[*]}")" "${@:2}" >"$temporary/$1.log" 2>&1
}
configure consumer || { cat "$temporary/consumer.log" >&2; exit 1; }
cmake --build "$temporary/consumer" -j 2 >"$temporary/build.log" 2>&1 || { cat "$temporary/build.log" >&2; exit 1; }
# Nothing of the source tree may have been used.
source_tree=$(cd "$here/../.." && pwd)
if grep -rqsF -e "$source_tree/rt" -e "I$source_tree " "$temporary"/consumer/CMakeFiles/*/flags.make "$prefix/lib/cmake"; then
  echo "install: the installed package points into the source tree" >&2
  exit 1
fi
for program in "$temporary"/consumer/consumer*; do
  [ -x "$program" ] && [ -f "$program" ] && "$program"
done
# A version that was never installed must be refused.
sed 's/find_package(teletact 0.1/find_package(teletact 99.0/' "$here/CMakeLists.txt" >"$temporary/wrong.txt"
mkdir "$temporary/wrong" && cp "$here"/*.cpp "$temporary/wrong/" && cp "$temporary/wrong.txt" "$temporary/wrong/CMakeLists.txt"
if cmake -S "$temporary/wrong" -B "$temporary/wrong/build" -DCMAKE_PREFIX_PATH="$prefix" \
    -DCONSUMER_PARTS=rt >/dev/null 2>&1; then
  echo "install: version 99.0 was found" >&2
  exit 1
fi
if [ -x "$prefix/bin/teletact" ]; then
  "$prefix/bin/teletact" --version
  [ -f "$prefix/share/teletact/config/scenes/default_room.toml" ]
  (cd "$temporary" && "$prefix/bin/teletact" demo --clock virtual --bodies stub --seconds 1 --quiet --report "$temporary/report" >"$temporary/demo.log") ||
    { cat "$temporary/demo.log" >&2; exit 1; }
fi
echo "install: ${parts[*]}: ok"
