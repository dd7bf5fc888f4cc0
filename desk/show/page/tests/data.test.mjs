import assert from 'node:assert/strict';
import { test } from 'node:test';
import { columns, load, plain } from './harness.mjs';

const { KIND, heightsOf, beadWidth, extentOf, heatingBefore, slicerNote, timeOfLine, sourceLines, stateAt, coloured } =
  load('KIND', 'heightsOf', 'beadWidth', 'extentOf', 'heatingBefore', 'slicerNote', 'timeOfLine', 'sourceLines', 'stateAt', 'coloured');

test('a bead is as wide as its own layer says', () => {
  const rows = [{}, { kind: KIND.print, layer: 0, z: 0.3, bead: 0.135 }, { kind: KIND.print, layer: 1, z: 0.5, bead: 0.09 }, { kind: KIND.print, layer: 2, z: 0.7, bead: 0.09 },
    { kind: KIND.print, layer: 2, z: 0.7, bead: 0.09, width: 0.6 }, { kind: KIND.print, layer: 2, z: 0.7, bead: 0.09, height: 0.1 }];
  const print = { c: columns(rows), n: rows.length, layers: 3, layerZ: [0.3, 0.5, 0.7], main: KIND.print };
  Object.assign(print, heightsOf(print));
  const widths = [1, 2, 3, 4, 5].map((i) => Math.round(1000 * beadWidth(print, i)) / 1000);
  assert.deepEqual(widths, [0.45, 0.45, 0.45, 0.6, 0.9]);
});

test('a job that prints nothing has no height of a layer', () => {
  const print = { c: columns([{}, {}]), n: 2, layers: 1, layerZ: [0], main: KIND.travel };
  const { hasHeight, layerHeight } = heightsOf(print);
  assert.equal(hasHeight, false);
  assert.ok(layerHeight[0] > 0);
});

test('heat after the last step is no part of the print time', () => {
  const rows = [{ time: 0 }, { time: 60, kind: KIND.heating }, { time: 100, kind: KIND.print }, { time: 500, kind: KIND.heating }];
  assert.equal(heatingBefore({ c: columns(rows), n: 4 }, 100), 60);
});

test('the extent is that of the part', () => {
  const rows = [{}, { kind: KIND.print, x: 1 }, { x: 40, y: 30 }, { kind: KIND.print, x: 50, y: 30, z: 0.2 }, { x: 200 }];
  const print = { c: columns(rows), n: 5, main: KIND.print };
  assert.deepEqual(plain(extentOf(print, 3)), [[40, 30, 0], [50, 30, 0.2]]);
  assert.equal(extentOf({ ...print, c: columns([{}]), n: 1 }, 1), null);
});

test('times are compared only where they can be', () => {
  const rows = [{ time: 0 }, { time: 60, kind: KIND.heating }, { time: 160, kind: KIND.print }];
  const print = (job) => ({ c: columns(rows), n: 3, job: { findings: [], profile: 'mine', print_time_s: 160, slicer_time_s: 80, ...job } });
  assert.equal(slicerNote(print({})), '25 % too short on mine, without heating');
  assert.equal(slicerNote(print({ slicer_time_s: 100 })), 'the same on mine, without heating');
  assert.equal(slicerNote(print({ findings: [{ weight: 'stop', line: 7 }] })), 'the print stops at line 7');
  assert.equal(slicerNote(print({ print_time_s: 0 })), null);
});

test('a line has a time, and a line without motion that of the next', () => {
  const rows = [{ time: 0 }, { time: 1, line: 4 }, { time: 2, line: 4 }, { time: 3, line: 9 }];
  const print = { c: columns(rows), n: 4 };
  assert.deepEqual([0, 4, 5, 9, 99].map((line) => timeOfLine(print, line)), [null, 1, 3, 3, 3]);
});

test('lines are found by their numbers', () => {
  const source = sourceLines(new TextEncoder().encode('G28\n\nG1 X1\n'));
  assert.deepEqual([source.count, source.line(1), source.line(2), source.line(3), source.line(4)], [3, 'G28', '', 'G1 X1', null]);
});

test('a priming line and an empty scale do not spoil the colours', () => {
  const rows = [{}, { time: 1, kind: KIND.print, speed: 300 }, { time: 2, kind: KIND.print, speed: 300 }, ...Array.from({ length: 20 }, (_, k) => ({ time: 3 + k, kind: KIND.print, speed: 40 }))];
  const print = { c: columns(rows), n: rows.length, main: KIND.print, partStart: 4 };
  const { low, high, most } = plain(coloured(print, 'speed'));
  assert.deepEqual([low, high, most], [0, 40, 40]);
  const laser = { c: columns([{}, { time: 1, speed: 40 }, { time: 2, speed: 40 }]), n: 3, main: KIND.travel, partStart: 1 };
  assert.deepEqual([coloured(laser, 'speed').low, coloured(laser, 'speed').high], [0, 40]);
});
