#!/usr/bin/env bash
# Installs a build to a temporary prefix, moves the prefix (it must not know where it was), builds
# the consumer against it and runs it; a wrong version and an unknown part must be refused.
#
#   tests/install/run.sh [--headers] BUILD_FOLDER [PART...]      parts: rt perception drivers tasks
#                                                                program
#
# --headers: also compiles each installed header alone; some minutes.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
headers=false
if [ "${1-}" = --headers ]; then headers=true; shift; fi
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
  cmake -G Ninja -S "$here" -B "$temporary/$1" -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$prefix" \
    -DCONSUMER_PARTS="$(IFS=';'; echo "${libraries[*]}")" "${@:2}" >"$temporary/$1.log" 2>&1
}
configure consumer || { cat "$temporary/consumer.log" >&2; exit 1; }
cmake --build "$temporary/consumer" -j 2 >"$temporary/build.log" 2>&1 || { cat "$temporary/build.log" >&2; exit 1; }
# Nothing of the source tree may have been used.
source_tree=$(cd "$here/../.." && pwd)
grep -q 'INCLUDES = ' "$temporary/consumer/build.ninja"  # the place to look at
if grep -rqF -e "$source_tree/rt" -e "I$source_tree " "$temporary/consumer/build.ninja" "$prefix/lib/cmake"; then
  echo "install: the installed package points into the source tree" >&2
  exit 1
fi
"$temporary/consumer/consumer"
if [[ " ${libraries[*]} " == *" perception "* ]]; then "$temporary/consumer/consumer_tsdf"; fi
# Private headers stay where they are: the first that PRIVATE names of each top folder.
for part in rt config perception drivers tasks; do
  name=$(sed -n 's/.*PRIVATE \([^ )]*\).*/\1/p' "$source_tree/$part/CMakeLists.txt" | head -1)
  [ -n "$name" ] || { echo "install: $part names no private header" >&2; exit 1; }
  found=$(find "$prefix/include/teletact" -path "*/$part/*/${name##*/}" -o -path "*/$part/${name##*/}" 2>/dev/null)
  [ -z "$found" ] || { echo "install: $found is private" >&2; exit 1; }
done
if $headers; then
  configure headers -DCONSUMER_HEADERS="$prefix/include/teletact" -DCMAKE_BUILD_TYPE=Debug ||
    { cat "$temporary/headers.log" >&2; exit 1; }
  cmake --build "$temporary/headers" -j 2 --target headers >"$temporary/build.log" 2>&1 ||
    { cat "$temporary/build.log" >&2; echo "install: a public header does not compile alone" >&2; exit 1; }
  echo "install: $(find "$temporary/headers/alone" -name '*.cpp' | wc -l) public headers compile alone"
fi
# What was never installed must be refused: another version, a part that does not exist.
refused() {
  local folder=$temporary/$1
  mkdir "$folder"
  cp "$here"/*.cpp "$folder/"
  sed "$2" "$here/CMakeLists.txt" >"$folder/CMakeLists.txt"
  if cmake -G Ninja -S "$folder" -B "$folder/build" -DCMAKE_PREFIX_PATH="$prefix" -DCONSUMER_PARTS=rt >"$folder/log" 2>&1; then
    echo "install: $1 was found" >&2
    exit 1
  fi
  grep -q "$3" "$folder/log" || { cat "$folder/log" >&2; exit 1; }
}
refused version_99 's/find_package(teletact 0.1/find_package(teletact 99.0/' 'compatible with requested'
refused part_nonsense 's/COMPONENTS /COMPONENTS nonsense /' 'nonsense'
if [ -x "$prefix/bin/teletact" ]; then
  "$prefix/bin/teletact" --version
  [ -f "$prefix/share/teletact/config/scenes/default_room.toml" ]
  (cd "$temporary" && "$prefix/bin/teletact" demo --clock virtual --bodies stub --seconds 1 --quiet --report "$temporary/report" >"$temporary/demo.log") ||
    { cat "$temporary/demo.log" >&2; exit 1; }
  # The services: units that systemd takes, with little to attack, and their user. Judged where it
  # is there.
  for box in robot operator; do
    unit=$prefix/lib/systemd/system/teletact-$box.service
    grep -q "^# The $box's box as a service" "$unit" || { echo "install: $unit is another box's" >&2; exit 1; }
    grep -q '^StateDirectoryMode=0700' "$unit" && grep -q '^UMask=0077' "$unit" ||
      { echo "install: what $unit leaves is readable by all" >&2; exit 1; }
    command -v systemd-analyze >/dev/null || continue
    said=$(systemd-analyze verify "$unit" 2>&1) || { echo "$said" >&2; exit 1; }
    [ -z "$said" ] || { echo "install: $unit: $said" >&2; exit 1; }
    # systemd's figure of exposure, 0 to 10, in tenths; it was 8.7.
    systemd-analyze security --offline=true --threshold=45 "$unit" >"$temporary/security.log" 2>&1 ||
      { tail -3 "$temporary/security.log" >&2; echo "install: $unit is exposed more than 4.5" >&2; exit 1; }
  done
  if command -v systemd-sysusers >/dev/null; then
    systemd-sysusers --dry-run "$prefix/lib/sysusers.d/teletact.conf" >/dev/null
  fi
  # The registry's name is that of tools/box/box_runner.cpp.
  grep -qx 'f /dev/shm/teletact 0666 root root -' "$prefix/lib/tmpfiles.d/teletact.conf"
  # The measuring program lies where the installed program looks for it; without it, one line says
  # so.
  "$prefix/bin/teletact" stability --help | grep -q '^teletact stability: ' ||
    { echo "install: the installed program does not start teletact-measure" >&2; exit 1; }
  rm "$prefix/libexec/teletact/teletact-measure"
  code=0
  "$prefix/bin/teletact" stability --help >"$temporary/absent.out" 2>"$temporary/absent.err" || code=$?
  [ "$code" -eq 2 ] && [ ! -s "$temporary/absent.out" ] && [ "$(wc -l <"$temporary/absent.err")" -eq 1 ] &&
    grep -q 'teletact-measure is neither at' "$temporary/absent.err" ||
    { cat "$temporary/absent.out" "$temporary/absent.err" >&2; echo "install: rc $code without teletact-measure" >&2; exit 1; }
fi
echo "install: ${parts[*]}: ok"
