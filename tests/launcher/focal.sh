#!/bin/sh
# Compiles the C++ cores and runs their tests on Ubuntu 20.04, the release of ROS Noetic: KDL 1.4, OMPL 1.4, ODE 0.16,
# FCL 0.5 and urdfdom 1.0 are older than Debian 12's. Needs root, debootstrap and the network; takes five minutes.
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$@"

bootstrap focal
mirror=$(awk '$1 == "deb" { print $2; exit }' "$root/etc/apt/sources.list")
for suite in focal focal-updates; do echo "deb $mirror $suite main universe"; done >"$root/etc/apt/sources.list"

inside "$root" sh -c 'apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
    --no-install-recommends g++ make cmake pkg-config liborocos-kdl-dev libompl-dev libode-dev liburdfdom-dev \
    liburdfdom-headers-dev libfcl-dev libccd-dev libeigen3-dev fonts-dejavu-core' >"$root/log" 2>&1 || {
    tail -n 40 "$root/log"
    echo "FAILED: the packages of the release"
    exit 1
}
mkdir "$root/proact"
cp -r "$repository/cpp" "$repository/cmake" "$root/proact/"
inside "$root" sh -c "cd /proact && cmake -S cpp -B build && cmake --build build -j $(nproc) &&
    cd build && ctest --output-on-failure"
