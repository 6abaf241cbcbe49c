#!/bin/sh
# Puts ProACT's packages into a catkin or colcon workspace, as links, under SRC/proact.
#
#   ros1_ws/link.sh ~/my_ws/src
#
# A message-only package of ours stays out when the workspace, or an underlay that is sourced, has a package of that
# name. Call it again after either has changed. What ProACT's own Debian package installs does not count: catkin cannot build
# against it.
set -eu

if [ "$#" != 1 ] || [ ! -d "$1" ]; then
    echo "link.sh: expected the src folder of a workspace, got: $*" >&2
    exit 2
fi
ours=$(cd "$(dirname "$0")/src" && pwd)
src=$(cd "$1" && pwd)

# Whether a package of this name is elsewhere: in the workspace, or installed.
is_elsewhere() {
    found=$(find -L "$src" -path "$src/proact" -prune -o -name package.xml -print0 |
        xargs -0 -r grep -l "<name>$1</name>" | head -n 1)
    [ -z "$found" ] || return 0
    for prefix in $(echo "${CMAKE_PREFIX_PATH:-}" | tr ':;' '  ') /usr /opt/ros/*; do
        [ ! -f "$prefix/share/$1/cmake/$1Config.cmake" ] || return 0
    done
    return 1
}

rm -rf "$src/proact"
mkdir -p "$src/proact/compat"
for package in "$ours"/proact_* "$ours"/compat/*; do
    name=$(basename "$package")
    case $package in
    */compat/*)
        if is_elsewhere "$name"; then
            echo "link.sh: $name is there already, ours stays out"
            continue
        fi
        ln -s "$package" "$src/proact/compat/$name"
        ;;
    *) ln -s "$package" "$src/proact/$name" ;;
    esac
done
