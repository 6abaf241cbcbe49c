# ProACT's ROS 1 nodes on Ubuntu 20.04 with ROS Noetic. UNTESTED as an image: it has not been built. The C++ cores are
# compiled and tested against that release's KDL 1.4, OMPL 1.4, ODE 0.16, FCL 0.5 and urdfdom 1.0
# (tests/launcher/focal.sh); with OMPL 1.4 a stored roadmap is refused.
#
#   docker build -t proact-noetic -f docker/ros1-noetic.Dockerfile .

# Rust and node are newer than the release's own.
FROM rust:1.89-slim-bullseye AS rust
FROM node:22-bullseye-slim AS node

FROM ros:noetic-ros-base-focal

ENV DEBIAN_FRONTEND=noninteractive
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /opt/proact
COPY . .

# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        g++ make cmake pkg-config ca-certificates liborocos-kdl-dev libompl-dev libode-dev liburdfdom-dev \
        liburdfdom-headers-dev libfcl-dev libccd-dev libeigen3-dev fonts-dejavu-core ros-noetic-robot-state-publisher ros-noetic-rviz \
        ros-noetic-control-msgs ros-noetic-gazebo-msgs ros-noetic-controller-manager-msgs ros-noetic-moveit-msgs \
    && rm -rf /var/lib/apt/lists/*

COPY --from=rust /usr/local/cargo /opt/cargo
COPY --from=rust /usr/local/rustup /opt/rustup
COPY --from=node /usr/local/bin /opt/node/bin
COPY --from=node /usr/local/lib/node_modules /opt/node/lib/node_modules
ENV CARGO_HOME=/opt/cargo RUSTUP_HOME=/opt/rustup PATH=/opt/cargo/bin:/opt/node/bin:$PATH

RUN mkdir -p /opt/ws/src \
    && . /opt/ros/noetic/setup.sh \
    && sh ros1_ws/link.sh /opt/ws/src
WORKDIR /opt/ws
RUN . /opt/ros/noetic/setup.sh && catkin_make install

ENTRYPOINT ["/opt/proact/docker/ros1-entrypoint.sh"]
CMD ["roslaunch", "proact_bringup", "sim.launch"]
