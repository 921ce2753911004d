#!/usr/bin/env bash
# Checks format and lint with the pinned tools (clang-format 14, clang-tidy 14), apart from the build.
#   tools/lint.sh            clang-format, then clang-tidy (needs build/dev or build/release)
#   tools/lint.sh --format   only clang-format
#   tools/lint.sh --fix      apply clang-format
set -euo pipefail
cd "$(dirname "$0")/.."

command -v clang-format >/dev/null || {
  printf 'lint: clang-format 14 is missing: apt-get install clang-format clang-tidy\n' >&2
  exit 2
}
mapfile -t sources < <(git ls-files '*.h' '*.cpp' '*.c')
case "${1:-}" in
  --fix) clang-format -i "${sources[@]}"; exit 0 ;;
  --format | "") clang-format --dry-run --Werror "${sources[@]}" ;;
  *) printf "lint: found option '%s', expected --format or --fix\n" "$1" >&2; exit 2 ;;
esac
[ "${1:-}" = --format ] && exit 0

for build in build/dev build/release; do
  [ -f "$build/compile_commands.json" ] || continue
  mapfile -t units < <(git ls-files 'drivers/*.cpp' 'diagnosis/*.cpp' 'sim/*.cpp' 'tools/*.cpp')
  printf '%s\n' "${units[@]}" | xargs -P "$(nproc)" -n 4 clang-tidy --quiet -p "$build"
  exit 0
done
printf 'lint: clang-tidy needs a build: cmake --preset dev\n' >&2
exit 2
