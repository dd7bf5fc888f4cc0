import assert from 'node:assert/strict';
import { test } from 'node:test';
import { columns, load, plain } from './harness.mjs';

const { KIND, placesOf, placesBetween, sourceLines, KEYS } = load('KIND', 'placesOf', 'placesBetween', 'sourceLines', 'KEYS');

test('seams, retractions, pauses and changes of colour are found', () => {
  const text = 'G28\nG1 X1 E1\nG1 E-1\nG0 X9\nG1 X1 E1\nM600\nG1 X2 E1\nM601\nT1\nG1 X3 E1\n';
  const rows = [{}, { kind: KIND.print, line: 2, feature: 1 }, { kind: KIND.retract, line: 3 }, { kind: KIND.travel, line: 4 }, { kind: KIND.print, line: 5, feature: 2 },
    { kind: KIND.travel, line: 6 }, { kind: KIND.travel, line: 6 }, { kind: KIND.print, line: 7, feature: 1 }, { kind: KIND.wait, line: 8 }, { kind: KIND.travel, line: 9, tool: 1 },
    { kind: KIND.print, line: 10, feature: 1, tool: 1 }];
  const print = { c: columns(rows), n: rows.length, features: ['', 'External perimeter', 'Infill'], source: sourceLines(new TextEncoder().encode(text)) };
  assert.deepEqual(plain(placesOf(print)), { seams: [0, 6, 9], retractions: [2], pauses: [7], changes: [4, 8] });
});

test('of many places some are drawn, evenly', () => {
  const indices = Array.from({ length: 100000 }, (_, k) => k);
  const chosen = placesBetween(indices, 20000, 80000);
  assert.ok(chosen.length > 1000 && chosen.length <= 3000, String(chosen.length));
  assert.equal(chosen[0], 20000);
  assert.ok(chosen.at(-1) >= 79900 && chosen.at(-1) < 80000);
});

test('every key has its words', () => {
  assert.ok(KEYS.length > 10 && KEYS.every(([key, words]) => key && words));
});
