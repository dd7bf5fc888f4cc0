// Temperatures, speed and flow against time, and below them what the printer does.

const LABELS = 46;
const AXIS = 16;

function chartsOn(canvas, print) {
  const shown = canvas.getContext('2d');
  // All but the cursor, which moves more often.
  const still = document.createElement('canvas');
  const context = still.getContext('2d');
  let stillOf = '';
  const { c, n, job, partStart } = print;
  const end = c.time[n - 1] || 1;
  let bins = null;

  // The largest and the mean value in each pixel's time: a spike of a millisecond is seen.
  function binned(count) {
    const made = { count, speed: new Float32Array(count), speedMean: new Float32Array(count), flow: new Float32Array(count),
      flowMean: new Float32Array(count), kinds: new Float32Array(count * 7) };
    const width = end / count;
    for (let i = 1; i < n; i++) {
      const [from, to] = [c.time[i - 1], c.time[i]];
      const speed = c.kind[i] < 2 ? Math.max(c.speed[i - 1], c.speed[i]) : 0;
      const mean = c.kind[i] < 2 ? (c.speed[i - 1] + c.speed[i]) / 2 : 0;
      const isPrint = c.kind[i] === KIND.print;
      const flow = isPrint ? Math.max(c.speed[i - 1], c.speed[i]) * c.bead[i] : 0;
      const last = Math.min(count - 1, Math.floor(to / width));
      for (let b = Math.min(count - 1, Math.floor(from / width)); b <= last; b++) {
        const time = Math.min(to, (b + 1) * width) - Math.max(from, b * width);
        if (time <= 0) continue;
        made.speed[b] = Math.max(made.speed[b], speed);
        made.flow[b] = Math.max(made.flow[b], flow);
        made.speedMean[b] += mean * time / width;
        if (isPrint) made.flowMean[b] += mean * c.bead[i] * time / width;
        made.kinds[b * 7 + c.kind[i]] += time / width;
      }
    }
    return made;
  }

  return {
    timeAt(x) { return Math.min(end, Math.max(0, (x - LABELS) / (canvas.clientWidth - LABELS - 8) * end)); },
    draw(time, theme) {
      const ratio = window.devicePixelRatio || 1;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight];
      setPixels(canvas, ratio);
      const plot = Math.max(50, width - LABELS - 8);
      const of = [width, height, ratio, theme.text].join();
      if (of !== stillOf) drawStill(width, height, ratio, plot, theme);
      stillOf = of;
      shown.setTransform(1, 0, 0, 1, 0, 0);
      shown.clearRect(0, 0, canvas.width, canvas.height);
      if (still.width && still.height) shown.drawImage(still, 0, 0);
      shown.setTransform(ratio, 0, 0, ratio, 0, 0);
      shown.fillStyle = theme.text;
      shown.fillRect(Math.round(LABELS + time / end * plot) - 0.5, 2, 1.5, height - AXIS - 4);
    },
  };

  function drawStill(width, height, ratio, plot, theme) {
    [still.width, still.height] = [canvas.width, canvas.height];
    if (!bins || bins.count !== Math.round(plot)) bins = binned(Math.round(plot));
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = '11px system-ui, sans-serif';
    context.textBaseline = 'middle';
    const x = (t) => LABELS + t / end * plot;
    const band = 10;
    const row = (height - band - AXIS - 6) / 3;
    const top = (k) => 3 + k * row;
    // A line that primes the nozzle does not set the scales.
    const ofPart = (values) => values.subarray(Math.min(values.length - 1, Math.ceil(c.time[partStart - 1] / end * bins.count)));
    const rows = [
      ['°C', Math.max(50, ...job_targets(print))],
      ['mm/s', niceTop(maximum(ofPart(bins.speed)))],
      ['mm³/s', niceTop(maximum(ofPart(bins.flow)))],
    ];
    rows.forEach(([unit, most], k) => {
      context.strokeStyle = theme.line;
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(LABELS, Math.round(top(k) + row - 3) + 0.5);
      context.lineTo(LABELS + plot, Math.round(top(k) + row - 3) + 0.5);
      context.stroke();
      context.fillStyle = theme.faint;
      context.textAlign = 'right';
      context.fillText(String(most), LABELS - 6, top(k) + 7);
      context.fillText(unit, LABELS - 6, top(k) + row - 9);
    });
    const y = (k, value) => top(k) + row - 3 - Math.min(1, Math.max(0, value / rows[k][1])) * (row - 7);
    const filled = (k, values, colour, alpha) => {
      context.fillStyle = colour;
      context.globalAlpha = alpha;
      for (let b = 0; b < bins.count; b++) {
        if (values[b] > 0) context.fillRect(LABELS + b, y(k, values[b]), 1, y(k, 0) - y(k, values[b]));
      }
      context.globalAlpha = 1;
    };
    filled(1, bins.speed, theme.speed, 0.35);
    filled(1, bins.speedMean, theme.speed, 0.9);
    filled(2, bins.flow, theme.flow, 0.35);
    filled(2, bins.flowMean, theme.flow, 0.9);
    const limit = job.max_flow_mm3_per_s;
    if (limit && limit < rows[2][1]) {
      context.strokeStyle = theme.warning;
      context.setLineDash([4, 3]);
      context.beginPath();
      context.moveTo(LABELS, y(2, limit));
      context.lineTo(LABELS + plot, y(2, limit));
      context.stroke();
      context.setLineDash([]);
    }
    const curve = (values, colour, isDashed) => {
      context.strokeStyle = colour;
      context.lineWidth = isDashed ? 1 : 1.6;
      context.setLineDash(isDashed ? [3, 3] : []);
      context.beginPath();
      for (let h = 0; h < values.length; h++) {
        const [px, py] = [x(c.heatTime[h]), y(0, values[h])];
        if (isDashed && h > 0) context.lineTo(px, y(0, values[h - 1]));
        if (h === 0) context.moveTo(px, py); else context.lineTo(px, py);
      }
      context.stroke();
      context.setLineDash([]);
    };
    if (c.chamber) {
      curve(c.chamberTarget, theme.chamber, true);
      curve(c.chamber, theme.chamber, false);
    }
    curve(c.nozzleTarget, theme.nozzle, true);
    curve(c.bedTarget, theme.bed, true);
    curve(c.nozzle, theme.nozzle, false);
    curve(c.bed, theme.bed, false);
    // What the printer does.
    const bandTop = top(3) + 1;
    for (let b = 0; b < bins.count; b++) {
      let from = 0;
      for (const kind of [KIND.heating, KIND.homing, KIND.wait, KIND.retract, KIND.prime, KIND.travel, KIND.print]) {
        const part = bins.kinds[b * 7 + kind];
        if (part <= 0) continue;
        context.fillStyle = theme.kinds[kind];
        context.fillRect(LABELS + b, bandTop + from * band, 1, part * band);
        from += part;
      }
    }
    context.fillStyle = theme.faint;
    context.textAlign = 'center';
    const step = [1, 2, 5, 10, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800, 86400].find((s) => s / end * plot > 60) ?? 172800;
    for (let t = 0; t <= end; t += step) {
      context.textAlign = t === 0 ? 'left' : x(t) > width - 24 ? 'right' : 'center';
      context.fillText(clock(t), x(t), bandTop + band + 9);
    }
  }
}

function maximum(values) {
  let most = 0;
  for (const value of values) most = Math.max(most, value);
  return most;
}

function job_targets({ c }) {
  return [niceTop(Math.max(maximum(c.nozzle), maximum(c.nozzleTarget), maximum(c.bed)))];
}

// A round number at or above a value.
function niceTop(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].map((f) => f * power).map((v) => Number(v.toPrecision(3))).find((v) => v >= value);
}
