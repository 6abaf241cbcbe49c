#!/bin/sh
# Builds ros1_ws as a lab would, with catkin_make, catkin build and colcon, then launches what was built.
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/proact-workspace.XXXXXX")
trap 'rm -rf "$work"' EXIT
PATH=/usr/bin:/bin:$PATH
export PATH ROS_IP=127.0.0.1 ROS_HOME="$work/home"

echo "--- a package of the workspace keeps ours of the same name out"
mkdir -p "$work/lab/src/control_msgs"
cp -r "$repository/ros1_ws/src/compat/control_msgs/." "$work/lab/src/control_msgs/"
sh "$repository/ros1_ws/link.sh" "$work/lab/src"
[ ! -e "$work/lab/src/proact/compat/control_msgs" ] || {
    echo "FAILED: two packages are called control_msgs"
    exit 1
}

echo "--- catkin_make"
(cd "$work/lab" && catkin_make install >catkin.log 2>&1) || {
    tail -n 40 "$work/lab/catkin.log"
    echo "FAILED: catkin_make install"
    exit 1
}
[ -x "$work/lab/install/lib/proact_nodes/proact" ]

echo "--- catkin build"
mkdir -p "$work/tools/src"
sh "$repository/ros1_ws/link.sh" "$work/tools/src"
(cd "$work/tools" && catkin config --install >/dev/null && catkin build --no-status -j1 -p1 >catkin.log 2>&1) || {
    tail -n 40 "$work/tools/catkin.log"
    echo "FAILED: catkin build"
    exit 1
}
[ -x "$work/tools/install/lib/proact_nodes/proact" ]

echo "--- colcon"
mkdir -p "$work/colcon/src"
sh "$repository/ros1_ws/link.sh" "$work/colcon/src"
(cd "$work/colcon" && colcon build --executor sequential >colcon.log 2>&1) || {
    tail -n 40 "$work/colcon/colcon.log"
    echo "FAILED: colcon build"
    exit 1
}
[ -x "$work/colcon/install/proact_nodes/lib/proact_nodes/proact" ]

echo "--- roslaunch from the install space"
/usr/bin/python3 "$repository/tests/ros/launched.py" "$work/lab/install/setup.sh"
