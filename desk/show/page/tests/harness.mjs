// Loads the page's files as the page does, one after the other in one scope, and gives tests what they ask for.

import { readFileSync } from 'node:fs';
import vm from 'node:vm';

const FILES = ['data', 'rest', 'features', 'colours', 'limits', 'places', 'camera', 'source', 'legend', 'panels', 'pointers', 'keys'];

export function load(...names) {
  const text = FILES.map((name) => readFileSync(new URL(`../${name}.js`, import.meta.url), 'utf8')).join('\n');
  return vm.runInNewContext(`(() => { 'use strict';\n${text}\nreturn { ${names.join(', ')} }; })()`, { TextDecoder, Math, console });
}

// Columns of a print from rows of nodes; what a row leaves out is 0.
export function columns(rows) {
  const names = ['time', 'x', 'y', 'z', 'speed', 'bead', 'height', 'width', 'line', 'layer', 'kind', 'feature', 'tool'];
  return Object.fromEntries(names.map((name) => [name, Float64Array.from(rows, (row) => row[name] ?? 0)]));
}

// Values of another realm, as plain ones of this one.
export const plain = (value) => JSON.parse(JSON.stringify(value));
