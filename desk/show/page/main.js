// The page's state, its controls, and when it is drawn.

const byId = (id) => document.getElementById(id);

function themeNow() {
  const style = getComputedStyle(document.documentElement);
  const get = (name) => style.getPropertyValue(name).trim();
  const grid = rgb(get('--grid'));
  return { text: get('--text'), faint: get('--faint'), line: get('--line'), speed: get('--speed'), flow: get('--flow'), nozzle: get('--nozzle'),
    bed: get('--bed'), rest: get('--rest'), chamber: get('--chamber'), warning: get('--warning'), accent: get('--accent'), grid: [...grid, Number(get('--grid-alpha'))], gridCss: get('--grid'),
    kinds: ['--k-travel', '--k-print', '--k-retract', '--k-prime', '--k-homing', '--k-heating', '--k-wait'].map(get) };
}

async function main() {
  const print = await load();
  chooseModes(print);
  const { c, n } = print;
  const end = c.time[n - 1];
  let theme = themeNow();
  const state = { time: end, playing: false, factor: 60, low: 0, high: print.layers - 1, mode: 'speed', hovered: null, last: 0, isSlow: false, hiddenFeatures: new Set(), places: new Set(), touched: -1000, isTouched: false, moved: 0, rest: 0, isRestShown: false };

  const canvas = byId('space');
  const overlay = byId('overlay');
  const flatOnly = location.hash.includes('flat');
  const space = (!flatOnly && spaceOn(canvas, print)) || flatOn(canvas, print);
  state.isSlow = Boolean(space.isSlow);
  const charts = chartsOn(byId('charts'), print);
  let colours = null;
  const widths = new Float32Array(print.path.time.length);
  let box = null;

  const jump = (time) => { goTo(time); flash(); };
  const jumpToLine = (line) => jump(timeOfLine(print, line));
  const source = sourceOn(byId('source'), print, jumpToLine);
  byId('travels').checked = print.main === KIND.travel;
  showHeader(print);
  showShares(print, theme);
  showAbout(print, space.name);
  showFindings(print, jump);
  showFeatures(print, state, setWidths);
  showPlaces(print, state, changed);
  showRest(print, state, changed);
  byId('loading').remove();

  // What there is to see, without a line at the bed's edge that primes the nozzle if there is more
  // than one layer.
  function bounds() {
    const afterFirst = print.executedLayers > 2 && print.main === KIND.print ? print.layerStart[1] + 1 : 0;
    const found = extentWithRest(print, extentOf(print, Math.max(print.partStart, afterFirst)) ?? extentOf(print, 1));
    if (!found) return [[0, 0, 0], [100, 100, 50]];
    found[0][2] = Math.min(found[0][2], 0);
    return found;
  }

  function setWidths() {
    const isTravel = byId('travels').checked;
    for (let i = 1; i < n; i++) {
      const kind = c.kind[i];
      if (kind === KIND.print) widths[i] = state.hiddenFeatures.has(c.feature[i]) ? -1 : drawnWidth(print, i);
      else widths[i] = isTravel && (kind === KIND.travel || kind === KIND.homing) ? 0 : -1;
    }
    setRestWidths(print, widths);
    space.widths(widths);
    changed();
  }

  function setMode(mode) {
    state.mode = mode;
    byId('mode').value = mode;
    colours = coloured(print, mode);
    space.colour(colours);
    showLegend(print, colours);
    changed();
  }

  function range() {
    const first = Math.max(1, print.layerStart[state.low] + 1);
    const last = print.layerStart[state.high + 1] + 1;
    const now = stateAt(print, state.time);
    const begun = Math.min(last, now.i);
    const started = now.i >= first && now.i < last && now.share < 1 ? { i: now.i, position: now.position, share: now.share } : null;
    const rest = state.isRestShown ? restBetween(print.rest, state.low, state.high) : [n, n];
    return { first, last: started ? begun : Math.min(last, now.i + 1), started, rest, now };
  }

  let isDue = false;
  let drawing = 0;
  const drawn = { frames: 0, quick: 0, isWhole: false };
  let chartsDrawn = '';
  const chart = byId('charts');
  // The picture moves.
  function touched() {
    [state.touched, state.isTouched] = [performance.now(), true];
    changed();
  }

  // A frame begins when of the pictures before it all but one are drawn: a slow machine would
  // collect them, and answer late.
  function changed() {
    if (isDue) return;
    isDue = true;
    if (drawing < 2) requestAnimationFrame(frame);
  }

  // What to call when a picture is drawn.
  function startDrawing() {
    drawing += 1;
    return () => {
      drawing -= 1;
      if (isDue && drawing === 1) requestAnimationFrame(frame);
    };
  }

  function frame(at) {
    isDue = false;
    if (state.playing) {
      const passed = state.last ? Math.min(0.25, (at - state.last) / 1000) : 0;
      state.last = at;
      state.time = Math.min(end, state.time + passed * state.factor);
      if (state.time >= end) stop();
      showTime();
    }
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const { clientWidth: width, clientHeight: height } = canvas;
    setPixels(overlay, ratio);
    const shown = range();
    const { now } = shown;
    // A slow machine draws a coarse picture while something moves, and the whole one when it rests,
    // some parts in each frame.
    const isMoving = state.playing || state.isTouched;
    const isQuick = state.isSlow && (state.isTouched || performance.now() - state.touched < 250);
    state.isTouched = false;
    let isComplete = false;
    if (!isQuick) isComplete = space.whole(shown, theme, ratio, { isSlow: state.isSlow, isPlaying: state.playing }, startDrawing());
    if (isQuick || state.playing && !isComplete) {
      space.coarse(shown, theme, ratio, startDrawing());
      drawn.quick += 1;
    }
    drawn.isWhole = isComplete;
    // Two whole pictures in a row that took long, while something moved.
    if (isMoving && state.moved && !isQuick && at - state.moved > 45) state.isSlow = true;
    state.moved = isMoving ? at : 0;
    clearTimeout(state.rest);
    if (isQuick && !state.playing) state.rest = setTimeout(changed, 280);
    if (!isQuick && !isComplete) changed();
    drawOverlay(width, height, ratio, now);
    showHere(print, state.hovered ? hoveredState() : now, source);
    moves.show(now);
    const chartsNow = [state.time, chart.clientWidth, chart.clientHeight, theme.text].join();
    if (chartsNow !== chartsDrawn) charts.draw(state.time, theme);
    chartsDrawn = chartsNow;
    drawn.frames += 1;
    if (state.playing) changed();
  }

  function hoveredState() {
    return stateAt(print, state.hovered.time);
  }

  function drawOverlay(width, height, ratio, now) {
    const context = overlay.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const place = projection(width, height);
    const { first, last } = range();
    drawPlaces(context, print, state.places, first, last, place);
    const head = place(...now.position);
    if (head && state.time < end) {
      const [x, y] = head;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x - 7, y - 16);
      context.lineTo(x - 7, y - 26);
      context.lineTo(x + 7, y - 26);
      context.lineTo(x + 7, y - 16);
      context.closePath();
      context.fillStyle = theme.accent;
      context.globalAlpha = 0.92;
      context.fill();
      context.globalAlpha = 1;
      context.lineWidth = 1.5;
      context.strokeStyle = '#fff';
      context.stroke();
    }
    if (state.flash > 0 && head) {
      context.beginPath();
      context.arc(head[0], head[1], 10 + 30 * state.flash, 0, 7);
      context.strokeStyle = theme.accent;
      context.lineWidth = 3;
      context.globalAlpha = state.flash;
      context.stroke();
      context.globalAlpha = 1;
    }
    if (state.hovered) {
      const { i } = state.hovered;
      const { path } = print;
      const a = place(path.x[i - 1], path.y[i - 1], path.z[i - 1]);
      const b = place(path.x[i], path.y[i], path.z[i]);
      if (a && b) {
        for (const [colour, line] of [['#000', 6], ['#fff', 3]]) {
          context.strokeStyle = colour;
          context.lineWidth = line;
          context.lineCap = 'round';
          context.beginPath();
          context.moveTo(a[0], a[1]);
          context.lineTo(b[0], b[1]);
          context.stroke();
        }
      }
    }
  }

  function flash() {
    state.flash = 1;
    const step = () => {
      state.flash = Math.max(0, state.flash - 0.04);
      changed();
      if (state.flash > 0) requestAnimationFrame(step);
    };
    step();
  }

  // Stops, and shows a time with its layer.
  function goTo(time) {
    stop();
    keepLayersAround(time);
    setTime(time);
  }

  function setTime(time) {
    state.time = Math.min(end, Math.max(0, time));
    showTime();
    changed();
  }

  function showTime() {
    byId('time').value = String(end > 0 ? state.time / end : 0);
    byId('clock').textContent = `${clock(state.time)} / ${clock(end)}`;
  }

  function play() {
    if (state.time >= end) state.time = 0;
    [state.playing, state.last] = [true, 0];
    showPlay();
    changed();
  }

  function stop() {
    state.playing = false;
    showPlay();
  }

  function showPlay() {
    byId('play').classList.toggle('playing', state.playing);
    byId('play').setAttribute('aria-label', state.playing ? 'Pause' : 'Play');
  }

  function setFactor(power) {
    state.factor = 10 ** power;
    byId('factor').value = String(power);
    const shown = state.factor < 10 ? state.factor.toFixed(1) : String(Math.round(state.factor));
    byId('factor-text').textContent = `${shown} ×`;
  }

  // The end of the next move, or of the one before.
  function step(by) {
    stop();
    let { i } = stateAt(print, state.time);
    const line = c.line[i];
    if (by > 0) {
      while (i < n - 1 && (c.line[i] === line || c.time[i] <= state.time)) i++;
      while (i < n - 1 && c.line[i + 1] === c.line[i]) i++;
    } else {
      while (i > 0 && (c.line[i] === line || c.time[i] >= state.time)) i--;
    }
    keepLayersAround(c.time[i]);
    setTime(c.time[i]);
  }

  function setLayers(low, high) {
    const top = print.layers - 1;
    state.high = Math.min(top, Math.max(0, high));
    state.low = Math.min(state.high, Math.max(0, low));
    byId('layer-low').value = String(state.low);
    byId('layer-high').value = String(state.high);
    const text = (layer) => `${layer + 1} · ${print.layerZ[layer].toFixed(2)} mm`;
    byId('layer-high-text').textContent = text(state.high);
    byId('layers-name').textContent = state.low === state.high ? `Layer ${state.high + 1}` : `${state.low + 1} – ${state.high + 1}`;
    byId('layer-low-text').textContent = state.low === state.high ? '' : text(state.low);
    changed();
  }

  // Opens the shown layers so that a time lies in them.
  function keepLayersAround(time) {
    const layer = c.layer[stateAt(print, time).i];
    if (byId('single').checked) setLayers(layer, layer);
    else if (layer < state.low || layer > state.high) setLayers(Math.min(layer, state.low), Math.max(layer, state.high));
  }

  // The visible part of the path nearest to a pixel; of those the one nearest to the eye.
  function pick(px, py) {
    const { first, last, rest } = range();
    const { path } = print;
    const place = projection(canvas.clientWidth, canvas.clientHeight);
    let best = null;
    let a = null;
    let aIndex = -1;
    const look = (i) => {
      if (widths[i] < -0.5) return;
      if (aIndex !== i - 1) a = place(path.x[i - 1], path.y[i - 1], path.z[i - 1]);
      const b = place(path.x[i], path.y[i], path.z[i]);
      const from = a;
      [a, aIndex] = [b, i];
      if (!from || !b) return;
      const [dx, dy] = [b[0] - from[0], b[1] - from[1]];
      const squared = dx * dx + dy * dy;
      const along = squared > 0 ? Math.min(1, Math.max(0, ((px - from[0]) * dx + (py - from[1]) * dy) / squared)) : 0;
      const off = Math.hypot(px - from[0] - along * dx, py - from[1] - along * dy);
      const depth = from[2] + (b[2] - from[2]) * along;
      const reach = Math.max(4, widths[i] * canvas.clientHeight / (4 * FIELD * depth));
      if (off > reach) return;
      if (!best || depth < best.depth - 0.2 || (depth < best.depth + 0.2 && off < best.off)) best = { i, along, depth, off };
    };
    for (let i = first; i < last; i++) look(i);
    for (let i = rest[0]; i < rest[1]; i++) look(i);
    if (!best) return null;
    if (best.i >= n) return { i: best.i, time: end };
    const duration = c.time[best.i] - c.time[best.i - 1];
    return { i: best.i, time: c.time[best.i - 1] + Math.max(1e-6, best.along * duration) };
  }

  function hover(event) {
    const bounds = canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - bounds.left, event.clientY - bounds.top];
    state.hovered = pick(x, y);
    const tip = byId('tip');
    tip.hidden = !state.hovered;
    if (state.hovered) {
      const { path } = print;
      const at = hoveredState();
      const i = state.hovered.i >= n ? state.hovered.i : at.i;
      const [from, to] = [colours.values[2 * i], colours.values[2 * i + 1]];
      const value = colours.mode.names ? '' : formatted(colours.mode, from + (to - from) * at.share);
      const values = i >= n ? ['not executed'] : [value, `${at.speed.toFixed(0)} mm/s`];
      const text = print.source.line(path.line[i]);
      tip.replaceChildren(make('b', `line ${path.line[i]}`), make('code', text === null ? '' : text.slice(0, 60)),
        make('span', [...values, path.kind[i] === KIND.print ? print.features[path.feature[i]] : KIND_NAMES[path.kind[i]]].filter(Boolean).join(' · ')));
      const [tipWidth, tipHeight] = [tip.offsetWidth, tip.offsetHeight];
      tip.style.left = `${Math.min(bounds.width - tipWidth - 6, x + 14)}px`;
      tip.style.top = `${y + 18 + tipHeight > bounds.height ? y - tipHeight - 10 : y + 18}px`;
    }
    changed();
  }

  // Controls.
  const moves = movesOn(byId('move'), byId('move-text'), print, (time) => { stop(); touched(); setTime(time); });
  byId('goto').max = String(print.source.count || c.line[n - 1]);
  byId('goto').addEventListener('change', (event) => {
    const line = Math.round(Number(event.target.value));
    if (line >= 1) jumpToLine(line);
  });
  for (const [key, mode] of Object.entries(MODES)) byId('mode').append(new Option(mode.name, key));
  byId('mode').addEventListener('change', (event) => setMode(event.target.value));
  byId('travels').addEventListener('change', setWidths);
  byId('single').addEventListener('change', (event) => {
    const layer = event.target.checked ? c.layer[stateAt(print, state.time).i] : -1;
    if (layer >= 0) setLayers(Math.min(layer, state.high), Math.min(layer, state.high)); else setLayers(0, state.high);
  });
  byId('play').addEventListener('click', () => (state.playing ? stop() : play()));
  byId('back').addEventListener('click', () => step(-1));
  byId('forward').addEventListener('click', () => step(1));
  byId('time').addEventListener('input', (event) => { stop(); touched(); setTime(Number(event.target.value) * end); });
  byId('factor').addEventListener('input', (event) => setFactor(Number(event.target.value)));
  for (const [id, isHigh] of [['layer-low', false], ['layer-high', true]]) {
    byId(id).max = String(print.layers - 1);
    byId(id).addEventListener('input', (event) => {
      const layer = Number(event.target.value);
      if (byId('single').checked) setLayers(layer, layer);
      else if (isHigh) setLayers(Math.min(state.low, layer), layer);
      else setLayers(layer, Math.max(state.high, layer));
    });
  }
  byId('layers').hidden = print.layers < 2;
  for (const button of document.querySelectorAll('[data-view]')) {
    button.addEventListener('click', () => { look(box, button.dataset.view); changed(); });
  }

  pointersOn({ canvas, chart, tip: byId('tip'), state, charts, hover, changed, touched, goTo, stop, setTime });
  keysOn({ state, box: () => box, step, layerStep, play, stop, setMode, touched });
  function layerStep(by) {
    if (byId('single').checked) setLayers(state.high + by, state.high + by); else setLayers(state.low, state.high + by);
  }

  new ResizeObserver(changed).observe(canvas);
  new ResizeObserver(changed).observe(chart);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { theme = themeNow(); changed(); });

  // On a phone the panels leave the part free.
  if (matchMedia('(max-width: 820px)').matches) byId('legend').open = byId('layers').open = false;
  box = bounds();
  look(box, 'all');
  setFactor(Math.min(4, Math.max(0, Math.log10(Math.max(1, end / 45)))));
  setWidths();
  setMode('speed');
  setLayers(0, print.layers - 1);
  setTime(end);
  showPlay();
  touched();
  // For tests and the curious.
  window.ferrostep = { print, state, camera, stateAt: (time) => stateAt(print, time), drawn, detail: space.detail, draws: space.name, setTime, pick, touched, MODES, isUpToDate: () => !isDue };
  document.documentElement.dataset.ready = 'true';
}

main().catch((error) => {
  const note = document.getElementById('loading') ?? document.body.appendChild(make('p'));
  note.textContent = `This page could not be drawn: ${error.message}. It needs a browser of 2023 or newer.`;
  console.error(error);
});
