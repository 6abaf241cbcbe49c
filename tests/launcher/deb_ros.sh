#!/bin/sh
# shellcheck disable=SC2016 # the shells of the root expand their own variables
# Proves the nodes of a release's .deb in a bare root of a system: without ROS a node joins a master outside; with the
# system's own ROS 1 a joint state is published within a minute of `apt install ./proact.deb`, tools find packages and
# messages, and the short ROS lane passes with the packaged program. On Debian 12 also with a ROS that lies under
# /opt/ros/one. Needs root, debootstrap, the network, and a ROS master on this machine.
#
#   tests/launcher/deb_ros.sh RELEASE DIR [--without-lane]     bookworm, trixie, jammy or noble; the folder with its .deb
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
if [ "$#" -lt 2 ] || [ ! -d "$2" ]; then
    echo "deb_ros.sh: expected a release and the folder of its packages, got: $*" >&2
    exit 2
fi
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$@"
release=$1
packages=$(cd "$2" && pwd)
with_lane=${3:-}

# From `apt install ./proact.deb` to the first joint state, s.
most_secs=60
# What does not come in this time does not come at all, s.
timeout_secs=${PROACT_TIMEOUT_SECS:-120}
# What a lab installs beside ProACT: a master, roslaunch and rostopic, robot_state_publisher, and Python classes of messages.
ros="ros-core rosbash ros-robot-state-publisher python3-geometry-msgs python3-sensor-msgs python3-tf2-msgs"

refuse() {
    echo "FAILED: $*"
    exit 1
}

# Runs commands in the root, with the graph's variables; shows the end of what they printed when they fail.
try() { # TITLE COMMANDS
    echo "--- $1"
    printf 'set -eu\nexport ROS_MASTER_URI=http://127.0.0.1:%s ROS_IP=127.0.0.1 ROS_HOME=/ros_home DEBIAN_FRONTEND=noninteractive\n%s\n' "$port" "$2" >"$root/try"
    inside "$root" bash /try >"$root/log" 2>&1 || {
        grep -nE '^(FAIL|ERROR)|Error: ' "$root/log" | tail -n 40 || true
        tail -n 40 "$root/log"
        refuse "$1"
    }
}

apt_install() { # PACKAGES: the command, without what apt would bring beside them
    echo "apt-get -y -qq --no-install-recommends install $*"
}

free_port() {
    /usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'
}

# Tries a command of this machine until it works.
await() { # COMMAND
    end=$(($(date +%s) + timeout_secs))
    until timeout 30 "$@"; do [ "$(date +%s)" -le "$end" ] || return 1; done
}

# Waits for a message on a topic: rostopic ends at once while there is no master, and waits for a publisher where there is.
hear='hear() { until timeout 30 rostopic echo -n 1 --noarr "$1"; do kill -0 "$running"; done; }'

port=$(free_port)
set -- "$packages"/proact_*.deb
if [ "$#" != 1 ] || [ ! -f "$1" ]; then refuse "expected one .deb in $packages, got: $*"; fi
deb=$1
make_root "$release"
cp "$deb" "$root/proact.deb"
grep -qs localhost "$root/etc/hosts" || echo "127.0.0.1 localhost" >>"$root/etc/hosts"
git clone --quiet --no-local "$repository" "$root/proact"
try "apt install ./proact.deb" "apt-get -qq update
$(apt_install /proact.deb)"

# --- Without ROS ------------------------------------------------------------------------------------------

if ! inside "$root" proact doctor | grep '^ok *feature ros ' >/dev/null; then
    inside "$root" proact node sim 2>&1 | grep 'installs ros-std-msgs' || refuse "proact node names no package to install"
    echo "skipped: this package has no nodes, since $release has no message definitions of ROS 1"
    exit 77
fi

echo "--- no ROS here: a node joins a master outside of the root"
[ ! -e "$root/usr/share/std_msgs" ] || refuse "the root has ROS already"
ROS_MASTER_URI=http://127.0.0.1:$port ROS_IP=127.0.0.1
export ROS_MASTER_URI ROS_IP
rosmaster --core -p "$port" >"$root/master.log" 2>&1 &
master=$!
trap 'kill "$master" $(cat "$root/node.pid") 2>/dev/null || true; finish_root' EXIT
await rostopic list >/dev/null 2>&1 || refuse "no master: $(cat "$root/master.log")"
{ inside "$root" env ROS_MASTER_URI="$ROS_MASTER_URI" ROS_IP="$ROS_IP" sh -c 'echo $$ >/node.pid; exec proact node sim' >"$root/node.log" 2>&1; } &
node=$!
await rostopic echo -n 1 /mpl_right_arm/joint_states/header || {
    cat "$root/node.log"
    refuse "no joint state from proact node sim"
}
kill -INT "$(cat "$root/node.pid")"
wait "$node" || true
kill "$master"
wait "$master" || true
trap finish_root EXIT

if ! inside "$root" apt-cache show ros-core >/dev/null 2>&1; then
    echo "skipped: $release has no ROS 1 of its own, so that roslaunch was not tried"
    exit 77
fi

# --- /opt/ros/one in the build ----------------------------------------------------------------------------

# The definitions of this machine in the place of ROS One's, in a root that has no others.
if [ "$release" = bookworm ]; then
    echo "--- definitions under /opt/ros/one: the build and the launcher find them"
    CARGO_MANIFEST_DIR=/proact/rust/ros "${RUSTC:-rustc}" --edition 2024 "$repository/rust/ros/build.rs" -o "$root/gather"
    mkdir "$root/gathered"
    inside --userspec=1000:1000 "$root" /proact/proact node sim >"$root/log" 2>&1 || true
    grep -q 'install .*ros-std-msgs' "$root/log" || refuse "the launcher does not install ros-std-msgs: $(cat "$root/log")"
    mkdir -p "$root/opt/ros/one/share"
    for folder in /usr/share/*_msgs /usr/share/std_srvs; do
        # Not those of an installed ProACT.
        if [ -d "$folder/cmake" ] || [ ! -d "$repository/ros1_ws/src/compat/${folder##*/}" ]; then cp -R "$folder" "$root/opt/ros/one/share/"; fi
    done
    inside "$root" env CARGO_FEATURE_ROSRUST=1 OUT_DIR=/gathered /gather >"$root/log" 2>&1 || refuse "the build finds no definitions: $(cat "$root/log")"
    [ -s "$root/gathered/share/std_msgs/msg/String.msg" ] || refuse "the build did not gather std_msgs"
    inside --userspec=1000:1000 "$root" /proact/proact node sim >"$root/log" 2>&1 || true
    ! grep -q 'ros-[a-z0-9-]*-msgs' "$root/log" || refuse "the launcher looks for message packages beside /opt/ros/one: $(cat "$root/log")"
    rm -r "$root/opt/ros"
fi

# --- The system's own ROS ---------------------------------------------------------------------------------

try "ProACT goes, its packages are fetched" "apt-get -y -qq purge --autoremove proact
$(apt_install --download-only /proact.deb "$ros")"
start=$(date +%s%N)
try "apt install of the system's ROS" "$(apt_install "$ros")"
took=$(($(date +%s%N) - start))
printf 'that took %d.%d s\n' $((took / 1000000000)) $((took / 100000000 % 10))

start=$(date +%s%N)
try "from apt install ./proact.deb to a joint state" "$(apt_install /proact.deb)
$hear
roslaunch -p $port proact_bringup testbed.launch & running=\$!
trap 'kill \$running; wait \$running || true' EXIT
hear /mpl_right_arm/joint_states
date +%s%N >/heard"
took=$(($(cat "$root/heard") - start))
printf 'apt install ./proact.deb, roslaunch and the first joint state took %d.%d s\n' $((took / 1000000000)) $((took / 100000000 % 10))
[ "$took" -le $((most_secs * 1000000000)) ] || refuse "more than $most_secs s"

looks='for package in proact_bringup proact_description proact_moveit_config proact_nodes proact_msgs mpl_control gazebo_msgs; do
    rospack find $package
done
rosmsg show proact_msgs/Frame | grep MethodView
rosmsg md5 mpl_control/graspAction
rossrv show gazebo_msgs/SetModelState | grep success
rosrun proact_nodes proact --version
roslaunch --nodes proact_bringup nodes.launch | grep /proact_method
roslaunch --ros-args proact_moveit_config $(ls $(rospack find proact_moveit_config)/launch | head -n 1)
test -e $(rospack find proact_description)/arms/mpl_right/arm.urdf'
trial="$hear
roslaunch -p $port proact_bringup testbed.launch & running=\$!
trap 'kill \$running; wait \$running || true' EXIT
hear /mpl_right_arm/joint_states/header
hear /proact/frame
hear /tf"
# Debian has the manifests by which rosmsg finds message packages in those for compilers, and the definitions apart.
try "rospack, rosmsg, rossrv, rosrun, roslaunch" "$(apt_install libactionlib-msgs-dev libgeometry-msgs-dev ros-actionlib-msgs ros-geometry-msgs ros-std-msgs)
$looks"
try "the testbed by roslaunch, its own messages by rostopic" "$trial"

# --- The short ROS lane -----------------------------------------------------------------------------------

if [ "$with_lane" != --without-lane ]; then
    tests=$(sed -n '/^ros_test_packages="/,/"$/p' "$repository/tests/lanes.sh" | sed 's/.*="//; s/"//' | tr '\n' ' ')
    try "packages of the ROS tests" "$(apt_install g++ pkg-config "$tests")"
    start=$(date +%s)
    try "the short ROS lane with /usr/bin/proact" 'root=/proact
. /proact/tests/lanes.sh
ros_tests /usr/bin/proact'
    echo "that took $(($(date +%s) - start)) s"
fi

# --- /opt/ros/one ------------------------------------------------------------------------------------------

# Debian's ROS, moved to where ROS One lies and without Debian's patches that look under /usr by themselves.
if [ "$release" = bookworm ]; then
    try "Debian's ROS moves to /opt/ros/one" 'one=/opt/ros/one
mkdir -p $one/bin $one/lib $one/share
for package in $(dpkg -S "/usr/share/*/package.xml" | grep -v "^proact:" | sed "s/:.*//" | sort -u) $(dpkg-query -W -f "\${Package}\n" "python3-*-msgs" "python3-ros*" python3-std-srvs python3-catkin); do
    case $package in python3-rospkg | python3-rosdistro) continue ;; esac
    dpkg -L $package | while read -r file; do
        case $file in
        /usr/share/doc* | /usr/share/man*) continue ;;
        /usr/bin/* | /usr/share/* | /usr/lib/python3/* | /usr/lib/ros* | /usr/lib/robot_state_publisher/*) ;;
        *) continue ;;
        esac
        if [ -f $file ]; then
            mkdir -p $one/$(dirname ${file#/usr/})
            mv $file $one/${file#/usr/}
        fi
    done
done
sed -i "s| + .:/usr/share.||" /usr/lib/python3/dist-packages/rospkg/environment.py
sed -i "s| or d.startswith(./usr/share/.)||" /usr/lib/python3/dist-packages/rospkg/rospack.py
sed -i "/workspaces.append/d" $one/lib/python3/dist-packages/catkin/workspace.py
touch $one/.catkin
cat >$one/setup.sh <<SETUP
export CMAKE_PREFIX_PATH=$one ROS_PACKAGE_PATH=$one/share PYTHONPATH=$one/lib/python3/dist-packages ROS_DISTRO=one
export PATH=$one/bin:\$PATH
SETUP
. $one/setup.sh
command -v roslaunch | grep "^$one/bin/"
if roslaunch --files proact_bringup testbed.launch; then
    echo "found without /usr/share in ROS_PACKAGE_PATH: this is still the ROS of Debian"
    exit 1
fi'
    try "the testbed by the roslaunch of /opt/ros/one" ". /opt/ros/one/setup.sh
export ROS_PACKAGE_PATH=\$ROS_PACKAGE_PATH:/usr/share
$trial"
fi
echo "deb_ros: all passed on $release"
