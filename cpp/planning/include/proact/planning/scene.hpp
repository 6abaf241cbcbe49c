// The collision scene: an arm, what it carries, and what it must keep clear of. FCL decides whether two
// shapes touch; which pairs it is asked about is decided here.
#pragma once

#include "proact/planning/fcl.hpp"
#include "proact/planning/model.hpp"

#include <Eigen/Geometry>

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

/// A shape ready for FCL.
struct Solid {
  Shape shape;
  std::shared_ptr<fcl::CollisionGeometryd> geometry;
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
  void set_padding(double metres);

  /// From now on `member` (a link or the carried object) may touch `obstacle`. Throws std::invalid_argument
  /// for an unknown name.
  void allow_contact(const std::string& member, const std::string& obstacle);

  /// Withdraws everything allowed with allow_contact.
  void forget_allowed_contacts();

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
  /// The bound divides the distance of two bounding volumes by the largest distance that any point of the moving
  /// body can travel per unit of t: the distance of its ball from each joint's axis now, and how much farther the
  /// other joints can carry it until `enough`. It is zero where boxes overlap although the shapes are apart.
  double clearance(const double* q, const double* dq, double enough);

  /// Largest distance, in metres, that any point of the arm travels along the straight joint motion dq: an
  /// upper bound over all configurations.
  double travel(const double* dq) const;

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
    /// A ball around the shape: its centre in `world` and its radius.
    Vector centre = Vector::Zero();
    double ball = 0.0;
    /// Where the shape is and a box around it; wrong until this state's question needed them.
    bool posed = false;
    Transform world_from_shape = Transform::Identity();
    Box box;
  };

  struct Body {
    std::vector<Member> members;
    Transform world_from_body = Transform::Identity();
    /// A ball around all members: its centre in the body's frame and in `world`, and its radius.
    Vector body_centre = Vector::Zero();
    Vector centre = Vector::Zero();
    double ball = 0.0;
    /// Farthest point of any member from the body's origin.
    double radius = 0.0;
    /// False until this state's question needed the centres of the members.
    bool centred = false;
  };

  struct ChainJoint {
    Pose parent_from_joint;
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

  void place_hand();
  void place_obstacle(Obstacle& obstacle) const;
  void update_radii();
  void pose_bodies(const double* q);
  static void centre_members(Body& body);
  static void pose_member(const Body& body, Member& member);
  void set_speeds(const double* dq, double span);
  void list_pairs();
  bool bodies_clear(std::size_t a, std::size_t b, double& least);
  bool obstacles_clear(std::size_t b, double& least);
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
  Pose world_from_base_;
  double padding_ = 0.0;
  std::vector<double> lever_;         // [joint][body]: metres per radian, in any configuration
  std::vector<double> speed_;         // [body]: metres per unit of t
  std::vector<double> pair_speed_;    // [body][body]
  std::vector<double> any_speed_;     // [body][body]: the same in any configuration
  std::size_t state_checks_ = 0;
};

}  // namespace proact::planning
