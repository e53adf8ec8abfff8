#!/usr/bin/env bash
# Builds the page: build.sh WORK SITE. Sources are copied to WORK, where the packages of
# the lock file go too, so that nothing is written beside the sources; the page lands in SITE. Types
# are checked: an error in them ends with 1. Packages that can not be fetched are said in one line
# and end with 0: what is in C++ builds without the page.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$1 site=$2
mkdir -p "$work" "$site"
cd "$work"
rm -rf src twin test
cp -r "$here"/{src,twin,test,package.json,package-lock.json,tsconfig.json,build.mjs,index.html} \
  "$here"/{style.css,icon.svg,.npmrc} .
if ! cmp -s package-lock.json node_modules/.of-lock; then
  if ! npm ci --ignore-scripts --no-audit --no-fund --loglevel=error >npm.log 2>&1; then
    tail -n 3 npm.log >&2
    echo "console page: npm could not fetch its packages (no network?): built without the page" >&2
    exit 0
  fi
  cp package-lock.json node_modules/.of-lock
fi
node node_modules/typescript/bin/tsc --noEmit
node build.mjs --site "$site"
touch built
