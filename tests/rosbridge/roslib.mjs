// roslib as a client of `proact serve --rosbridge`:
//
//   node tests/rosbridge/roslib.mjs ws://127.0.0.1:9090
//
// Exits 0 only if everything was seen.

import assert from "node:assert/strict";
import { Action, Param, Ros, Service, SimpleActionServer, Topic } from "roslib";

const url = process.argv[2];
if (!url) {
  console.error("expected the address of the server, such as ws://127.0.0.1:9090");
  process.exit(2);
}

const LIMIT_MS = 20_000;

/** How the two ROS write a type's name and a time. */
const conventions = {
  "ROS 1": { msg: (name) => name, srv: (name) => name, secs: (stamp) => stamp.secs + 1e-9 * stamp.nsecs },
  "ROS 2": {
    msg: (name) => name.replace("/", "/msg/"),
    srv: (name) => name.replace("/", "/srv/"),
    secs: (stamp) => stamp.sec + 1e-9 * stamp.nanosec,
  },
};

/** Fails when `promise` takes longer than only a fault does. */
function withTimeout(what, promise) {
  const late = new Promise((_, reject) => setTimeout(() => reject(new Error(`${what}: nothing in time`)), LIMIT_MS));
  return Promise.race([promise, late]);
}

async function connect() {
  const ros = new Ros();
  await withTimeout("connection", new Promise((resolve, reject) => {
    ros.on("connection", resolve);
    ros.on("error", reject);
    Promise.resolve(ros.connect(url)).catch(reject);
  }));
  return ros;
}

/** The first `count` messages of a topic. */
function messages(ros, name, messageType, options, count = 1) {
  const topic = new Topic({ ros, name, messageType, ...options });
  const got = [];
  return withTimeout(name, new Promise((resolve) => {
    topic.subscribe((message) => {
      got.push(message);
      if (got.length === count) {
        topic.unsubscribe();
        resolve(got);
      }
    });
  }));
}

/** A call that rejects with the server's reason. */
function call(ros, name, serviceType, request) {
  const service = new Service({ ros, name, serviceType });
  return withTimeout(name, new Promise((resolve, reject) => service.callService(request, resolve, reject)));
}

/** The scene, publishing, services and rosapi, with types as `convention` names them. */
async function check(convention) {
  const { msg, srv, secs } = conventions[convention];
  const POSE = msg("geometry_msgs/PoseStamped");
  const ros = await connect();
  const other = await connect();

  // The scene, in every compression.
  const states = "/mpl_right_arm/wrapped_joint_states";
  for (const compression of ["none", "png", "cbor"]) {
    const [first, second] = await messages(ros, states, msg("sensor_msgs/JointState"), { compression }, 2);
    assert.equal(first.name.length, 27, compression);
    assert.equal(Array.from(first.position).length, 27, compression);
    assert.ok(Array.from(first.position).every(Number.isFinite), compression);
    assert.ok(secs(second.header.stamp) > secs(first.header.stamp), compression);
    assert.equal("seq" in first.header, convention === "ROS 1", compression);
    const [pose] = await messages(ros, "/mpl_right_arm/base_pose", POSE, { compression });
    const { x, y, z, w } = pose.pose.orientation;
    assert.ok(Math.abs(Math.hypot(x, y, z, w) - 1) < 1e-9, compression);
    assert.equal(pose.header.frame_id, "hololens_world_test");
  }

  // A time that a client writes, in a header without seq, comes back as every client reads it.
  const own = messages(other, "/own_pose", POSE);
  const pose = new Topic({ ros, name: "/own_pose", messageType: POSE });
  const stamp = convention === "ROS 1" ? { secs: 12, nsecs: 34 } : { sec: 12, nanosec: 34 };
  const posing = setInterval(() => pose.publish({ header: { stamp, frame_id: "map" }, pose: {} }), 50);
  assert.deepEqual((await own)[0].header.stamp, stamp);
  clearInterval(posing);

  // A long message in fragments, which roslib puts together.
  const [whole] = await messages(ros, states, msg("sensor_msgs/JointState"), { fragment_size: 200 });
  assert.equal(whole.name.length, 27);

  // From one client to another; the reader comes first.
  const chat = messages(other, "/chat", msg("std_msgs/String"), {}, 3);
  const writer = new Topic({ ros, name: "/chat", messageType: msg("std_msgs/String") });
  const talking = setInterval(() => writer.publish({ data: "grüß Gott" }), 50);
  assert.deepEqual(new Set((await chat).map((message) => message.data)), new Set(["grüß Gott"]));
  clearInterval(talking);

  // A service offered by one and called by the other.
  const adder = new Service({ ros, name: "/add", serviceType: srv("my_pkg/Add") });
  adder.advertise((request, response) => {
    response.sum = request.a + request.b;
    return true;
  });
  let sum;
  for (let tries = 0; sum === undefined; tries += 1) {
    // The offer and the call travel on two connections, so the call may come first.
    sum = await call(other, "/add", srv("my_pkg/Add"), { a: 2, b: 3 }).catch((reason) => {
      assert.ok(tries < 100, String(reason));
      return undefined;
    });
  }
  assert.equal(sum.sum, 5);
  await assert.rejects(call(other, "/nobody", srv("my_pkg/Nobody"), {}), /nobody/);

  // rosapi.
  const topics = await withTimeout("topics", new Promise((resolve, reject) => ros.getTopics(resolve, reject)));
  assert.equal(topics.types[topics.topics.indexOf(states)], msg("sensor_msgs/JointState"));
  const kind = await withTimeout("type", new Promise((resolve, reject) => ros.getTopicType("/mode", resolve, reject)));
  assert.equal(kind, msg("std_msgs/Int8"));
  const services = await withTimeout("services", new Promise((resolve, reject) => ros.getServices(resolve, reject)));
  assert.ok(services.includes("/fix_world"));
  const details = await withTimeout("details", new Promise((resolve, reject) =>
    ros.getMessageDetails(POSE, resolve, reject)));
  assert.equal(details[0].type, "geometry_msgs/PoseStamped");
  assert.equal(details.find((type) => type.type === "std_msgs/Header").fieldnames.includes("seq"), convention === "ROS 1");
  const parameter = new Param({ ros, name: "/speed" });
  await withTimeout("set", new Promise((resolve, reject) => parameter.set([1, 2], resolve, reject)));
  assert.deepEqual(await withTimeout("get", new Promise((resolve, reject) => parameter.get(resolve, reject))), [1, 2]);

  ros.close();
  other.close();
}

/** A goal's end: `{ values }`, or `{ failed }` with the reason. */
function goal(action, args, feedback) {
  let id;
  const ended = withTimeout(action.name, new Promise((resolve) => {
    id = action.sendGoal(args, (values) => resolve({ values }), feedback, (failed) => resolve({ failed }));
  }));
  return { id, ended };
}

/** Goals of a client of ROS 2 for an action server of ROS 1, which another client is. */
async function checkActions() {
  const ros = await connect();
  const owner = await connect();
  const server = new SimpleActionServer({ ros: owner, serverName: "/lab/count", actionName: "lab_msgs/CountAction" });
  server.on("goal", ({ to }) => {
    if (to === 3) {
      server.sendFeedback({ at: 2, left: { secs: 1, nsecs: 5 } });
      server.setSucceeded({ at: 3 });
    }
  });
  server.on("cancel", () => server.setPreempted());
  const servers = () => withTimeout("action servers", new Promise((resolve, reject) => ros.getActionServers(resolve, reject)));
  for (let tries = 0; !(await servers()).includes("/lab/count"); tries += 1) {
    assert.ok(tries < 1000, "the action server is not known");
  }
  const actionType = "lab_msgs/action/Count";
  const count = new Action({ ros, name: "/lab/count", actionType });
  const feedback = [];
  assert.deepEqual(await goal(count, { to: 3 }, (values) => feedback.push(values)).ended, { values: { at: 3 } });
  assert.deepEqual(feedback, [{ at: 2, left: { sec: 1, nanosec: 5 } }]);
  const unbounded = goal(count, { to: 1e9 });
  count.cancelGoal(unbounded.id);
  assert.match((await unbounded.ended).failed, /canceled/);
  const unknown = new Action({ ros, name: "/lab/nothing", actionType });
  assert.match((await goal(unknown, {}).ended).failed, /there are \/lab\/count/);
  const wrong = new Action({ ros, name: "/lab/count", actionType: "lab_msgs/action/Other" });
  assert.match((await goal(wrong, {}).ended).failed, /has the type lab_msgs\/Count/);
  ros.close();
  owner.close();
}

for (const convention of Object.keys(conventions)) {
  await check(convention);
  console.log(`roslib, ${convention}: scene in text, png, cbor and fragments; topics, services, parameters and rosapi`);
}
await checkActions();
console.log("roslib, ROS 2: goals, feedback, results, cancels and refusals of actions");
process.exit(0);
