// Features: their colours as slicers have them, whatever a slicer calls them.

const FAMILY_COLOURS = {
  outer: '#ff7d38', inner: '#ffd43b', overhang: '#2a3cff', infill: '#b03029', solid: '#9654cc', top: '#f04040', bottom: '#665cc7', ironing: '#ff8c69',
  bridge: '#4d80ba', gap: '#e8e8ee', skirt: '#00876e', raft: '#0f6b63', support: '#12d312', contact: '#008000', tower: '#b3e3ab', custom: '#5ed194', none: '#7d8794',
};

// The first that fits counts.
const FAMILIES = [
  ['overhang', /overhang/], ['outer', /outer|external|shell|^perimeter path$/], ['contact', /support.*(interface|transition|contact)|dense support/],
  ['skirt', /skirt|brim|apron/], ['raft', /raft/], ['support', /support/], ['tower', /tower|pillar|ooze|prime|wipe/], ['ironing', /iron/], ['bridge', /bridge/],
  ['gap', /gap|thin wall|single extrusion/], ['top', /\btop\b|^crown/], ['bottom', /bottom/], ['solid', /solid|^skin$/], ['infill', /infill|^fill$|sparse/],
  ['inner', /inner|perimeter|wall|loop/], ['custom', /custom|start|end gcode/],
];

// Colours of features that belong to no family, or to one that another feature of the file has
// already.
const OTHER_COLOURS = ['#39b7c9', '#d85f95', '#8fb84a', '#a58262', '#6f7fe0', '#e0a0d8', '#3f6f3a', '#c8b273', '#7a2f5f', '#58c4f2', '#d4572a', '#4a4e8c', '#9bd8c0',
  '#b58be8', '#8c3b3b', '#2f8fa3', '#f2c6a0', '#6d8f1f', '#c43fa8', '#506070'];

function familyOf(name) {
  const plain = name.toLowerCase().replace(/[-_]+/g, ' ').trim();
  if (!plain) return 'none';
  return FAMILIES.find(([, form]) => form.test(plain))?.[0] ?? null;
}

// A colour for each name: that of its family, and no two alike.
function featureColours(names) {
  const used = new Set();
  let next = 0;
  const free = () => {
    for (let tried = 0; tried < OTHER_COLOURS.length; tried++) {
      const colour = OTHER_COLOURS[next++ % OTHER_COLOURS.length];
      if (!used.has(colour)) return colour;
    }
    // More features than colours: hues around the circle.
    return hueColour(next * 0.381966 % 1);
  };
  const own = names.map((name) => {
    const colour = FAMILY_COLOURS[familyOf(name)];
    if (!colour || used.has(colour)) return null;
    used.add(colour);
    return colour;
  });
  return own.map((colour) => {
    const chosen = colour ?? free();
    used.add(chosen);
    return chosen;
  });
}

function hueColour(hue) {
  const channel = (shift) => Math.round(255 * (0.55 + 0.35 * Math.cos(2 * Math.PI * (hue + shift))));
  return '#' + [0, 1 / 3, 2 / 3].map((shift) => channel(shift).toString(16).padStart(2, '0')).join('');
}

// Rows of the printed features: name, colour, time and filament.
function featureRows({ features, totals, job, featureColour }) {
  return totals.features.map((share, k) => ({ feature: k, name: features[k] || 'printing', colour: featureColour[k] ?? FAMILY_COLOURS.none, time: share.time_s,
    filament: share.volume_mm3 / job.filament_mm2 / 1000, share })).filter((row) => row.time > 0);
}
