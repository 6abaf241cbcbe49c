// A server of actionlib that does nothing: what tools show of it is what they should show of ours.
//
//   action_server NAME

#include <actionlib/TestAction.h>
#include <actionlib/server/simple_action_server.h>
#include <ros/ros.h>

int main(int argc, char** argv) {
    ros::init(argc, argv, "reference_server");
    if (argc != 2) {
        ROS_ERROR("expected the name of the action");
        return 2;
    }
    ros::NodeHandle node;
    actionlib::SimpleActionServer<actionlib::TestAction> server(node, argv[1], false);
    server.start();
    ros::spin();
    return 0;
}
