#!/bin/sh
# Proves the whole program on Ubuntu 20.04, the release of ROS Noetic: KDL 1.4, OMPL 1.4, ODE 0.16, FCL 0.5 and urdfdom 1.0
# are older than Debian 12's, and so are its own Rust and node. First the demo and the tests of the C++ cores, then the nodes
# with the release's own ROS 1: the workspace by catkin_make, catkin build and colcon, a launch, and a trial in lock-step. Needs
# root, debootstrap and the network; takes an hour.
#
# The packages of ROS are Ubuntu's (universe), not those of ros.org, which have the same interfaces under /opt/ros/noetic.
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$@"

# step TITLE COMMAND...: runs the command in the root and says how long it took, or shows the end of what it printed.
step() {
    title=$1
    shift
    echo "--- $title"
    start=$(date +%s)
    inside "$root" "$@" >"$root/log" 2>&1 || {
        tail -n 60 "$root/log"
        echo "FAILED: $title"
        exit 1
    }
    echo "that took $(($(date +%s) - start)) s"
}

make_root focal
git clone --quiet --no-local "$repository" "$root/proact"
grep -q localhost "$root/etc/hosts" || echo "127.0.0.1 localhost" >>"$root/etc/hosts"

step "./proact demo" /proact/proact demo --headless --method D --seed 1 --out /trials --json
tail -n 1 "$root/log"
step "./proact test cpp" /proact/proact test cpp

# catkin-tools and colcon are not in this release; PyPI has them, of catkin-tools one that its catkin_pkg still knows.
packages=$(sed -n '/^ros_test_packages="/,/"$/p' "$repository/tests/lanes.sh" | sed 's/.*="//; s/"//' | tr '\n' ' ' |
    sed 's/ catkin-tools / /; s/ colcon / /; s/ python3-colcon-ros / /')
# shellcheck disable=SC2086 # a list of words
step "ROS 1 of the release" env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends python3-pip $packages
step "catkin build and colcon" /usr/bin/python3 -m pip install "catkin_tools<0.9" colcon-common-extensions colcon-ros
# What PyPI brought lies there.
step "the workspace by catkin_make, catkin build and colcon, and a launch" env PATH=/usr/local/bin:/usr/bin:/bin sh /proact/tests/ros/workspace.sh
step "the nodes" /proact/proact ros-binary /proact/build/proact-ros
for test in test_names test_sim "test_lockstep --methods=D"; do
    # shellcheck disable=SC2086 # a test and its words
    set -- $test
    name=$1
    shift
    step "$test" env PROACT_BINARY=/proact/build/proact-ros /usr/bin/python3 -W ignore "/proact/tests/ros/$name.py" "$@"
done
echo "focal: all passed"
