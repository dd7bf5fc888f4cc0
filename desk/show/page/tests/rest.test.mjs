import assert from 'node:assert/strict';
import { test } from 'node:test';
import { columns, load, plain } from './harness.mjs';

const { KIND, restOf, restBetween, setRestWidths, extentWithRest, KEYS } = load('KIND', 'restOf', 'restBetween', 'setRestWidths', 'extentWithRest', 'KEYS');

const rows = [{}, { kind: KIND.print, x: 5, layer: 0 }, { kind: KIND.travel, x: 50, layer: 0 }, { kind: KIND.print, x: 60, layer: 0, bead: 0.08 },
  { kind: KIND.print, x: 70, z: 0.4, layer: 2, width: 0.6 }, { kind: KIND.print, x: 80, z: 0.4, layer: 1, bead: 9 }];
const print = () => {
  const path = columns(rows);
  return { path, n: 2, rest: restOf(path, 2), layerHeight: [0.2, 0.2, 0.2] };
};

test('the rest is what follows the executed nodes, in the layers shown', () => {
  const { rest } = print();
  assert.deepEqual([rest.first, rest.count, rest.main], [2, 4, KIND.print]);
  // Layers never go down again.
  assert.deepEqual([...rest.layers], [0, 0, 2, 2]);
  assert.deepEqual([[0, 2], [0, 0], [1, 1], [1, 2], [3, 9]].map(([low, high]) => plain(restBetween(rest, low, high))), [[2, 6], [2, 4], [4, 4], [4, 6], [6, 6]]);
});

test('its beads have their widths, and its travels are left out', () => {
  const widths = new Float64Array(6);
  setRestWidths(print(), widths);
  assert.deepEqual(Array.from(widths, (width) => Number(width.toFixed(3))), [0, 0, -1, 0.4, 0.6, 3]);
});

test('without extrusion it is drawn as lines', () => {
  const path = columns([{}, { x: 1 }, { x: 2 }, { kind: KIND.homing }]);
  const widths = new Float64Array(4).fill(7);
  setRestWidths({ path, rest: restOf(path, 2), layerHeight: [0.2] }, widths);
  assert.deepEqual([...widths], [7, 7, 0, -1]);
});

test('the view takes in both the executed path and the rest', () => {
  const both = print();
  assert.deepEqual(plain(extentWithRest(both, [[-3, 0, 0], [5, 0, 0]])), [[-3, 0, 0], [80, 0, both.path.z[5]]]);
  assert.deepEqual(plain(extentWithRest(both, null))[0], [50, 0, 0]);
});

test('a job that does not stop has none', () => {
  const path = columns([{}, { kind: KIND.print, x: 5 }]);
  const rest = restOf(path, 2);
  assert.equal(rest.count, 0);
  assert.deepEqual(plain(restBetween(rest, 0, 5)), [2, 2]);
  assert.deepEqual(plain(extentWithRest({ path, rest }, [[0, 0, 0], [5, 0, 0]])), [[0, 0, 0], [5, 0, 0]]);
});

test('a key switches it', () => {
  assert.ok(KEYS.some(([key]) => key === 'N'));
});
