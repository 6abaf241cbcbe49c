// What a person has chosen survives anything that storage may hold.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { COMMANDS, DEFAULT_KEYS, keyName, parseSettings, remap } = await load("settings");

test("malformed storage gives the defaults", () => {
  for (const text of [null, "", "nonsense", "[]", "3", "null", '{"keys":3,"palette":"pink","cues":7}']) {
    const settings = parseSettings(text);
    assert.deepEqual(settings.keys, DEFAULT_KEYS, text);
    assert.equal(settings.palette, "standard");
    assert.equal(settings.cues, "chimes");
    assert.equal(settings.welcomed, false);
  }
});

test("what was stored comes back, and what was added since has its default", () => {
  const settings = parseSettings('{"keys":{"wrist_flexion":["KeyX"]},"palette":"colour-blind","welcomed":true}');
  assert.deepEqual(settings.keys.wrist_flexion, ["KeyX"]);
  assert.deepEqual(settings.keys.restart, DEFAULT_KEYS.restart);
  assert.equal(settings.palette, "colour-blind");
  assert.equal(settings.welcomed, true);
});

test("after any remapping each key has one command and no command is without a key", () => {
  let keys = DEFAULT_KEYS;
  for (const [command, code] of [
    ["wrist_flexion", "KeyR"],
    ["restart", "KeyW"],
    ["camera", "KeyC"],
    ["left", "KeyC"],
    ["hand_open", "Space"],
  ]) {
    keys = remap(keys, command, code);
    assert.deepEqual(keys[command], [code]);
    const codes = COMMANDS.flatMap((name) => keys[name]);
    assert.equal(new Set(codes).size, codes.length, `${command} on ${code}`);
    for (const name of COMMANDS) assert.ok(keys[name].length > 0, `${name} has no key after ${command} on ${code}`);
  }
});

test("keys are named as they are printed", () => {
  assert.deepEqual(["KeyW", "Digit1", "ArrowUp", "Space", "Numpad7"].map(keyName), ["W", "1", "↑", "Space", "Num 7"]);
});
