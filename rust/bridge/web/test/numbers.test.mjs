// Numbers as the pages show them.

import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { fixed } = await load("numbers");
const source = new URL("../src/", import.meta.url);

test("a number that rounds to zero has no sign", () => {
  assert.equal(fixed(-0.001, 2), "0.00");
  assert.equal(fixed(-0, 0), "0");
  assert.equal(fixed(-0.4), "0");
  assert.equal(fixed(-1.25, 1), (-1.25).toFixed(1));
  assert.equal(fixed(12.345, 2), (12.345).toFixed(2));
});

// "-0.00" was on the page: each place had its own way to write a number.
test("every page writes numbers by that function", () => {
  const files = readdirSync(source, { recursive: true }).map(String).filter((name) => name.endsWith(".ts") && !name.startsWith("figures"));
  const others = files.filter((name) => name !== "numbers.ts" && readFileSync(new URL(name, source), "utf8").includes(".toFixed("));
  assert.deepEqual(others, []);
});
