#!/usr/bin/env bash
# Every reader under libFuzzer for a while: TELETACT_FUZZ_SECONDS of each, 20 unless told. An input
# that is wrong is kept in the working folder as crash-*, timeout-* or oom-*.
set -uo pipefail
program=$1
seconds=${TELETACT_FUZZ_SECONDS:-20}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# A reader that must be caught, before those that must not: a program that can not fail shows
# nothing.
"$program" --reader=wrong --seeds="$work/wrong"
if "$program" --reader=wrong "$work/wrong" -max_total_time=60 -artifact_prefix="$work/" >"$work/said" 2>&1 ||
  ! grep -q 'message that is no line' "$work/said"; then
  tail -n 40 "$work/said"
  echo "the reader that is wrong was not caught" >&2
  exit 1
fi
failed=()
count=0
for reader in $("$program" --list); do
  count=$((count + 1))
  "$program" --reader="$reader" --seeds="$work/$reader"
  echo "== $reader, $seconds s"
  "$program" --reader="$reader" "$work/$reader" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=4096 \
    -max_len=65536 -print_final_stats=1 -close_fd_mask=1 >"$work/said" 2>&1
  code=$?
  grep -E 'stat::number_of_executed_units|cov:' "$work/said" | tail -n 2
  if [ $code -ne 0 ]; then
    tail -n 40 "$work/said"
    failed+=("$reader")
  fi
done
if [ $count -eq 0 ]; then
  echo "no reader was found" >&2
  exit 1
fi
if [ ${#failed[@]} -gt 0 ]; then
  echo "FAILED: ${failed[*]}" >&2
  exit 1
fi
echo "$count readers, none failed"
