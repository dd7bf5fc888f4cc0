import assert from 'node:assert/strict';
import { test } from 'node:test';
import { columns, load, plain } from './harness.mjs';

const { KIND, heightsOf, coloured, placesOf, placesBetween, extentOf, stateAt, sourceLines, featureColours, familyOf, lowerBound } =
  load('KIND', 'heightsOf', 'coloured', 'placesOf', 'placesBetween', 'extentOf', 'stateAt', 'sourceLines', 'featureColours', 'familyOf', 'lowerBound');

// A print of `count` parts; `layerOf` gives the layer of each.
function printOf(count, layers, layerOf, xOf) {
  const n = count + 1;
  const rows = Array.from({ length: n }, (_, i) => ({ time: i, kind: i ? KIND.print : KIND.travel, layer: layerOf(i), z: 0.2 * (layerOf(i) + 1), x: xOf(i), bead: 0.1, speed: 50, line: i }));
  const c = columns(rows);
  const none = new Float32Array(n);
  for (const name of ['pressure', 'deviation', 'slowed', 'feed', 'nozzle', 'bed', 'nozzleTarget', 'bedTarget', 'fan', 'heatTime']) c[name] = none;
  const features = [''];
  const layerZ = Float32Array.from({ length: layers }, (_, layer) => 0.2 * (layer + 1));
  const print = { c, n, layers, layerZ, layerTime: new Float32Array(layers), main: KIND.print, partStart: 1, features, featureColour: featureColours(features), source: sourceLines(new Uint8Array()) };
  return Object.assign(print, heightsOf(print));
}

// As many places as a page holds; of a job with more the program leaves some out.
const MOST = 700000;

for (const [name, layers, layerOf] of [['as many layers as places', MOST, (i) => Math.max(0, i - 1)], ['all places in one layer', 1, () => 0]]) {
  test(`${name}: there are colours, places and an extent`, () => {
    const print = printOf(MOST, layers, layerOf, (i) => i % 2 * 5000);
    assert.ok(Math.abs(print.height - 0.2) < 0.01, String(print.height));
    for (const mode of ['speed', 'height', 'layer']) {
      const { values, low, high } = coloured(print, mode);
      assert.equal(values.length, 2 * print.n, mode);
      assert.ok(Number.isFinite(low) && high > low, `${mode}: ${low} to ${high}`);
    }
    assert.deepEqual(plain(extentOf(print, 1)).map(([x]) => x), [0, 5000]);
    assert.equal(stateAt(print, 0.75 * MOST).i, 0.75 * MOST);
    assert.equal(placesOf(print).seams.length, 1);
  });
}

test('of many places only some are drawn at once', () => {
  const indices = Array.from({ length: MOST }, (_, i) => i);
  const chosen = placesBetween(indices, 0, MOST);
  assert.ok(chosen.length <= 3000 && chosen.length > 1000, String(chosen.length));
  assert.equal(lowerBound(indices, MOST), MOST);
});

test('a print without a node that prints has colours', () => {
  const print = printOf(0, 1, () => 0, () => 0);
  const { low, high } = coloured(print, 'speed');
  assert.ok(Number.isFinite(low) && high > low);
  assert.equal(extentOf(print, 1), null);
});

test('names of features are only names', () => {
  const names = ['', '</script><b>', '__proto__', 'constructor', '<img src=x onerror=alert(1)>', 'NaN'];
  const colours = plain(featureColours(names));
  assert.ok(colours.every((colour) => /^#[0-9a-f]{6}$/.test(colour)), colours.join());
  assert.equal(new Set(colours).size, names.length);
  assert.equal(familyOf('__proto__'), null);
});
