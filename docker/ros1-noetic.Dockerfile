# ProACT's ROS 1 nodes on Ubuntu 20.04 with ROS Noetic. UNTESTED: this image has not been built. Known risks: KDL
# 1.4, OMPL 1.4, ODE 0.16, urdfdom 1.0 and FCL 0.5 of that release are older than those that the C++ cores are
# compiled against in the tests (FCL's headers changed between 0.5 and 0.6), and Rust and node come from their makers.
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
        g++ make cmake pkg-config ca-certificates curl liborocos-kdl-dev libompl-dev libode-dev liburdfdom-dev \
        liburdfdom-headers-dev libfcl-dev libccd-dev libeigen3-dev ros-noetic-robot-state-publisher ros-noetic-rviz \
        ros-noetic-control-msgs ros-noetic-gazebo-msgs ros-noetic-controller-manager-msgs \
    && rm -rf /var/lib/apt/lists/*

# Rust and node are taken from the machine if they are recent enough; here they are not.
ENV CARGO_HOME=/opt/cargo RUSTUP_HOME=/opt/rustup PATH=/opt/cargo/bin:/opt/node/bin:$PATH
ARG NODE=v22.11.0
RUN curl -fsSL https://sh.rustup.rs | sh -s -- -y --profile minimal \
    && mkdir /opt/node \
    && curl -fsSL "https://nodejs.org/dist/$NODE/node-$NODE-linux-x64.tar.gz" \
        | tar -xz --strip-components 1 -C /opt/node

RUN mkdir -p /opt/ws/src \
    && . /opt/ros/noetic/setup.sh \
    && sh ros1_ws/link.sh /opt/ws/src
WORKDIR /opt/ws
RUN . /opt/ros/noetic/setup.sh && catkin_make install

ENTRYPOINT ["/opt/proact/docker/ros1-entrypoint.sh"]
CMD ["roslaunch", "proact_bringup", "sim.launch"]
