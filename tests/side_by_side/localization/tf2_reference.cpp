// Frame trees on tf2's own buffer. Reads lines from standard input:
//   fixed PARENT CHILD x y z qx qy qz qw
//   moving PARENT CHILD NANOSECONDS x y z qx qy qz qw
//   ask TARGET SOURCE NANOSECONDS
// and answers each question with "x y z qx qy qz qw", or "none" where tf2 refuses.
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>

#include <cstdint>
#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>

namespace {

ros::Time time_of(std::int64_t nanoseconds) {
    ros::Time time;
    return time.fromNSec(static_cast<std::uint64_t>(nanoseconds));
}

geometry_msgs::TransformStamped read_transform(std::istringstream& words, bool moving) {
    geometry_msgs::TransformStamped stamped;
    words >> stamped.header.frame_id >> stamped.child_frame_id;
    std::int64_t stamp = 0;
    if (moving) words >> stamp;
    stamped.header.stamp = time_of(stamp);
    auto& translation = stamped.transform.translation;
    auto& rotation = stamped.transform.rotation;
    words >> translation.x >> translation.y >> translation.z;
    words >> rotation.x >> rotation.y >> rotation.z >> rotation.w;
    return stamped;
}

}  // namespace

int main() {
    tf2::BufferCore buffer(ros::Duration(1000.0));
    std::string line;
    while (std::getline(std::cin, line)) {
        std::istringstream words(line);
        std::string kind;
        words >> kind;
        if (kind == "fixed" || kind == "moving") {
            if (!buffer.setTransform(read_transform(words, kind == "moving"), "test", kind == "fixed")) return 2;
            continue;
        }
        std::string target, source;
        std::int64_t stamp = 0;
        words >> target >> source >> stamp;
        try {
            const auto found = buffer.lookupTransform(target, source, time_of(stamp)).transform;
            const auto& t = found.translation;
            const auto& r = found.rotation;
            std::printf("%.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", t.x, t.y, t.z, r.x, r.y, r.z, r.w);
        } catch (const tf2::TransformException&) {
            std::puts("none");
        }
    }
    return 0;
}
