// The collision scene: an arm, what it carries, and what it must keep clear of. FCL decides whether two
// shapes touch; which pairs it is asked about is decided here.
#pragma once

#include "proact/planning/fcl.hpp"
#include "proact/planning/model.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace proact::planning {

/// An axis-aligned box, metres.
struct Box {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e300);
  Eigen::Vector3d high = Eigen::Vector3d::Constant(-1e300);
};

/// A shape that may touch others.
struct Solid {
  Shape shape;
  /// As FCL takes it; of a primitive only once FCL was asked.
  mutable std::shared_ptr<fcl::CollisionGeometryd> geometry;
  /// A mesh's box in its own frame, and the padding that its geometry does not hold.
  Box local;
  double margin = 0.0;
};

/// What a scene holds besides the arm: poses in `world`, what is carried in the tip's frame.
struct SceneContent {
  Pose base;
  std::vector<double> hand;
  std::vector<Object> obstacles;
  std::optional<Object> attached;
  double padding = 0.0;
};

/// Collision scene of one arm. One thread at a time: every question writes to scratch memory.
///
/// Links that cannot move against each other while the hand keeps its pose form one *body*: body 0 stands
/// still with the base, body k moves with arm joint k - 1, the last body is the hand with what it carries.
/// Shapes of one body are never compared, nor is body 0 with obstacles: no plan could change the answer.
class Scene {
 public:
  /// Throws std::invalid_argument, naming the link or joint, if the arm cannot be used: an index out of range,
  /// a shape without extent, an axis without direction, limits in the wrong order, a chain with a gap.
  explicit Scene(const Arm& arm);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  std::size_t joint_count() const noexcept { return chain_.size(); }
  double lower(std::size_t joint) const { return chain_.at(joint).lower; }
  double upper(std::size_t joint) const { return chain_.at(joint).upper; }

  /// Sets world_from_base.
  void set_base(const Pose& world_from_base);

  /// Sets the hand's joint angles, in the order of Arm::hand. Throws std::invalid_argument on a wrong length.
  void set_hand(const std::vector<double>& angles);

  /// Replaces all obstacles (poses in `world`) and forgets what was allowed with allow_contact. Throws
  /// std::invalid_argument for a shape without extent or a name used twice; the scene is then unchanged.
  void set_obstacles(const std::vector<Object>& obstacles);

  /// Replaces the carried object (pose in the tip's frame); std::nullopt for an empty hand.
  void set_attached(const std::optional<Object>& attached);

  /// Grows every obstacle by `metres` on all sides; a negative number shrinks it.
  void set_padding(double padding_m);

  /// From now on `member` (a link or the carried object) may touch `obstacle`. Throws std::invalid_argument
  /// for an unknown name.
  void allow_contact(const std::string& member, const std::string& obstacle);

  /// Withdraws everything allowed with allow_contact.
  void clear_allowed_contacts();

  /// Pairs of names in collision at arm angles q[joint_count()]; empty when free.
  std::vector<NamePair> collisions(const double* q);

  /// As collisions, but also compares links within one body, such as two fingers; used to derive which pairs
  /// of an arm never meet.
  std::vector<NamePair> collisions_of_all_links(const double* q);

  /// True if nothing touches at q[joint_count()].
  bool is_free(const double* q);

  /// How far the straight joint motion q + t * dq may go on from `t` = 0 in both directions before anything
  /// could touch: a lower bound, at most `enough`. Negative if something touches at q.
  ///
  /// A lower bound of the distance of two shapes is set against the farthest that any point of the moving body can
  /// travel: by its speed now and what joint turns can add to that on the way, or by the distance of its ball from each
  /// joint's axis. The result is zero where shapes are not proved to be apart although FCL sees no contact.
  double clearance(const double* q, const double* dq, double enough);

  /// The same for all motions in which no joint turns farther than t * |reach|, straight or not.
  double clearance_around(const double* q, const double* reach, double enough);

  /// Largest distance, in metres, that any point of the arm travels along the straight joint motion dq: an
  /// upper bound over all configurations.
  double max_travel(const double* dq) const;

  /// Number of states asked about since construction.
  std::size_t state_checks() const noexcept { return state_checks_; }

  const Arm& arm() const noexcept { return arm_; }

  /// A copy of all that was set, but for contacts allowed one by one.
  SceneContent content() const;

 private:
  using Vector = Eigen::Vector3d;
  using Transform = Eigen::Isometry3d;

  /// A shape of a body. `owner` is a link, or links_.size() for the carried object.
  struct Member {
    Solid solid;
    std::size_t owner = 0;
    Transform link_from_shape = Transform::Identity();
    Transform body_from_shape = Transform::Identity();
    /// Radius of a ball around the shape.
    double bounding_radius = 0.0;
    /// Where the shape is and a box around it; wrong until this state's question needed them.
    bool is_posed = false;
    Transform world_from_shape = Transform::Identity();
    Box box;
  };

  struct Body {
    std::vector<Member> members;
    Transform world_from_body = Transform::Identity();
    /// A ball around all members: its centre in the body's frame and in `world`, and its radius.
    Vector body_center = Vector::Zero();
    Vector center = Vector::Zero();
    double bounding_radius = 0.0;
    /// Farthest point of any member from the body's origin.
    double reach = 0.0;
    /// Of the members' balls: centres in `world`, a column each, and radii; false until this state's question needed them.
    Eigen::Array<double, Eigen::Dynamic, 3> centers;
    Eigen::ArrayXd bounding_radii;
    bool centers_valid = false;
  };

  struct ChainJoint {
    Pose parent_from_joint;
    JointKind kind = JointKind::revolute;
    /// Where the joint at zero is in its parent's frame, and its turn there by an angle: along + cos * across + sin * around.
    Vector origin = Vector::Zero();
    Eigen::Matrix3d along = Eigen::Matrix3d::Identity();
    Eigen::Matrix3d across = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d around = Eigen::Matrix3d::Zero();
    /// The axis in the parent's frame.
    Vector turned_axis = Vector::UnitZ();
    Vec3 axis{0.0, 0.0, 1.0};
    double lower = 0.0;
    double upper = 0.0;
  };

  struct Obstacle {
    std::string name;
    PlacedShape placed;
    Transform world_from_shape = Transform::Identity();
    Solid solid;
    Box box;
  };

  /// How far a body can travel in t: at most any * t, and on a straight joint motion at most now * t + bend * t^2.
  struct TravelBound {
    double max_rate = 0.0;
    double initial_rate = 0.0;
    double rate_growth = 0.0;

    /// Metres in t.
    double travel(double t) const { return std::min(max_rate * t, (initial_rate + rate_growth * t) * t); }
    /// A t in which it travels no farther than that many metres.
    double time(double distance_m) const {
      return std::max(
          distance_m / max_rate,
          2.0 * distance_m / (initial_rate + std::sqrt(initial_rate * initial_rate + 4.0 * rate_growth * distance_m)));
    }
  };

  /// Two shapes of which balls alone do not tell how far a motion may go on.
  struct NearPair {
    const Solid* first;
    const Transform* first_pose;
    const Solid* second;
    const Transform* second_pose;
    /// Distance of their boxes, metres, and how the two can close in.
    double gap;
    const TravelBound* rate;
  };

  void place_hand();
  static void place_joint(ChainJoint& joint, const Pose& parent_from_joint);
  void place_obstacle(Obstacle& obstacle) const;
  void list_boxes();
  void update_radii();
  void pose_bodies(const double* q);
  static void center_members(Body& body);
  static void pose_member(const Body& body, Member& member);
  double clearance(const double* q, const double* dq, double enough, bool straight);
  void set_rates(const double* dq, double span, bool straight);
  static void tighten_bound(double gap, const TravelBound& rate, double& least);
  void list_pairs();
  void list_near_bodies(std::size_t a, std::size_t b, double& least);
  void list_near_obstacles(std::size_t b, double& least);
  bool check_pair(const NearPair& pair, double& least);
  bool contact_allowed(std::size_t owner, std::size_t obstacle) const;
  bool links_allowed(std::size_t a, std::size_t b) const;
  const std::string& owner_name(std::size_t owner) const;
  std::vector<NamePair> report(const double* q, bool within_bodies);

  Arm arm_;
  std::vector<ChainJoint> chain_;
  std::vector<std::size_t> body_of_link_;
  std::vector<Body> bodies_;
  std::vector<double> hand_;
  std::vector<char> allowed_links_;     // [link][link]
  std::vector<char> allowed_contacts_;  // [obstacle][owner]
  /// [body][body]: members of the first and the second that must not meet.
  std::vector<std::vector<std::pair<std::size_t, std::size_t>>> pairs_;
  std::vector<Obstacle> obstacles_;
  std::optional<Object> attached_;
  Pose base_;
  Transform world_from_base_ = Transform::Identity();
  double padding_ = 0.0;
  std::vector<double> lever_;              // [joint][body]: metres per radian, or per metre, in any configuration
  std::vector<TravelBound> rates_;         // [body][body], of the second as the first sees it
  std::vector<Vector> axes_;               // [joint]: in `world`, in the state that is looked at
  std::vector<NearPair> near_;             // of that state
  Eigen::Array<double, Eigen::Dynamic, 3> low_;   // [obstacle]: corners of their boxes
  Eigen::Array<double, Eigen::Dynamic, 3> high_;
  Eigen::ArrayXd squared_distances_;         // scratch: squared distances of a body from the obstacles
  Eigen::ArrayXd squares_;                   // scratch: squared distances of a body's members from an obstacle
  std::vector<double> zeros_;                // [joint]: zeros
  std::size_t state_checks_ = 0;
};

}  // namespace proact::planning
