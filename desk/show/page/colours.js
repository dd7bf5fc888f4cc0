// What the path is coloured by, and the colours.

// Dark blue over green to orange, as light as the eye sees them even: between the marks in OKLab.
const MARKS = ['#3b2c85', '#2c63c8', '#1799b5', '#2fbf7f', '#b5d334', '#ffc933', '#ff7a2f', '#e3304a'];
const TOOL_COLOURS = ['#f2a33a', '#4f8fe8', '#3fb27f', '#d85f95', '#b06fd8', '#e0c341', '#39b7c9', '#a58262'];

function rgb(hex) {
  return [1, 3, 5].map((start) => parseInt(hex.slice(start, start + 2), 16) / 255);
}

function toLab(hex) {
  const [r, g, b] = rgb(hex).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s, 1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s];
}

function fromLab([L, A, B]) {
  const l = (L + 0.3963377774 * A + 0.2158037573 * B) ** 3;
  const m = (L - 0.1055613458 * A - 0.0638541728 * B) ** 3;
  const s = (L - 0.0894841775 * A - 1.291485548 * B) ** 3;
  return [4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s, -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s].map((v) => {
    const c = Math.min(1, Math.max(0, v));
    return Math.round(255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055));
  });
}

// 256 colours, four bytes each.
function palette(hexes, isEven) {
  const table = new Uint8Array(256 * 4);
  const marks = hexes.map(toLab);
  for (let i = 0; i < 256; i++) {
    let colour;
    if (isEven) {
      const place = i / 255 * (marks.length - 1);
      const at = Math.min(marks.length - 2, Math.floor(place));
      colour = fromLab([0, 1, 2].map((k) => marks[at][k] + (marks[at + 1][k] - marks[at][k]) * (place - at)));
    } else {
      colour = rgb(hexes[i % hexes.length]).map((v) => Math.round(v * 255));
    }
    table.set([...colour, 255], i * 4);
  }
  return table;
}

const SCALE = palette(MARKS, true);
const TOOLS = palette(TOOL_COLOURS, false);

function css(table, share) {
  const i = Math.round(Math.min(1, Math.max(0, share)) * 255) * 4;
  return `rgb(${table[i]} ${table[i + 1]} ${table[i + 2]})`;
}

// Each: `of(print, i)` gives the values at the beginning and the end of the part of the path that
// ends at node i.
const MODES = {
  speed: { name: 'Executed speed', unit: 'mm/s', digits: 0, zero: true,
    of: ({ c }, i) => [c.speed[i - 1], c.speed[i]] },
  asked: { name: 'Share of the speed asked for', unit: '%', digits: 0, zero: true, top: 100,
    of: ({ c }, i) => (c.feed[i] > 0 ? [100 * c.speed[i - 1] / c.feed[i], 100 * c.speed[i] / c.feed[i]] : [100, 100]) },
  acceleration: { name: 'Change of speed', unit: 'mm/s²', digits: 0, zero: true,
    of: ({ c }, i) => {
      const time = c.time[i] - c.time[i - 1];
      const value = time > 0.0004 ? Math.abs(c.speed[i] - c.speed[i - 1]) / time : 0;
      return [value, value];
    } },
  flow: { name: 'Flow', unit: 'mm³/s', digits: 1, zero: true,
    of: ({ c }, i) => [c.speed[i - 1] * c.bead[i], c.speed[i] * c.bead[i]] },
  pressure: { name: 'Pressure in the nozzle', unit: 'mm³ too much in it', digits: 2,
    of: ({ c }, i) => [c.pressure[i - 1], c.pressure[i]] },
  deviation: { name: 'Distance from the path asked for', unit: 'mm', digits: 3, zero: true,
    of: ({ c }, i) => [c.deviation[i - 1], c.deviation[i]] },
  slowed: { name: 'Moves slowed for the board', unit: '%', digits: 0, zero: true, top: 100,
    of: ({ c }, i) => [100 * c.slowed[i], 100 * c.slowed[i]] },
  temperature: { name: 'Temperature of the nozzle', unit: '°C', digits: 1,
    of: (print, i) => [heatAt(print, print.c.time[i - 1]).nozzle, heatAt(print, print.c.time[i]).nozzle] },
  feature: { name: 'Feature', names: true, table: ({ featureColour }) => palette(featureColour, false),
    of: ({ c }, i) => [c.feature[i], c.feature[i]] },
  tool: { name: 'Tool', names: true, table: () => TOOLS, entries: toolEntries,
    of: ({ c }, i) => [c.tool[i], c.tool[i]] },
  fan: { name: 'Fan', unit: '%', digits: 0, zero: true, top: 100,
    of: (print, i) => [heatAt(print, print.c.time[i - 1]).fan / 2.55, heatAt(print, print.c.time[i]).fan / 2.55] },
  height: { name: 'Height of the layer', unit: 'mm', digits: 2,
    of: (print, i) => [beadHeight(print, i), beadHeight(print, i)] },
  layer: { name: 'Time of the layer', unit: 's', digits: 1,
    of: ({ c, layerTime }, i) => [layerTime[c.layer[i]], layerTime[c.layer[i]]] },
  width: { name: 'Width of the bead', unit: 'mm', digits: 2,
    of: (print, i) => [beadWidth(print, i), beadWidth(print, i)] },
};

// Names and colours of the tools that print.
function toolEntries({ c, n, main }) {
  const used = new Set();
  for (let i = 1; i < n; i++) if (c.kind[i] === main) used.add(c.tool[i]);
  return [...used].sort((a, b) => a - b).map((tool) => ({ name: `T${tool}`, colour: TOOL_COLOURS[tool % TOOL_COLOURS.length] }));
}

// Values of all parts in a mode, their range, and how long which value holds.
function coloured(print, key) {
  const mode = MODES[key];
  const { c, n } = print;
  const values = new Float32Array(2 * n);
  for (let i = 1; i < n; i++) {
    const [from, to] = mode.of(print, i);
    values[2 * i] = from;
    values[2 * i + 1] = to;
  }
  if (mode.names) return { key, mode, values, low: 0, high: 255, table: mode.table(print) };
  const printed = [];
  let [least, most] = [Infinity, -Infinity];
  for (let i = 1; i < n; i++) {
    if (c.kind[i] !== print.main || i < print.partStart) continue;
    for (const value of [values[2 * i], values[2 * i + 1]]) {
      least = Math.min(least, value);
      most = Math.max(most, value);
    }
    printed.push(i);
  }
  if (!printed.length) [least, most] = [0, 1];
  // One value in a thousand may lie outside the colours, so that a single spike does not take them
  // all.
  const middles = Float32Array.from(printed, (i) => (values[2 * i] + values[2 * i + 1]) / 2).sort();
  const at = (share) => (middles.length ? middles[Math.min(middles.length - 1, Math.floor(share * middles.length))] : 0);
  let low = mode.zero ? 0 : at(0.002);
  let high = mode.top ?? at(0.998);
  if (!(high > low)) [low, high] = [low - 0.5, low + 0.5];
  const bins = new Float64Array(64);
  for (const i of printed) {
    const share = ((values[2 * i] + values[2 * i + 1]) / 2 - low) / (high - low);
    bins[Math.min(63, Math.max(0, Math.floor(share * 64)))] += c.time[i] - c.time[i - 1];
  }
  return { key, mode, values, low, high, least, most, bins, table: SCALE };
}

function formatted(mode, value) {
  return mode.unit === '%' ? `${Math.round(value)} %` : `${value.toFixed(mode.digits)} ${mode.unit}`;
}
