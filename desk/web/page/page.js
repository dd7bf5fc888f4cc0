'use strict';
(() => {
  const $ = (id) => document.getElementById(id);
  const token = location.hash.slice(1);
  const POLL_MS = 500;
  const HIDDEN_POLL_MS = 3000;
  const HISTORY_S = 600;
  const MAX_SHOWN = 500;
  const WORDS = {
    disconnected: 'Not connected', idle: 'Ready', working: 'Working', printing: 'Printing', pausing: 'Pausing after the moves under way',
    paused: 'Paused', cancelling: 'Cancelling', halted: 'Halted: motors and heaters are off; send M999 to go on',
  };
  const history = [];
  const sent = [];
  let [after, state, place, uploading, complaint] = [0, null, 0, false, ''];

  async function ask(method, path, body, headers = {}) {
    const answer = await fetch(path, { method, body, headers: { ...headers, Authorization: `Bearer ${token}` }, cache: 'no-store', credentials: 'omit' });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    return answer;
  }

  // A wish of a person; what is wrong with it stands above the page until the next one.
  async function wish(path, body) {
    try {
      await ask('POST', path, body);
      complaint = '';
      await look();
      return true;
    } catch (error) {
      complain(error);
      return false;
    }
  }

  function complain(error) {
    complaint = error instanceof TypeError ? 'The program on the computer does not answer: is `ferrostep serve` still running?' : error.message;
    showMessage();
  }

  function showMessage() {
    const text = complaint || (state && (state.owner || state.message)) || '';
    $('message').hidden = text === '';
    if ($('message').textContent !== text) $('message').textContent = text;
  }

  const clock = (s) => {
    const [h, m, rest] = [Math.floor(s / 3600), Math.floor(s / 60) % 60, Math.floor(s % 60)];
    const two = (n) => String(n).padStart(2, '0');
    return h > 0 ? `${h}:${two(m)}:${two(rest)}` : `${m}:${two(rest)}`;
  };
  const size = (bytes) => bytes >= 1e6 ? `${(bytes / 1e6).toFixed(1)} MB` : `${Math.ceil(bytes / 1e3)} kB`;

  const hasChamber = (heat) => heat !== null && heat.chamber_celsius !== null;

  function show() {
    const { activity, heat, job } = state;
    $('machine').textContent = state.machine;
    document.title = job && job.line > 0 && activity !== 'idle' ? `${Math.floor(job.share * 100)} % ${state.machine}` : state.machine;
    $('activity').textContent = WORDS[activity] ?? activity;
    showMessage();
    const heated = (now, target) => `${now.toFixed(1)} °C${target > 0 ? ` / ${target.toFixed(0)}` : ''}`;
    $('nozzle').textContent = heat ? heated(heat.nozzle_celsius, heat.nozzle_target_celsius) : '–';
    $('bed').textContent = heat ? heated(heat.bed_celsius, heat.bed_target_celsius) : '–';
    $('has-chamber').hidden = !hasChamber(heat);
    if (hasChamber(heat)) $('chamber').textContent = heated(heat.chamber_celsius, heat.chamber_target_celsius);
    ['x', 'y', 'z'].forEach((axis, k) => { $(axis).textContent = state.position_mm ? state.position_mm[k].toFixed(2) : '–'; });
    const runs = ['printing', 'pausing', 'paused', 'cancelling'].includes(activity);
    if (!uploading) {
      $('file').textContent = job ? `${job.name} (${size(job.bytes)})` : 'No file yet: choose one, or drop it here.';
      $('progress').value = job ? job.share : 0;
      const left = job && job.remaining_s !== null ? `${clock(job.remaining_s)} ${job.line > 0 ? 'left' : 'to print'}` : '';
      const done = job && job.line > 0 ? `${(job.share * 100).toFixed(1)} %, line ${job.line}` : '';
      $('times').textContent = [done, left].filter((text) => text).join(', ');
    }
    $('choose').hidden = runs;
    $('start').hidden = runs;
    $('start').disabled = uploading || !job || activity !== 'idle' || state.owner !== null;
    $('pause').hidden = activity !== 'printing';
    $('resume').hidden = activity !== 'paused';
    $('cancel').hidden = !runs;
    $('cancel').disabled = activity === 'cancelling';
  }

  function say(line) {
    const log = $('console');
    const isAtEnd = log.scrollHeight - log.scrollTop - log.clientHeight < 30;
    const shown = document.createElement('div');
    shown.className = line.speaker;
    shown.textContent = line.text;
    log.append(shown);
    while (log.childElementCount > MAX_SHOWN) log.firstElementChild.remove();
    if (isAtEnd) log.scrollTop = log.scrollHeight;
  }

  let looking = null;
  function look() {
    looking ??= (async () => {
      try {
        const seen = await (await ask('GET', `/state?after=${after}`)).json();
        for (const line of seen.console) {
          after = Math.max(after, line.number);
          say(line);
        }
        state = seen;
        const now = performance.now() / 1000;
        if (seen.heat && (history.length === 0 || now - history[history.length - 1].time >= 1)) {
          history.push({ time: now, ...seen.heat });
          while (history[0].time < now - HISTORY_S) history.shift();
        }
        if (complaint.startsWith('The program on')) complaint = '';
        show();
        draw();
      } finally {
        looking = null;
      }
    })();
    return looking;
  }

  async function poll() {
    try {
      await look();
    } catch (error) {
      $('activity').textContent = 'Not connected';
      complain(error);
    }
    setTimeout(poll, document.hidden ? HIDDEN_POLL_MS : POLL_MS);
  }

  function draw() {
    const canvas = $('graph');
    const context = canvas.getContext('2d');
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const LABEL = 34;
    const heaters = ['bed', 'nozzle'];
    if (history.every(hasChamber)) heaters.unshift('chamber');
    const values = history.flatMap((h) => heaters.flatMap((heater) => [h[`${heater}_celsius`], h[`${heater}_target_celsius`]]));
    const top = Math.ceil((Math.max(50, ...values) * 1.05) / 50) * 50;
    const now = history.length > 0 ? history[history.length - 1].time : 0;
    const x = (time) => width - 4 - (now - time) / HISTORY_S * (width - LABEL - 4);
    const y = (celsius) => 6 + (1 - celsius / top) * (height - 12);
    context.font = '11px system-ui, sans-serif';
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    context.lineWidth = 1;
    for (const celsius of [0, top / 2, top]) {
      context.strokeStyle = colour('--line');
      context.beginPath();
      context.moveTo(LABEL, Math.round(y(celsius)) + 0.5);
      context.lineTo(width, Math.round(y(celsius)) + 0.5);
      context.stroke();
      context.fillStyle = colour('--faint');
      context.fillText(String(celsius), LABEL - 6, y(celsius));
    }
    const curve = (key, name, isTarget) => {
      context.strokeStyle = colour(name);
      context.lineWidth = isTarget ? 1 : 1.8;
      context.setLineDash(isTarget ? [4, 3] : []);
      context.beginPath();
      let before = null;
      for (const point of history) {
        const [px, py] = [x(point.time), y(point[key])];
        if (before === null) context.moveTo(px, py);
        else {
          if (isTarget) context.lineTo(px, before);
          context.lineTo(px, py);
        }
        before = py;
      }
      context.stroke();
      context.setLineDash([]);
    };
    for (const heater of heaters) curve(`${heater}_target_celsius`, `--${heater}`, true);
    for (const heater of heaters) curve(`${heater}_celsius`, `--${heater}`, false);
  }

  // A file goes by XMLHttpRequest, which reports how much of it is sent.
  function upload(file) {
    if (!file || uploading) return;
    uploading = true;
    complaint = '';
    $('file').textContent = `Uploading ${file.name} (${size(file.size)})`;
    $('times').textContent = '';
    $('progress').value = 0;
    const sending = new XMLHttpRequest();
    sending.open('POST', '/job');
    sending.setRequestHeader('Authorization', `Bearer ${token}`);
    sending.setRequestHeader('X-Name', encodeURIComponent(file.name));
    sending.upload.onprogress = (event) => { $('progress').value = event.loaded / event.total; };
    sending.onloadend = () => {
      uploading = false;
      $('upload').value = '';
      if (sending.status !== 200) complain(sending.status === 0 ? new Error('The file did not arrive: is it too large, or `ferrostep serve` gone?') : new Error(sending.responseText.trim()));
      look().catch(complain);
    };
    sending.send(file);
  }

  $('upload').addEventListener('change', () => upload($('upload').files[0]));
  for (const name of ['dragover', 'dragleave', 'drop']) {
    document.addEventListener(name, (event) => {
      event.preventDefault();
      $('drop').classList.toggle('over', name === 'dragover');
      if (name === 'drop' && !$('choose').hidden) upload(event.dataTransfer.files[0]);
    });
  }
  for (const path of ['start', 'pause', 'resume', 'stop']) $(path).addEventListener('click', () => wish(`/${path}`));
  $('cancel').addEventListener('click', () => {
    if (confirm('Cancel the print? Motion and heaters are switched off.')) wish('/cancel');
  });
  document.addEventListener('keydown', (event) => {
    if (event.key === 'Escape' && event.ctrlKey) wish('/stop');
  });
  // A press of one unit, times the length that is chosen beside it.
  const lengths = { jog: 'step', filament: 'length' };
  const control = (wanted) => wish('/control', JSON.stringify(wanted));
  for (const button of document.querySelectorAll('[data-control]')) {
    button.addEventListener('click', () => {
      const wanted = JSON.parse(button.dataset.control);
      const length = lengths[wanted.do];
      if (length) wanted.mm *= Number($(length).value);
      control(wanted);
    });
  }
  $('preheat').addEventListener('click', () => {
    const [nozzle, bed] = $('material').value.split(' ').map(Number);
    control({ do: 'heat', nozzle_celsius: nozzle, bed_celsius: bed });
  });
  $('form').addEventListener('submit', async (event) => {
    event.preventDefault();
    const line = $('line').value.trim();
    if (line === '') return;
    if (await wish('/line', line)) {
      if (sent[sent.length - 1] !== line) sent.push(line);
      place = sent.length;
      $('line').value = '';
    }
  });
  // Lines sent before.
  $('line').addEventListener('keydown', (event) => {
    if (event.key !== 'ArrowUp' && event.key !== 'ArrowDown') return;
    event.preventDefault();
    place = Math.min(sent.length, Math.max(0, place + (event.key === 'ArrowUp' ? -1 : 1)));
    $('line').value = sent[place] ?? '';
  });
  window.addEventListener('hashchange', () => location.reload());
  window.addEventListener('resize', draw);
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
  poll();
})();
