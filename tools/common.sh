# Shared by tools/run and tools/test: packages and build. Sourced, not run.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# packages_of SECTION...: names from tools/packages
packages_of() {
  awk -v want=" $* " '/^#/ {next} /^\[/ {section = substr($1, 2, length($1) - 2); next}
    NF > 0 && index(want, " " section " ") {print $1}' "$root/tools/packages"
}

# command_of PACKAGE: the command after "or", which may be there from another source
command_of() {
  awk -v package="$1" '$1 == package && $2 == "or" {print $3}' "$root/tools/packages"
}

# install_packages SECTION...: installs what is missing, nothing else
install_packages() {
  local missing=() p command
  for p in $(packages_of "$@"); do
    command=$(command_of "$p")
    [ -n "$command" ] && command -v "$command" >/dev/null && continue
    dpkg-query -W -f='${db:Status-Status}' "$p" 2>/dev/null | grep -qx installed || missing+=("$p")
  done
  [ ${#missing[@]} -eq 0 ] && return 0
  echo "installing: ${missing[*]}"
  local sudo=()
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || { echo "$0: packages are missing and there is no sudo: run as root: apt-get install ${missing[*]}" >&2; exit 2; }
    sudo=(sudo)
  fi
  "${sudo[@]}" apt-get update -qq
  DEBIAN_FRONTEND=noninteractive "${sudo[@]}" apt-get install -y -qq --no-install-recommends -o DPkg::Lock::Timeout=300 "${missing[@]}"
}

# configure PRESET [ARGUMENT...]: with CMake's arguments
configure() {
  local preset=$1
  mkdir -p "$root/build"
  (cd "$root" && cmake --preset "$@" >"$root/build/.configure-$preset.log" 2>&1) || {
    cat "$root/build/.configure-$preset.log" >&2
    return 1
  }
}

# build PRESET [TARGET...]: all of it, or these targets
build() {
  local preset=$1
  shift
  [ $# -gt 0 ] || set -- all
  NINJA_STATUS='[%f/%t, %es] ' cmake --build "$root/build/$preset" -j "$(nproc)" --target "$@"
}

# The program and its tests share one tree, build/release. tools/run needs no test package, so a
# tree without tests stays one; a tree with them keeps them, or what is built of them would be
# forgotten.
configure_program() {
  if [ -e "$root/build/release/CMakeCache.txt" ]; then
    configure release
  else
    configure release -DTELETACT_BUILD_TESTS=OFF
  fi
}
