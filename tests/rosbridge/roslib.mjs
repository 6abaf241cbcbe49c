// roslib as a client of `proact serve --rosbridge`:
//
//   node tests/rosbridge/roslib.mjs ws://127.0.0.1:9090
//
// Exits 0 only if everything was seen.

import assert from "node:assert/strict";
import { Param, Ros, Service, Topic } from "roslib";

const url = process.argv[2];
if (!url) {
  console.error("expected the address of the server, such as ws://127.0.0.1:9090");
  process.exit(2);
}

const LIMIT_MS = 20_000;
const POSE = "geometry_msgs/PoseStamped";

/** Fails when `promise` takes longer than only a fault does. */
function within(what, promise) {
  const late = new Promise((_, reject) => setTimeout(() => reject(new Error(`${what}: nothing in time`)), LIMIT_MS));
  return Promise.race([promise, late]);
}

async function connect() {
  const ros = new Ros();
  await within("connection", new Promise((resolve, reject) => {
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
  return within(name, new Promise((resolve) => {
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
  return within(name, new Promise((resolve, reject) => service.callService(request, resolve, reject)));
}

const ros = await connect();
const other = await connect();

// The scene, in every compression.
const states = "/mpl_right_arm/wrapped_joint_states";
for (const compression of ["none", "png", "cbor"]) {
  const [first, second] = await messages(ros, states, "sensor_msgs/JointState", { compression }, 2);
  assert.equal(first.name.length, 27, compression);
  assert.equal(Array.from(first.position).length, 27, compression);
  assert.ok(Array.from(first.position).every(Number.isFinite), compression);
  assert.ok(second.header.seq > first.header.seq, compression);
  const [pose] = await messages(ros, "/mpl_right_arm/base_pose", POSE, { compression });
  const { x, y, z, w } = pose.pose.orientation;
  assert.ok(Math.abs(Math.hypot(x, y, z, w) - 1) < 1e-9, compression);
  assert.equal(pose.header.frame_id, "hololens_world_test");
}

// A long message in fragments, which roslib puts together.
const [whole] = await messages(ros, states, "sensor_msgs/JointState", { fragment_size: 200 });
assert.equal(whole.name.length, 27);

// From one client to another; the reader comes first.
const chat = messages(other, "/chat", "std_msgs/String", {}, 3);
const writer = new Topic({ ros, name: "/chat", messageType: "std_msgs/String" });
const talking = setInterval(() => writer.publish({ data: "grüß Gott" }), 50);
assert.deepEqual(new Set((await chat).map((message) => message.data)), new Set(["grüß Gott"]));
clearInterval(talking);

// A service offered by one and called by the other.
const adder = new Service({ ros, name: "/add", serviceType: "my_pkg/Add" });
adder.advertise((request, response) => {
  response.sum = request.a + request.b;
  return true;
});
let sum;
for (let tries = 0; sum === undefined; tries += 1) {
  // The offer and the call travel on two connections, so the call may come first.
  sum = await call(other, "/add", "my_pkg/Add", { a: 2, b: 3 }).catch((reason) => {
    assert.ok(tries < 100, String(reason));
    return undefined;
  });
}
assert.equal(sum.sum, 5);
await assert.rejects(call(other, "/nobody", "my_pkg/Nobody", {}), /nobody/);

// rosapi.
const topics = await within("topics", new Promise((resolve, reject) => ros.getTopics(resolve, reject)));
assert.equal(topics.types[topics.topics.indexOf(states)], "sensor_msgs/JointState");
const kind = await within("type", new Promise((resolve, reject) => ros.getTopicType("/mode", resolve, reject)));
assert.equal(kind, "std_msgs/Int8");
const services = await within("services", new Promise((resolve, reject) => ros.getServices(resolve, reject)));
assert.ok(services.includes("/fix_world"));
const details = await within("details", new Promise((resolve, reject) =>
  ros.getMessageDetails(POSE, resolve, reject)));
assert.equal(details[0].type, POSE);
const parameter = new Param({ ros, name: "/speed" });
await within("set", new Promise((resolve, reject) => parameter.set([1, 2], resolve, reject)));
assert.deepEqual(await within("get", new Promise((resolve, reject) => parameter.get(resolve, reject))), [1, 2]);

ros.close();
other.close();
console.log("roslib: scene in text, png, cbor and fragments; topics, services, parameters and rosapi");
process.exit(0);
