#!/bin/sh
# Makes the packages of a release for one system: in a bare root of it, by the command that a user there would type. Needs
# root, debootstrap and the network; the build takes a quarter of an hour or more.
#
#   docker/release_in_root.sh RELEASE [DIR]     such as bookworm, trixie, jammy, noble; into DIR, by default build/release/RELEASE
set -eu

if [ "$#" -lt 1 ] || [ "$#" -gt 2 ]; then
    echo "release_in_root.sh: expected a release, such as trixie, and a folder if you like; got: $*" >&2
    exit 2
fi
repository=$(cd "$(dirname "$0")/.." && pwd)
out=${2:-$repository/build/release/$1}
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$@"
make_root "$1"
git clone --quiet --no-local "$repository" "$root/proact"

echo "--- ./proact release"
start=$(date +%s)
inside "$root" /proact/proact release /release
echo "set-up, build and packages took $(($(date +%s) - start)) s"
mkdir -p "$out"
out=$(cd "$out" && pwd)
rm -f "$out"/*
cp "$root"/release/* "$out"
echo "the packages of $1 are in $out"
