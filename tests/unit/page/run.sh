#!/usr/bin/env bash
# run.sh NODE WORK PROGRAM ARGUMENT...: skips, saying why, where the page could not be built.
set -uo pipefail
cd "$2" || exit 1
if [ ! -e built ]; then
  echo "skipped: the page was not built, its packages could not be fetched"
  exit 77
fi
exec "$1" "run/$3.mjs" "${@:4}"
