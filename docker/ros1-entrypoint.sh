#!/bin/sh
# Runs a command with the workspace in the environment.
# Not -u: setup files read variables that nobody has set.
set -e
if [ -f /opt/ros/noetic/setup.sh ]; then
    # shellcheck source=/dev/null
    . /opt/ros/noetic/setup.sh
fi
# shellcheck source=/dev/null
. /opt/ws/install/setup.sh
# A setup file names the workspace alone; Debian's packages lie under /usr/share.
export ROS_PACKAGE_PATH="$ROS_PACKAGE_PATH:/usr/share"
exec "$@"
