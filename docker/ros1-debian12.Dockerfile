# ProACT's ROS 1 nodes on Debian 12, with Debian's ROS packages, catkin and rviz.
#
#   docker build -t proact-ros1 -f docker/ros1-debian12.Dockerfile .
#   docker compose -f docker/compose.yml up
FROM debian:12

ENV DEBIAN_FRONTEND=noninteractive
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /opt/proact
COPY . .

# The clients' side: master, launch files, rviz on a virtual display. Versions are those of the release.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        ros-base python3-roslaunch python3-rosbag python3-rostopic python3-rosnode python3-rosservice \
        ros-robot-state-publisher rviz xvfb xauth libgl1-mesa-dri catkin ros-core-dev ros-message-generation \
        libstd-msgs-dev libgeometry-msgs-dev libsensor-msgs-dev libshape-msgs-dev libtrajectory-msgs-dev ros-std-msgs \
        ros-geometry-msgs ros-sensor-msgs ros-trajectory-msgs ros-actionlib-msgs cmake make \
        python3-std-msgs python3-geometry-msgs python3-sensor-msgs python3-shape-msgs python3-trajectory-msgs \
        python3-actionlib-msgs python3-diagnostic-msgs python3-rosgraph-msgs python3-std-srvs python3-tf2-msgs \
        python3-visualization-msgs \
    && rm -rf /var/lib/apt/lists/*

# The launcher brings compilers and message definitions; catkin makes the workspace with launch files.
RUN ./proact ros-binary /opt/proact/bin/proact \
    && mkdir -p /opt/ws/src \
    && sh ros1_ws/link.sh /opt/ws/src
WORKDIR /opt/ws
RUN catkin_make install

ENV ROS_PACKAGE_PATH=/opt/ws/install/share:/usr/share \
    CMAKE_PREFIX_PATH=/opt/ws/install
ENTRYPOINT ["/opt/proact/docker/ros1-entrypoint.sh"]
CMD ["roslaunch", "proact_bringup", "sim.launch"]
