#!/bin/sh
# Proves docker/ros1-debian12.Dockerfile without Docker: makes a minimal Debian 12 and runs the file's very commands in
# it, in their order, then its entry point with the simulator on a master. Needs root, debootstrap and the network;
# takes half an hour.
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$@"
make_root bookworm

# Every instruction of the file becomes lines of a script; one that is not known here ends the test.
/usr/bin/python3 "$repository/tests/ros/dockerfile_to_script.py" "$repository/docker/ros1-debian12.Dockerfile" >"$root/commands"
# COPY takes the committed state, and finds it outside of where it goes.
git clone --quiet --no-local "$repository" "$root/context"

echo "--- running the commands of the Dockerfile"
start=$(date +%s)
inside "$root" /bin/bash -o pipefail /commands >"$root/log" 2>&1 || {
    tail -n 40 "$root/log"
    echo "FAILED: a command of the Dockerfile"
    exit 1
}
echo "that took $(($(date +%s) - start)) s, $(du -smx "$root" | cut -f1) MB"

echo "--- the image's command answers on a master of its own"
cat >"$root/try" <<'TRY'
set -eu
. /environment
export ROS_MASTER_URI=http://127.0.0.1:11399 ROS_IP=127.0.0.1
grep -q localhost /etc/hosts || echo "127.0.0.1 localhost" >>/etc/hosts
"$entry_point" roslaunch -p 11399 proact_bringup sim.launch >/launch.log 2>&1 &
launch=$!
trap 'kill $launch; wait $launch || true' EXIT
for _ in $(seq 24); do
    if "$entry_point" timeout 5 rostopic echo -n 1 /mpl_right_arm/joint_states/header; then
        exit 0
    fi
    kill -0 $launch || break
done
cat /launch.log
exit 1
TRY
inside "$root" /bin/bash /try
