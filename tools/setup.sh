#!/usr/bin/env bash
# Installs what the project needs on Debian 12 (or a relative of it): build tools, libraries, and what
# runs a virtual CAN bus anywhere. Says what it does; does nothing when all is there.
#   tools/setup.sh            install what is missing
#   tools/setup.sh --check    only tell what is missing; exit 2 if anything is
set -euo pipefail

packages=(
  # building
  g++ libc6-dev binutils cmake ninja-build pkg-config
  # libraries
  liblcm-dev liblcm-bin libglib2.0-dev libeigen3-dev libboost-dev libtomlplusplus-dev
  nlohmann-json3-dev libcli11-dev libfmt-dev libsdp-dev libjs-dygraphs
  libsqlite3-dev libopenmpi-dev openmpi-bin
  # tests and benchmarks
  libgtest-dev libgmock-dev libbenchmark-dev librapidcheck-dev
  # interoperability tests and fuzzers
  python3-can python3-msgpack rt-tests clang libclang-rt-14-dev
  # tests of the pages
  chromium
  # a CAN bus anywhere
  can-utils iproute2 kmod procps python3 user-mode-linux util-linux
)

say() { printf 'setup: %s\n' "$*"; }

usage() { sed -n '2,6s/^# \{0,1\}//p' "$0"; }

check_only=no
case "${1:-}" in
  "") ;;
  --check) check_only=yes ;;
  -h | --help) usage; exit 0 ;;
  *) say "found option '$1', expected --check or --help" >&2; exit 2 ;;
esac

# Without dpkg and apt-get nothing can be installed here, but what is missing can be named.
if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
  missing=()
  for command in g++ cmake ninja pkg-config lcm-gen lcm-logger candump ip python3 linux.uml; do
    command -v "$command" >/dev/null || missing+=("$command")
  done
  if command -v pkg-config >/dev/null; then
    for module in lcm eigen3 fmt tomlplusplus gtest benchmark; do
      pkg-config --exists "$module" || missing+=("$module (pkg-config)")
    done
  fi
  if [ ${#missing[@]} -eq 0 ]; then
    say "this is no Debian system; all that the project needs seems to be there"
    exit 0
  fi
  say "this is no Debian system, so nothing was installed. Missing:" >&2
  printf 'setup:   %s\n' "${missing[@]}" >&2
  say "Debian's names of the packages: ${packages[*]}" >&2
  exit 2
fi

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$status" = installed ] || missing+=("$package")
done
if [ ${#missing[@]} -eq 0 ]; then
  say "all ${#packages[@]} packages are there"
  exit 0
fi
say "missing: ${missing[*]}"
[ "$check_only" = no ] || exit 2

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo >/dev/null; then
    say "installing needs root: run as root, or install sudo" >&2
    exit 2
  fi
  as_root=(sudo)
fi

apt() {
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Dpkg::Use-Pty=0 \
    -o DPkg::Lock::Timeout=120 "$@"
}

say "apt-get update"
apt update
say "apt-get install --no-remove ${missing[*]}"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! apt install --yes --no-remove --no-install-recommends "${missing[@]}" >"$log" 2>&1; then
  cat "$log" >&2
  say "the installation failed; what apt-get said is above" >&2
  exit 3
fi
say "installed ${#missing[@]} packages"
