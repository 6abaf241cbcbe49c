// The view of EMG: columns of a picture, and the spectrum.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { EmgColumns, SPAN_SECS } = await load("emgColumns");
const { powerSpectrum, medianFrequency } = await load("spectrum");

test("a peak of one sample stays in its column, and the oldest columns go", () => {
  const columns = new EmgColumns();
  const rows = (from, count) => Array.from({ length: count }, (_, k) => [from + k === 5003 ? 99 : 1, 10]);
  for (let from = 0; from < 6000; from += 100) columns.push(rows(from, 100), 1000);
  assert.equal(columns.columnCount, Math.floor((5999 * columns.count) / (1000 * SPAN_SECS)) + 1);
  assert.equal(columns.columnCount - columns.oldest, 1.15 * columns.count);
  assert.equal(columns.maximum(Math.floor((5003 * columns.count) / (1000 * SPAN_SECS)), 0), 99);
  assert.equal(columns.baseline(1), 10);
  assert.equal(columns.peak(1, 10), 0);
  assert.ok(columns.peak(0, columns.baseline(0)) > 97);
});

test("a slow stream has a column for two rows, and another number of channels begins anew", () => {
  const columns = new EmgColumns();
  columns.push([[1, 2], [3, 4], [5, 6]], 50);
  assert.deepEqual([columns.count, columns.columnCount, columns.channels], [25 * SPAN_SECS, 2, 2]);
  assert.deepEqual([columns.minimum(0, 0), columns.maximum(0, 1), columns.minimum(1, 0)], [1, 4, 5]);
  columns.push([[7, 7, 7]], 50);
  assert.deepEqual([columns.columnCount, columns.channels, columns.minimum(0, 2)], [1, 3, 7]);
});

test("of a dense stream each column has a lowest and a highest value", () => {
  for (const rowHz of [31.25, 250, 400]) {
    const columns = new EmgColumns();
    columns.push(Array.from({ length: 2 * Math.round(SPAN_SECS * rowHz) }, (_, k) => [k % 2 === 0 ? -1 : 1]), rowHz);
    for (let column = columns.oldest; column < columns.columnCount - 1; column++) {
      assert.deepEqual([columns.minimum(column, 0), columns.maximum(column, 0)], [-1, 1], `${rowHz} Hz, column ${column}`);
    }
  }
});

test("the spectrum of a sine has its line there, and the sum of all lines is its variance", () => {
  for (const rate of [200, 1000, 2000]) {
    const values = Array.from({ length: rate }, (_, k) => 128 + 4 * Math.sin((2 * Math.PI * 50 * k) / rate));
    const spectrum = powerSpectrum(values, rate);
    const line = spectrum.density.indexOf(Math.max(...spectrum.density));
    assert.ok(Math.abs(line * spectrum.stepHz - 50) <= spectrum.stepHz, `${rate} Hz: ${line * spectrum.stepHz} Hz`);
    const variance = spectrum.density.reduce((sum, value) => sum + value, 0) * spectrum.stepHz;
    assert.ok(Math.abs(variance - 8) < 0.2, `${rate} Hz: ${variance}`);
    assert.ok(Math.abs(medianFrequency(spectrum) - 50) <= spectrum.stepHz);
  }
});

test("too short a piece has no spectrum, and silence no median frequency", () => {
  assert.equal(powerSpectrum([1, 2, 3], 1000), null);
  assert.equal(medianFrequency(powerSpectrum(new Array(1000).fill(5), 1000)), null);
});
