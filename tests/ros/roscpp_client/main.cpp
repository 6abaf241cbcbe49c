// Moves one joint by a trajectory command, and looks where the tip is by tf2. Ends with 0 when the joint arrives and
// the tip has moved, with 1 after a minute without.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/JointState.h>
#include <tf2_ros/transform_listener.h>
#include <trajectory_msgs/JointTrajectory.h>

namespace {

const std::vector<std::string> joints{
    "mpl_right_arm__shoulder", "mpl_right_arm__humerus", "mpl_right_arm__elbow", "mpl_right_arm__forearm",
    "mpl_right_arm__wristy",   "mpl_right_arm__wristx",  "mpl_right_arm__wristz"};

std::vector<double> angles(const sensor_msgs::JointState& state) {
    std::vector<double> found;
    for (const auto& joint : joints) {
        const auto at = std::find(state.name.begin(), state.name.end(), joint);
        if (at != state.name.end()) found.push_back(state.position[static_cast<std::size_t>(at - state.name.begin())]);
    }
    return found;
}

}  // namespace

int main(int argc, char** argv) {
    ros::init(argc, argv, "roscpp_client");
    ros::NodeHandle node;
    std::vector<double> now;
    const boost::function<void(const sensor_msgs::JointStateConstPtr&)> take =
        [&now](const sensor_msgs::JointStateConstPtr& state) { now = angles(*state); };
    const auto subscriber = node.subscribe<sensor_msgs::JointState>("/mpl_right_arm/joint_states", 1, take);
    auto publisher = node.advertise<trajectory_msgs::JointTrajectory>("/mpl_right_arm/arm_controller/command", 1);
    tf2_ros::Buffer buffer;
    const tf2_ros::TransformListener listener(buffer);
    const std::string tip = "mpl_right_arm__wristz_link";

    const auto end = ros::WallTime::now() + ros::WallDuration(60.0);
    bool sent = false;
    double target = 0.0;
    geometry_msgs::Vector3 start;
    while (ros::ok() && ros::WallTime::now() < end) {
        // Waits for a message, but not for long: a transform may come of age without one.
        ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.005));
        const bool seen = now.size() == joints.size() && buffer.canTransform("world", tip, ros::Time(0));
        if (!seen || publisher.getNumSubscribers() == 0) continue;
        const auto where = buffer.lookupTransform("world", tip, ros::Time(0)).transform.translation;
        if (!sent) {
            start = where;
            trajectory_msgs::JointTrajectory command;
            command.joint_names = joints;
            trajectory_msgs::JointTrajectoryPoint point;
            point.positions = now;
            target = now[3] + 0.15;
            point.positions[3] = target;
            point.velocities.assign(joints.size(), 0.0);
            point.time_from_start = ros::Duration(0.8);
            command.points.push_back(point);
            publisher.publish(command);
            sent = true;
        } else if (std::abs(now[3] - target) < 0.02) {
            const double moved = std::hypot(std::hypot(where.x - start.x, where.y - start.y), where.z - start.z);
            // The forearm is about a quarter of a metre long.
            std::printf("tip moved %.4f m\n", moved);
            return moved > 0.02 && moved < 0.06 ? 0 : 1;
        }
    }
    std::printf("the joint did not arrive\n");
    return 1;
}
