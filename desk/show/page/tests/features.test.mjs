import assert from 'node:assert/strict';
import { test } from 'node:test';
import { load, plain } from './harness.mjs';

const { familyOf, featureColours, featureRows } = load('familyOf', 'featureColours', 'featureRows');

test('names of several slicers belong to one family', () => {
  for (const [family, names] of Object.entries({
    outer: ['External perimeter', 'Outer wall', 'WALL-OUTER', 'outer perimeter', 'shell'],
    inner: ['Perimeter', 'Inner wall', 'WALL-INNER', 'inner perimeter'],
    overhang: ['Overhang perimeter', 'Overhang wall'],
    infill: ['Internal infill', 'Sparse infill', 'FILL', 'infill'],
    solid: ['Solid infill', 'Internal solid infill', 'SKIN', 'solid layer'],
    top: ['Top solid infill', 'Top surface'],
    support: ['Support material', 'Support', 'SUPPORT'],
    contact: ['Support material interface', 'Support interface', 'SUPPORT-INTERFACE', 'dense support'],
    tower: ['Wipe tower', 'Prime tower', 'PRIME-TOWER'],
    skirt: ['Skirt/Brim', 'Skirt', 'Brim', 'SKIRT'],
    bridge: ['Bridge infill', 'Bridge'],
    gap: ['Gap fill', 'Gap infill'],
    none: [''],
  })) {
    for (const name of names) assert.equal(familyOf(name), family, name);
  }
  assert.equal(familyOf('Feature 07'), null);
});

test('a feature has its colour in every file', () => {
  const one = featureColours(['', 'External perimeter', 'Perimeter']);
  const other = featureColours(['', 'Skirt/Brim', 'Gap fill', 'Perimeter', 'External perimeter']);
  assert.equal(one[1], other[4]);
  assert.equal(one[2], other[3]);
});

test('no two features are alike, however many there are', () => {
  const names = ['', ...Array.from({ length: 63 }, (_, k) => `Feature ${k}`)];
  assert.equal(new Set(featureColours(names)).size, 64);
  assert.equal(new Set(featureColours(['Skirt', 'Brim', 'Support', 'SUPPORT'])).size, 4);
});

test('rows tell time and filament of what is printed', () => {
  const share = (time_s, volume_mm3) => ({ time_s, volume_mm3, path_mm: 10 });
  const print = { features: ['', 'Perimeter', 'Skirt'], featureColour: ['#1', '#2', '#3'], job: { filament_mm2: 2 },
    totals: { features: [share(0, 0), share(5, 4000), share(1, 200)] } };
  assert.deepEqual(plain(featureRows(print)).map(({ name, time, filament, colour }) => [name, time, filament, colour]),
    [['Perimeter', 5, 2, '#2'], ['Skirt', 1, 0.1, '#3']]);
});
