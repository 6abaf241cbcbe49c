# ProACT's ROS 1 nodes on Ubuntu 20.04 with ROS Noetic of ros.org. UNTESTED as an image: its packages of ros.org and the base
# image were not to be had where this was written. The rest is tested in a bare Ubuntu 20.04 with that release's own ROS 1
# (tests/launcher/focal.sh): program, nodes, workspace, launch. With OMPL 1.4 a stored roadmap is refused.
#
#   docker build -t proact-noetic -f docker/ros1-noetic.Dockerfile .
FROM ros:noetic-ros-base-focal

ENV DEBIAN_FRONTEND=noninteractive
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /opt/proact
COPY . .

# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        cmake make ros-noetic-robot-state-publisher ros-noetic-rviz ros-noetic-control-msgs ros-noetic-gazebo-msgs \
        ros-noetic-controller-manager-msgs ros-noetic-moveit-msgs \
    && rm -rf /var/lib/apt/lists/*

# The launcher brings the libraries, and a Rust and a node that are newer than the release's own.
RUN mkdir -p /opt/ws/src \
    && . /opt/ros/noetic/setup.sh \
    && ./proact ros-binary /opt/proact/bin/proact \
    && sh ros1_ws/link.sh /opt/ws/src
WORKDIR /opt/ws
RUN . /opt/ros/noetic/setup.sh && catkin_make install

ENTRYPOINT ["/opt/proact/docker/ros1-entrypoint.sh"]
CMD ["roslaunch", "proact_bringup", "sim.launch"]
