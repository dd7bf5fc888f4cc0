// The print's data: columns of differences, bytes apart, deflated, in base64
// (desk/show/src/columns.rs).

const KIND = { travel: 0, print: 1, retract: 2, prime: 3, homing: 4, heating: 5, wait: 6 };
const KIND_NAMES = ['travel', 'printing', 'retraction', 'priming', 'homing', 'heating', 'wait'];

async function unpack(id) {
  const element = document.getElementById(id);
  const text = atob(element.textContent);
  element.remove();
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function readColumns(columns, bytes) {
  const read = {};
  let start = 0;
  for (const { name, length, bytes: width, unit } of columns) {
    const wide = name === 'time' || name === 'heatTime';
    const values = wide ? new Float64Array(length) : new Float32Array(length);
    let sum = 0;
    for (let i = 0; i < length; i++) {
      let number = 0;
      for (let byte = width - 1; byte >= 0; byte--) number = number * 256 + bytes[start + byte * length + i];
      sum += number % 2 ? -(number + 1) / 2 : number / 2;
      values[i] = sum * unit;
    }
    start += width * length;
    read[name] = values;
  }
  return read;
}

async function load() {
  const description = JSON.parse(document.getElementById('description').textContent);
  const [bytes, lineBytes] = await Promise.all([unpack('data'), unpack('lines')]);
  const path = readColumns(description.columns, bytes);
  // What follows the executed nodes is the rest of a job that has stopped. Columns of heat come
  // after those of nodes.
  const n = description.executed;
  const names = description.columns.map(({ name }) => name);
  const nodeNames = names.slice(0, names.indexOf('heatTime'));
  const c = Object.fromEntries(names.map((name) => [name, nodeNames.includes(name) ? path[name].subarray(0, n) : path[name]]));
  const rest = restOf(path, n);
  // Where each layer begins, in time.
  const layerStart = [0];
  for (let i = 1; i < n; i++) while (layerStart.length <= c.layer[i]) layerStart.push(i - 1);
  layerStart.push(n - 1);
  const executedLayers = layerStart.length - 1;
  const layers = Math.max(executedLayers, rest.count ? rest.layers[rest.count - 1] + 1 : 0);
  while (layerStart.length <= layers) layerStart.push(n - 1);
  const layerTime = new Float32Array(layers);
  const layerZ = new Float32Array(layers);
  for (let i = 1; i < n; i++) {
    if (c.kind[i] !== KIND.heating && c.kind[i] !== KIND.homing) layerTime[c.layer[i]] += c.time[i] - c.time[i - 1];
    if (c.kind[i] === KIND.print) layerZ[c.layer[i]] = c.z[i];
  }
  for (let i = n; i < n + rest.count; i++) if (path.kind[i] === KIND.print) layerZ[path.layer[i]] = path.z[i];
  const print = { ...description, c, n, path, rest, layers, executedLayers, layerStart, layerTime, layerZ, source: sourceLines(lineBytes), featureColour: featureColours(description.features) };
  // Where nothing is printed, the path itself is what there is to see.
  print.main = c.kind.includes(KIND.print) ? KIND.print : KIND.travel;
  Object.assign(print, heightsOf(print));
  print.partStart = Math.max(1, lowerBound(c.time, description.totals.part_start_s));
  print.places = placesOf(print);
  return print;
}

// The usual height of a layer, mm, of each layer its own, and whether any is known: from one layer
// to the next, the first from the bed.
function heightsOf({ c, n, layers, layerZ, main }) {
  const isHeight = (height) => height > 0.01 && height < 2.5;
  const rises = Array.from(layerZ, (z, l) => z - (l ? layerZ[l - 1] : 0));
  const marked = [];
  if (main === KIND.print) for (let i = 1; i < n; i++) if (c.kind[i] === KIND.print && c.height[i] > 0) marked.push(c.height[i]);
  const known = (marked.length ? marked : layers > 1 ? rises.slice(1) : rises).filter(isHeight).sort((a, b) => a - b);
  const hasHeight = main === KIND.print && known.length > 0;
  const height = hasHeight ? known[known.length >> 1] : 0.2;
  const layerHeight = Float32Array.from(rises, (rise) => (isHeight(rise) ? rise : height));
  return { height, hasHeight, layerHeight };
}

// Height and width of the bead of the part that ends at a node, mm: as the slicer says, or as its
// layer and its filament do.
function beadHeight({ c, layerHeight }, i) {
  return c.height[i] || layerHeight[c.layer[i]];
}

function beadWidth(print, i) {
  return print.c.width[i] || print.c.bead[i] / beadHeight(print, i);
}

// The same as it is drawn: a thin line is seen, and damage does not hide the part.
function drawnWidth(print, i) {
  return Math.min(3, Math.max(0.15, beadWidth(print, i)));
}

// The lowest and the highest place of what there is to see from a part on, mm; null without any.
function extentOf({ c, n, main }, first) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = Math.max(1, first); i < n; i++) {
    if (c.kind[i] !== main) continue;
    // A part begins where the one before it ended.
    for (const j of [i - 1, i]) [c.x[j], c.y[j], c.z[j]].forEach((v, k) => { low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], v); });
  }
  return low[0] <= high[0] ? [low, high] : null;
}

// Time of heating before the last step, s.
function heatingBefore({ c, n }, end) {
  let sum = 0;
  for (let i = 1; i < n; i++) if (c.kind[i] === KIND.heating) sum += Math.max(0, Math.min(end, c.time[i]) - c.time[i - 1]);
  return sum;
}

// What the slicer's time says beside this one; null where the two cannot be compared.
function slicerNote(print) {
  const { job } = print;
  const stop = job.findings.find((finding) => finding.weight === 'stop');
  if (stop) return stop.line ? `the print stops at line ${stop.line}` : 'the print stops before its end';
  const rest = job.print_time_s - heatingBefore(print, job.print_time_s);
  if (!(rest > 0) || !(job.slicer_time_s > 0)) return null;
  const share = 100 * (rest - job.slicer_time_s) / job.slicer_time_s;
  const size = Math.abs(share);
  const words = size < 0.5 ? 'the same' : `${size.toFixed(size < 10 ? 1 : 0)} % too ${share > 0 ? 'short' : 'long'}`;
  return `${words} on ${job.profile}, without heating`;
}

// Lines of the G-code by their numbers.
function sourceLines(bytes) {
  const starts = [0];
  for (let i = 0; i < bytes.length; i++) if (bytes[i] === 10) starts.push(i + 1);
  const decoder = new TextDecoder();
  return {
    count: starts.length - 1,
    line: (number) => (number >= 1 && number < starts.length
      ? decoder.decode(bytes.subarray(starts[number - 1], starts[number] - 1)) : null),
  };
}

// The first index whose value is at least this one, in an array that grows.
function lowerBound(values, value) {
  let [low, high] = [0, values.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle + 1; else high = middle;
  }
  return low;
}

// The state at a time: the part of the path it lies in, the nozzle's place, speed and the rest.
function stateAt(print, time) {
  const { c, n } = print;
  const i = Math.min(n - 1, Math.max(1, lowerBound(c.time, time)));
  const duration = c.time[i] - c.time[i - 1];
  const passed = duration > 0 ? Math.min(1, Math.max(0, (time - c.time[i - 1]) / duration)) : 1;
  const [from, to] = [c.speed[i - 1], c.speed[i]];
  // Speed changes evenly in time; so the way is a parabola.
  const mean = (from + to) / 2;
  const share = mean > 0 ? passed * (from + (to - from) * passed / 2) / mean : passed;
  const mix = (column) => column[i - 1] + (column[i] - column[i - 1]) * share;
  const moves = c.kind[i] === KIND.print || c.kind[i] === KIND.travel || c.kind[i] === KIND.homing;
  const speed = moves ? from + (to - from) * passed : 0;
  return {
    i, time, share,
    position: [mix(c.x), mix(c.y), mix(c.z)],
    speed,
    acceleration: moves && duration > 0 ? (to - from) / duration : 0,
    flow: c.kind[i] === KIND.print ? speed * c.bead[i] : 0,
    pressure: c.pressure[i - 1] + (c.pressure[i] - c.pressure[i - 1]) * passed,
    deviation: moves ? mix(c.deviation) : 0,
    ...heatAt(print, time),
  };
}

function heatAt({ c }, time) {
  const last = c.heatTime.length - 1;
  const h = Math.min(last, lowerBound(c.heatTime, time));
  const before = Math.max(0, h - 1);
  const span = c.heatTime[h] - c.heatTime[before];
  const share = span > 0 ? Math.min(1, Math.max(0, (time - c.heatTime[before]) / span)) : 1;
  const mix = (column) => column[before] + (column[h] - column[before]) * share;
  const chamber = c.chamber ? { chamber: mix(c.chamber), chamberTarget: c.chamberTarget[h] } : {};
  return { nozzle: mix(c.nozzle), bed: mix(c.bed), nozzleTarget: c.nozzleTarget[h], bedTarget: c.bedTarget[h], ...chamber, fan: c.fan[before] };
}

function clock(seconds) {
  const s = Math.max(0, Math.round(seconds));
  const two = (number) => String(number).padStart(2, '0');
  const [h, m] = [Math.floor(s / 3600), Math.floor(s / 60) % 60];
  return h ? `${h}:${two(m)}:${two(s % 60)}` : `${m}:${two(s % 60)}`;
}

function words(seconds) {
  const s = Math.round(seconds);
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`;
  if (s < 60) return `${s} s`;
  const [h, m] = [Math.floor(s / 3600), Math.floor(s / 60) % 60];
  return h ? `${h} h ${m} min` : `${m} min ${s % 60} s`;
}

function make(tag, text, className) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (className) element.className = className;
  return element;
}
