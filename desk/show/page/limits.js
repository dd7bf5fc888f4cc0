// The limits that hold the speed down, by the rules that planned the print.

const LIMIT_COLOURS = {
  'asked speed': '#3fb27f', 'largest speed': '#2c63c8', 'largest speed of X': '#4f8fe8', 'largest speed of Y': '#7fb2f2', 'largest speed of Z': '#1799b5',
  'largest speed of the filament': '#58c4f2', acceleration: '#f2a33a', 'acceleration of X': '#e0c341', 'acceleration of Y': '#c8b273', 'acceleration of Z': '#a58262',
  'acceleration of the filament': '#f2c6a0', corner: '#e3304a', 'corner of the filament': '#d85f95', 'short move': '#b06fd8', 'minimum cruise ratio': '#6f7fe0', rest: '#7d8794',
};
const NO_LIMIT_COLOUR = '#506070';

// The number of a limit is its place in the print's list, from 1.
function limitColours({ job }) {
  return [NO_LIMIT_COLOUR, ...(job.rules?.limits ?? []).map((name) => LIMIT_COLOURS[name] ?? NO_LIMIT_COLOUR)];
}

function limitName({ job, c }, i) {
  return job.rules?.limits[(c.limit?.[i] ?? 0) - 1] ?? '';
}

MODES.limit = { name: 'What limits the speed', names: true, table: (print) => palette(limitColours(print), false), entries: limitEntries,
  of: ({ c }, i) => [c.limit[i], c.limit[i]] };

// Names and colours of the limits that hold where something is to be seen, the longest time first.
function limitEntries(print) {
  const { c, n, main, job } = print;
  const times = new Map();
  for (let i = 1; i < n; i++) if (c.kind[i] === main && c.limit[i]) times.set(c.limit[i], (times.get(c.limit[i]) ?? 0) + c.time[i] - c.time[i - 1]);
  const colours = limitColours(print);
  return [...times].sort((a, b) => b[1] - a[1]).map(([limit, time]) => ({ name: `${job.rules.limits[limit - 1]}, ${words(time)}`, colour: colours[limit] }));
}

// Modes of what the print does not have: limits without rules that name them; steps, filters, and
// the nozzle's pressure by rules that make no steps.
function chooseModes({ c, job }) {
  const gone = [...(c.limit ? [] : ['limit']), ...(job.rules ? ['pressure', 'deviation', 'slowed'] : [])];
  for (const key of gone) delete MODES[key];
}

// A table of the time that each limit held.
function showLimits(print, box) {
  const { job } = print;
  const rows = (job.rules?.times ?? []).filter((row) => row.seconds > 0);
  if (!rows.length) return;
  const all = rows.reduce((sum, row) => sum + row.seconds, 0);
  const colours = limitColours(print);
  const table = make('table');
  table.append(make('caption', `What limits the speed, by the rules of ${job.rules.name}`));
  for (const { limit, seconds, moves } of rows) {
    const row = make('tr');
    const name = make('td');
    name.append(dot(colours[job.rules.limits.indexOf(limit) + 1]), document.createTextNode(` ${limit}`));
    row.append(name, make('td', words(seconds)), make('td', `${(100 * seconds / all).toFixed(1)} %`));
    row.title = `most of the time of ${moves.toLocaleString('en')} moves`;
    table.append(row);
  }
  box.append(table);
}
