// PD controller of a two-link arm: tau = kp (q_d - q) + kd (v_d - v), cut at the joints' limits.
//
// stepbus starts this program, writes lines of JSON to descriptor 3 and reads the answers from
// descriptor 4. What console.log prints goes to logs/controller.log of the run's folder.
import { readSync, writeSync } from "node:fs";

const chunk = Buffer.alloc(1 << 16);
let received = "";

/** Return the next message; undefined: the run has ended. */
function read() {
  let end = received.indexOf("\n");
  while (end < 0) {
    const size = readSync(3, chunk, 0, chunk.length, null);
    if (size === 0) return undefined;
    received += chunk.toString("utf8", 0, size);
    end = received.indexOf("\n");
  }
  const message = JSON.parse(received.slice(0, end));
  received = received.slice(end + 1);
  return message;
}

/** Answer a message. */
function write(message) {
  writeSync(4, JSON.stringify(message) + "\n"); // a pipe takes all of it, or waits
}

let gains;
let referenceOrder; // index of each joint in reference
let limits; // N·m

function start(inputs) {
  const joints = inputs.joint_state.names;
  referenceOrder = joints.map((name) => inputs.reference.names.indexOf(name));
  if (referenceOrder.includes(-1)) throw new Error(`the reference lacks one of ${joints}`);
  const effort = inputs.joint_state.limits?.effort ?? [];
  limits = joints.map((_, i) => effort[i] ?? Infinity); // JSON has null for infinity
}

function torques({ joint_state: state, reference }) {
  if (state === null || reference === null) return {}; // no message yet
  const { kp, kd } = gains;
  const values = state.position.map((q, i) => {
    const k = referenceOrder[i];
    const torque = kp * (reference.position[k] - q) + kd * (reference.velocity[k] - state.velocity[i]);
    return Math.min(Math.max(torque, -limits[i]), limits[i]);
  });
  return { outputs: { command: { mode: "torque", values } } };
}

for (let message = read(); message !== undefined; message = read()) {
  if (message.welcome) {
    gains = message.welcome.params; // load your model here: the run starts when it is ready
    write({ ready: {} });
  } else if (message.start) {
    start(message.start.inputs);
  } else if (message.update) {
    write(torques(message.update.inputs));
  }
}
