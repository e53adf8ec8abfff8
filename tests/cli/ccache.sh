#!/usr/bin/env bash
# ccache.sh SOURCE: a small project, built as ours is (tools/cmake/compile.cmake): files compiled
# together, a precompiled header, ccache with a cache of its own. In another folder everything comes
# from the cache; a changed header (precompiled or not), source, macro or flag never does, or the
# program would still say the old number.
set -euo pipefail
command -v ccache >/dev/null || { echo "skipped: no ccache here"; exit 77; }
unset CCACHE_DISABLE
here=$(mktemp -d)
trap 'rm -rf "$here"' EXIT
export CCACHE_DIR="$here/cache"
tree=$here/one
mkdir -p "$tree/tools/cmake" "$tree/part"
cp "$1/tools/cmake/compile.cmake" "$tree/tools/cmake/"
cat >"$tree/CMakeLists.txt" <<'TEXT'
cmake_minimum_required(VERSION 3.25)
project(small LANGUAGES CXX)
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
find_package(Threads REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
include(tools/cmake/compile.cmake)
add_library(part STATIC part/a.cpp part/b.cpp part/c.cpp)
target_link_libraries(part PUBLIC teletact_options)
teletact_compile(part READS part/shared.hpp)
add_executable(small part/main.cpp)
target_link_libraries(small PRIVATE part)
teletact_compile(small COLD READS part/shared.hpp)
TEXT
cd "$tree/part"
echo '#pragma once
#include <string>
#include "part/inner.hpp"' >shared.hpp
echo '#pragma once
inline constexpr int kInner = 1;' >inner.hpp
echo '#pragma once
inline constexpr int kOuter = 1;' >outer.hpp
echo '#include "part/shared.hpp"
int a() { return kInner; }' >a.cpp
echo '#include "part/outer.hpp"
int b() { return kOuter; }' >b.cpp
echo '#ifndef GIVEN
#define GIVEN 1
#endif
int c() { return GIVEN; }' >c.cpp
echo '#include <cstdio>
#include "part/shared.hpp"
int a();
int b();
int c();
int main() {
#ifdef __CHAR_UNSIGNED__
  const int kind = 2;
#else
  const int kind = 1;
#endif
  std::printf("%d %d %d %d %d\n", a(), b(), c(), kind, kInner);
}' >main.cpp

fail() { cat "$here/log"; ccache -s -v; echo "FAILED: $*"; exit 1; }
says() {  # expected, tree, compiler's flags: every object anew
  local expected=$1 tree=$2
  { cmake -G Ninja -S "$tree" -B "$tree/build" -DCMAKE_BUILD_TYPE=Release -DTELETACT_UNITY=ON \
    -DTELETACT_PRECOMPILE=ON -DTELETACT_WERROR=ON -DCMAKE_CXX_FLAGS="${3:-}" &&
    cmake --build "$tree/build" --clean-first; } >"$here/log" 2>&1 || fail "does not build"
  local said
  said=$("$tree/build/small")
  [ "$said" = "$expected" ] || fail "it says $said, not $expected"
}
counted() { ccache --print-stats | awk -v name="$1" '$1 == name {print $2}'; }
says "1 1 1 1 1" "$tree"
[ "$(counted cache_miss)" -ge 4 ] || fail "not compiled through the cache"
rm -rf "$tree/build"  # it names its folder
cp -r "$tree" "$here/two"
ccache -z >/dev/null
says "1 1 1 1 1" "$here/two"
misses=$(counted cache_miss)
[ "$misses" -eq 0 ] || fail "$misses compilations in another folder"
tree=$here/two
sed -i 's/kInner = 1/kInner = 2/' "$tree/part/inner.hpp"
says "2 1 1 1 2" "$tree"
sed -i 's/kOuter = 1/kOuter = 2/' "$tree/part/outer.hpp"
says "2 2 1 1 2" "$tree"
says "2 2 3 1 2" "$tree" -DGIVEN=3
says "2 2 1 2 2" "$tree" -funsigned-char
sed -i 's/return GIVEN/return 7 * GIVEN/' "$tree/part/c.cpp"
says "2 2 7 1 2" "$tree"
says "1 1 1 1 1" "$here/one"
echo "ccache: another folder compiles nothing; what changed is compiled"
