#!/usr/bin/env bash
# simd_scalar.sh PROGRAM: a short demo with --simd scalar gives the same bytes as one that was
# started with libm's vector forms off, and the loader takes the setting (a name that it does not
# know would change nothing).
set -euo pipefail
program=${1:?usage: simd_scalar.sh PROGRAM}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
scalar=glibc.cpu.hwcaps=-AVX,-AVX2,-AVX512F,-FMA,-FMA4
demo() {  # name, options
  "$program" demo --clock virtual --seconds 1 --quiet --report "$folder/$1" "${@:2}" >"$folder/$1.txt"
  awk '$1 == "run.log_hash" {print $2}' "$folder/$1.txt"
}
asked=$(demo asked --simd scalar)
set_before=$(GLIBC_TUNABLES=$scalar demo set_before)
[ -n "$asked" ] || { echo "no run.log_hash" >&2; exit 1; }
[ "$asked" = "$set_before" ] || { echo "log_hash $asked with --simd scalar, $set_before with the setting" >&2; exit 1; }
loader=$(ls /lib64/ld-linux-x86-64.so.2)
usable() { GLIBC_TUNABLES=$1 "$loader" --list-diagnostics | grep -E 'x86.cpu_features.features\[.*\]\.active' | sha256sum; }
if [ "$(usable "$scalar")" = "$(usable "")" ] && grep -qw fma /proc/cpuinfo; then
  echo "the loader does not take $scalar" >&2
  exit 1
fi
echo "log_hash $asked both ways"
