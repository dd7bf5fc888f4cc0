import assert from 'node:assert/strict';
import { test } from 'node:test';
import { columns, load, plain } from './harness.mjs';

// A page that sets its modes has them to itself.
const page = () => load('MODES', 'chooseModes', 'coloured', 'limitColours', 'limitEntries', 'limitName', 'KIND', 'LIMIT_COLOURS');

const names = ['asked speed', 'acceleration', 'corner'];

function planned(KIND) {
  const rows = [{}, { time: 1, kind: KIND.print }, { time: 4, kind: KIND.print }, { time: 5, kind: KIND.print }, { time: 9, kind: KIND.travel }];
  const c = { ...columns(rows), limit: Float32Array.from([0, 2, 1, 3, 2]) };
  const times = [{ limit: 'acceleration', seconds: 5, moves: 2 }, { limit: 'asked speed', seconds: 3, moves: 1 }, { limit: 'corner', seconds: 1, moves: 0 }];
  return { c, n: rows.length, main: KIND.print, job: { rules: { name: 'klipper', limits: names, times } } };
}

test('a part has the colour of the limit that holds', () => {
  const { MODES, KIND, chooseModes, coloured, LIMIT_COLOURS, limitColours, limitName } = page();
  const print = planned(KIND);
  chooseModes(print);
  const { values, table } = coloured(print, 'limit');
  assert.deepEqual([...values.slice(2)], [2, 2, 1, 1, 3, 3, 2, 2]);
  assert.deepEqual(plain(limitColours(print)).slice(1), names.map((name) => LIMIT_COLOURS[name]));
  const hex = (i) => '#' + [...table.slice(4 * i, 4 * i + 3)].map((v) => v.toString(16).padStart(2, '0')).join('');
  assert.deepEqual([1, 2, 3].map(hex), names.map((name) => LIMIT_COLOURS[name]));
  assert.deepEqual([1, 2, 3, 4].map((i) => limitName(print, i)), ['acceleration', 'asked speed', 'corner', 'acceleration']);
  assert.ok(!('pressure' in MODES) && !('deviation' in MODES) && !('slowed' in MODES) && 'speed' in MODES);
});

test('the legend lists the limits of what is printed, the longest time first', () => {
  const { KIND, limitEntries } = page();
  assert.deepEqual(plain(limitEntries(planned(KIND))).map(({ name }) => name), ['asked speed, 3.0 s', 'acceleration, 1.0 s', 'corner, 1.0 s']);
});

test('without rules there are no limits, and all that steps tell', () => {
  const { MODES, KIND, chooseModes } = page();
  chooseModes({ c: columns([{}]), n: 1, main: KIND.print, job: {} });
  assert.ok(!('limit' in MODES) && 'pressure' in MODES && 'deviation' in MODES && 'slowed' in MODES);
});

test('every limit has a colour of its own', () => {
  const colours = Object.values(page().LIMIT_COLOURS);
  assert.equal(new Set(colours).size, colours.length);
});
