#!/bin/sh
# Builds ros1_ws as a lab would, with catkin_make, catkin build and colcon, then launches what was built.
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/proact-workspace.XXXXXX")
trap 'rm -rf "$work"' EXIT

echo "--- the messages alone, as docs/ros1.md has it, with another Python before Debian's"
mkdir -p "$work/other" "$work/messages/src"
printf '#!/bin/sh\nexec /usr/bin/python3 -S "$@"\n' >"$work/other/python3"
chmod +x "$work/other/python3"
"$repository/ros1_ws/link.sh" "$work/messages/src"
(cd "$work/messages" && PATH=$work/other:/usr/bin:/bin catkin_make --only-pkg-with-deps proact_msgs \
    -DPYTHON_EXECUTABLE=/usr/bin/python3 >catkin.log 2>&1) || {
    tail -n 40 "$work/messages/catkin.log"
    echo "FAILED: catkin_make of proact_msgs"
    exit 1
}
PYTHONPATH=$work/messages/devel/lib/python3/dist-packages /usr/bin/python3 -c "import proact_msgs.msg"

PATH=/usr/bin:/bin:$PATH
export PATH ROS_IP=127.0.0.1 ROS_HOME="$work/home"

echo "--- a package of the workspace keeps ours of the same name out"
mkdir -p "$work/lab/src/control_msgs"
cp -r "$repository/ros1_ws/src/compat/control_msgs/." "$work/lab/src/control_msgs/"
"$repository/ros1_ws/link.sh" "$work/lab/src"
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
"$repository/ros1_ws/link.sh" "$work/tools/src"
(cd "$work/tools" && catkin config --install >/dev/null && catkin build --no-status -j1 -p1 >catkin.log 2>&1) || {
    tail -n 40 "$work/tools/catkin.log"
    echo "FAILED: catkin build"
    exit 1
}
[ -x "$work/tools/install/lib/proact_nodes/proact" ]

echo "--- colcon"
mkdir -p "$work/colcon/src"
"$repository/ros1_ws/link.sh" "$work/colcon/src"
(cd "$work/colcon" && colcon build --executor sequential >colcon.log 2>&1) || {
    tail -n 40 "$work/colcon/colcon.log"
    echo "FAILED: colcon build"
    exit 1
}
[ -x "$work/colcon/install/proact_nodes/lib/proact_nodes/proact" ]

echo "--- roslaunch from the install space"
/usr/bin/python3 "$repository/tests/ros/check_launch_files.py" "$work/lab/install/setup.sh"
