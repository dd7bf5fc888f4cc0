// The panels of words and numbers.

function showHeader(print) {
  const { job } = print;
  document.getElementById('title').textContent = job.file;
  document.getElementById('subtitle').textContent =
    job.rules ? `on ${job.profile}, as the rules of ${job.rules.name} plan it; by Ferrostep ${job.version}`
      : `on ${job.profile}, every step of it executed by Ferrostep ${job.version}`;
  const figures = document.getElementById('figures');
  const figure = (name, value, note, tone) => {
    const item = make('div', undefined, tone);
    item.append(make('dt', name), make('dd', value));
    if (note) item.append(make('dd', note, 'note'));
    figures.append(item);
  };
  const heating = heatingBefore(print, job.print_time_s);
  figure('print time', words(job.print_time_s), heating > 0.5 ? `${words(heating)} of it heating` : '');
  if (job.slicer_time_s) figure('the slicer says', words(job.slicer_time_s), slicerNote(print) ?? '');
  figure('filament', `${(job.filament_mm / 1000).toFixed(2)} m`, `${(job.filament_mm * job.filament_mm2 / 1000).toFixed(1)} cm³`);
  if (print.hasHeight) figure('layers', String(print.executedLayers), `${print.height.toFixed(2)} mm`);
  figure('moves', job.moves.toLocaleString('en'));
}

function showFindings(print, jump) {
  const list = document.getElementById('finding-list');
  const { findings } = print.job;
  const marks = { stop: 'Stop', warning: 'Look', note: 'Note', extreme: 'Most', place: 'Place' };
  for (const finding of findings) {
    const item = make('li', undefined, finding.weight);
    const time = finding.time_s ?? timeOfLine(print, finding.line);
    const body = make(time === null ? 'div' : 'button');
    body.append(make('span', marks[finding.weight], 'mark'), make('span', finding.text, 'text'));
    if (time !== null) {
      body.type = 'button';
      body.append(make('span', finding.line ? `line ${finding.line}, ${clock(time)}` : clock(time), 'where'));
      body.addEventListener('click', () => jump(time, finding.line));
    }
    item.append(body);
    list.append(item);
  }
  if (!findings.some((finding) => finding.weight === 'stop' || finding.weight === 'warning')) {
    list.prepend(make('li', 'Nothing to worry about was found.', 'good'));
  }
}

function showShares(print, theme) {
  const { totals, job } = print;
  const box = document.getElementById('share-list');
  const all = totals.kinds.reduce((sum, kind) => sum + kind.time_s, 0) || 1;
  const rows = featureRows(print).map(({ name, colour, time, filament, share }) => ({ name, colour, time,
    note: share.volume_mm3 > 0 ? `${filament.toFixed(2)} m of filament, ${(share.path_mm / Math.max(share.time_s, 1e-9)).toFixed(0)} mm/s on average` : '' }));
  const other = [[KIND.travel, 'Travels'], [KIND.retract, 'Retractions'], [KIND.prime, 'Filament back'], [KIND.heating, 'Heating'], [KIND.homing, 'Homing'], [KIND.wait, 'Other waits']];
  for (const [kind, name] of other) {
    const share = totals.kinds[kind];
    const notes = { [KIND.travel]: `${(share.path_mm / 1000).toFixed(1)} m`, [KIND.retract]: `${totals.retractions} of them` };
    rows.push({ name, time: share.time_s, colour: theme.kinds[kind], note: notes[kind] ?? '' });
  }
  const shown = rows.filter((row) => row.time > 0.0005 * all).sort((a, b) => b.time - a.time);
  const largest = shown.length ? shown[0].time : 1;
  for (const row of shown) {
    const item = make('div', undefined, 'share');
    item.append(make('span', row.name, 'name'), make('span', `${words(row.time)}`, 'time'), make('span', `${(100 * row.time / all).toFixed(1)} %`, 'part'));
    const bar = make('span', undefined, 'bar');
    const fill = make('i');
    fill.style.width = `${100 * row.time / largest}%`;
    fill.style.background = row.colour;
    bar.append(fill);
    item.append(bar);
    if (row.note) item.title = row.note;
    box.append(item);
  }
  const chances = document.getElementById('chances');
  const say = (text) => chances.append(make('p', text));
  const motion = totals.kinds[KIND.print].time_s + totals.kinds[KIND.travel].time_s;
  if (motion > 0 && totals.slower_s > 0) {
    say(`Moves take ${words(totals.slower_s)} longer (${(100 * totals.slower_s / all).toFixed(1)} %) than at the speeds that their lines ask for: ramps, corners and the machine's limits. Nothing that is done to acceleration wins more than that.`);
  }
  if (job.chances.length && job.print_time_s > 0) {
    const table = make('table');
    table.append(make('caption', 'What could be won'));
    for (const [name, time] of job.chances) {
      const row = make('tr');
      const won = 100 * (job.print_time_s - time) / job.print_time_s;
      row.append(make('td', name), make('td', words(time)), make('td', `${won >= 0 ? '−' : '+'}${Math.abs(won).toFixed(1)} %`));
      table.append(row);
    }
    chances.append(table);
  }
  showLimits(print, chances);
}

function showAbout(print, how) {
  const box = document.getElementById('about-text');
  const say = (text) => box.append(make('p', text));
  if (print.job.rules) {
    say(`The moves are planned by the rules of ${print.job.rules.name} with the limits of ${print.job.profile}: the speeds and times of that firmware. Homing takes this firmware's time. No steps are made: what depends on them (input shaping, distance from the path, pressure in the nozzle, moves slowed for the board, what other limits would win) is left out.`);
  } else {
    say('The print ran on a virtual board with the code that runs on the printer\'s. The path, its speeds and times are those of the motors\' steps, sampled each millisecond: what the firmware does, not what the file asks for.');
    say(`Pressure in the nozzle is a model: filament compresses, and flows out with a time constant of ${print.job.nozzle_time_constant_s} s.`);
  }
  if (print.rest.count) say('The job stops: what is grey was not executed. It is drawn as the lines ask for, and counts in no time, length or filament.');
  if (print.left_out) {
    say(`This job is too large for a page: ${print.left_out.toLocaleString('en')} of its points were left out. Every layer is drawn within ${print.tolerance_mm.toFixed(2)} mm of its path; sums, times and extremes are of all points.`);
  }
  const extent = extentOf(print, print.partStart);
  if (extent) {
    const [low, high] = extent.map((ends) => ends.map((mm) => mm.toFixed(1)));
    say(`${print.main === KIND.print ? 'The part' : 'The path'} lies within X${low[0]} to ${high[0]}, Y${low[1]} to ${high[1]}, Z${low[2]} to ${high[2]} mm.`);
  }
  if (print.text_is_cut) say('The G-code of later lines was left out of the page.');
  if (!print.has_layers) say('The file marks no layers: they are told by the height of printed moves.');
  say(`Drawn with ${how}. This page fetches nothing from anywhere.`);
  const keys = make('table');
  keys.append(make('caption', 'Keys'));
  for (const [key, what] of KEYS) {
    const row = make('tr');
    row.append(make('td', key), make('td', what));
    keys.append(row);
  }
  box.append(keys);
}

// The place where the nozzle is, in numbers, with its lines.
function showHere(print, state, source) {
  const { c } = print;
  const { i } = state;
  const now = document.getElementById('now');
  const rows = [
    ['doing', c.kind[i] === KIND.print && print.features[c.feature[i]] ? print.features[c.feature[i]] : KIND_NAMES[c.kind[i]]],
    ['line', String(c.line[i])],
    ['layer', `${c.layer[i] + 1} of ${print.layers}`],
    ['place', state.position.map((v, k) => 'XYZ'[k] + v.toFixed(2)).join(' ')],
    ['speed', `${state.speed.toFixed(1)} mm/s` + (c.feed[i] > 0 && c.kind[i] < 2 ? ` of ${c.feed[i].toFixed(0)}` : '')],
    ['change', `${state.acceleration.toFixed(0)} mm/s²`],
    ['flow', `${state.flow.toFixed(2)} mm³/s`],
    ...(print.job.rules ? [['limit', limitName(print, i)]] : [
      ['pressure', `${state.pressure.toFixed(3)} mm³`],
      ['off path', `${state.deviation.toFixed(3)} mm` + (c.slowed[i] ? ', slowed for the board' : '')],
    ]),
  ];
  for (const heater of ['nozzle', 'bed', 'chamber']) {
    const target = state[`${heater}Target`];
    if (heater in state) rows.push([heater, `${state[heater].toFixed(1)} °C` + (target ? ` of ${target.toFixed(0)}` : '')]);
  }
  if (now.childElementCount !== 2 * rows.length) now.replaceChildren(...rows.flatMap(() => [make('dt'), make('dd')]));
  rows.forEach(([name, value], k) => {
    if (now.children[2 * k].textContent !== name) now.children[2 * k].textContent = name;
    if (now.children[2 * k + 1].textContent !== value) now.children[2 * k + 1].textContent = value;
  });
  source.show(c.line[i]);
}
