// The legend: what colours mean, which features and which places are shown.

function showLegend(print, colours) {
  const { mode, table } = colours;
  const scale = document.getElementById('scale');
  const labels = document.getElementById('scale-labels');
  const swatches = document.getElementById('swatches');
  swatches.replaceChildren();
  labels.replaceChildren();
  scale.hidden = labels.hidden = Boolean(mode.names);
  // The features are listed with their switches.
  if (mode.names && !mode.entries) document.getElementById('feature-switches').open = true;
  if (mode.names) {
    for (const { name, colour } of mode.entries?.(print) ?? []) {
      const row = make('span');
      row.append(dot(colour), document.createTextNode(name));
      swatches.append(row);
    }
    return;
  }
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [196, 46];
  scale.width = width * ratio;
  scale.height = height * ratio;
  const context = scale.getContext('2d');
  context.scale(ratio, ratio);
  const most = Math.max(...colours.bins) || 1;
  // Above the colours: how long which of them lasts.
  for (let b = 0; b < 64; b++) {
    context.fillStyle = css(table, (b + 0.5) / 64);
    const bar = 32 * Math.sqrt(colours.bins[b] / most);
    context.fillRect(b * width / 64, 34 - bar, width / 64 + 0.3, bar);
    context.fillRect(b * width / 64, 36, width / 64 + 0.3, 10);
  }
  const label = (value) => make('span', value.toFixed(mode.digits));
  labels.append(label(colours.low), make('span', mode.unit), label(colours.high));
  swatches.append(make('span', `from ${colours.least.toFixed(mode.digits)} to ${colours.most.toFixed(mode.digits)}; height: time, as its root`, 'note'));
}

function dot(colour) {
  const made = make('i');
  made.style.background = colour;
  return made;
}

function switched(id, text, isOn, act) {
  const label = make('label');
  const box = make('input');
  [box.type, box.id, box.checked] = ['checkbox', id, isOn];
  box.addEventListener('change', () => act(box.checked));
  label.append(box, ...text);
  return label;
}

// A switch for each feature, with its time and filament.
function showFeatures(print, state, changed) {
  const list = document.getElementById('feature-list');
  const rows = featureRows(print);
  document.getElementById('feature-switches').hidden = !rows.length;
  for (const row of rows) {
    list.append(switched(`feature-${row.feature}`, [dot(row.colour), make('span', row.name, 'name'), make('span', `${words(row.time)} · ${row.filament.toFixed(2)} m`, 'note')], true,
      (isOn) => {
        if (isOn) state.hiddenFeatures.delete(row.feature); else state.hiddenFeatures.add(row.feature);
        changed();
      }));
  }
}

// A switch for each kind of place that the print has.
function showPlaces(print, state, changed) {
  const list = document.getElementById('place-list');
  for (const [kind, { name, colour }] of Object.entries(PLACE_KINDS)) {
    const count = print.places[kind].length;
    if (!count) continue;
    list.append(switched(`place-${kind}`, [dot(colour), `${name} `, make('span', String(count), 'note')], false, (isOn) => {
      if (isOn) state.places.add(kind); else state.places.delete(kind);
      changed();
    }));
  }
  document.getElementById('place-switches').hidden = !list.childElementCount;
}

// The slider of the moves of one layer.
function movesOn(slider, text, print, go) {
  const { c, layerStart } = print;
  let layer = -1;
  const span = (of) => [layerStart[of] + 1, Math.max(layerStart[of] + 1, layerStart[of + 1])];
  slider.addEventListener('input', () => go(c.time[span(layer)[0] + Number(slider.value)]));
  return {
    show(now) {
      layer = c.layer[now.i];
      const [first, last] = span(layer);
      slider.max = String(last - first);
      slider.value = String(Math.max(0, now.i - first));
      text.textContent = `layer ${layer + 1}: ${Math.max(1, now.i - first + 1)} of ${last - first + 1}`;
    },
  };
}
