// The page around the program: takes files, shows its progress, then the print.

const element = (id) => document.getElementById(id);
const NAMES = {
  estimate: 'Plans the print', record: 'Executes the print and records its path',
  compare: 'Plans it with other limits', write: 'Writes the page',
};
const CONFIGURATION = /\.(cfg|h|toml)$/i;

const bytes = Uint8Array.from(atob(element('program').textContent.trim()), (letter) => letter.charCodeAt(0));
const workerUrl = URL.createObjectURL(new Blob([element('worker').textContent], { type: 'text/javascript' }));

// The last answer, for tests and for people with a console.
const ferrostep = { state: 'before', done: null, error: null };
window.ferrostep = ferrostep;

let worker = null;
let pageUrl = null;
let job = null;

function start() {
  worker = new Worker(workerUrl);
  worker.postMessage({ program: bytes });
}

// Shows the parts of a state: `before`, `work` or `after`.
function show(state) {
  ferrostep.state = state;
  element('choice').hidden = state !== 'before';
  element('work').hidden = state !== 'work';
  for (const id of ['actions', 'details', 'page']) element(id).hidden = state !== 'after';
  element('again').hidden = state !== 'after';
}

function reset() {
  worker?.terminate();
  worker = null;
  element('job').value = '';
  element('time').textContent = '';
  document.title = 'Ferrostep: a print\'s time and path';
  element('page').removeAttribute('src');
  if (pageUrl) URL.revokeObjectURL(pageUrl);
  pageUrl = null;
  show('before');
}

function fail(message) {
  reset();
  ferrostep.error = message;
  element('error').textContent = message;
  element('error').hidden = false;
}

function list(lines) {
  return lines.map((line) => {
    const item = document.createElement('li');
    item.textContent = line;
    return item;
  });
}

// Lists the settings that a configuration gave, and first those that it lacks.
function machine(kept) {
  const missing = kept.by_permission.map((key) => `The configuration does not say ${key}: the built-in profile's value stands in.`);
  const unread = kept.unread.map((file) => `Not read: ${file}`);
  const head = document.createElement('p');
  head.textContent = `${kept.kept} settings of the configuration are kept, ${kept.left_out.length} have no effect on the print:`;
  const rows = document.createElement('ul');
  rows.append(...list([...missing, ...unread, ...kept.left_out]));
  element('kept').replaceChildren(head, rows);
  element('details').open = missing.length + unread.length > 0;
}

function finding({ text, line }) {
  return line === undefined ? text : `line ${line}: ${text}`;
}

const events = {
  progress({ step, share }) {
    element('step').textContent = `${job.name}: ${NAMES[step]}`;
    element('progress').value = share;
  },
  notice() {},
  taken(note) {
    const line = document.createElement('p');
    line.textContent = note;
    element('kept').replaceChildren(line);
  },
  machine,
  done(done) {
    ferrostep.done = done;
    element('text').textContent = done.text;
    element('findings').replaceChildren(...list(done.findings.map(finding)));
  },
  error: fail,
};

function ended(page) {
  if (!page || !ferrostep.done) return;
  const { summary } = ferrostep.done;
  pageUrl = URL.createObjectURL(page);
  element('page').src = pageUrl;
  const download = element('download');
  download.href = pageUrl;
  download.download = `${job.name.replace(/\.gz$/i, '').replace(/\.[^.]+$/, '')}.html`;
  const [, time] = ferrostep.done.text.split('\n');
  element('time').textContent = `${job.name}: ${time.trim()}`;
  document.title = `${job.name}: the print as it is executed`;
  if (summary.stopped) {
    element('error').textContent = `The print stops early. ${summary.stopped.message}`;
    element('error').hidden = false;
  }
  show('after');
  element('page').focus();
}

// The configuration that includes the others: by its name, or else the first.
function first(configurations) {
  return configurations.find(({ name }) => /^(printer\.cfg|configuration\.h)$/i.test(name)) ?? configurations[0];
}

function read(file, configurations) {
  if (!worker) start();
  job = file;
  ferrostep.done = ferrostep.error = null;
  element('error').hidden = true;
  element('kept').replaceChildren();
  events.progress({ step: 'estimate', share: 0 });
  show('work');
  element('cancel').focus();
  // A name may hold anything but the separator of folders.
  const files = [[`job/${file.name}`, file]];
  let machineName = element('machine').value;
  if (configurations.length > 0) machineName = `/machine/${first(configurations).name}`;
  for (const configuration of configurations) files.push([`machine/${configuration.name}`, configuration]);
  const rules = element('rules').value;
  worker.onmessage = ({ data }) => {
    if (data.event) for (const [kind, event] of Object.entries(data.event)) events[kind](event);
    if (data.ended) ended(data.page);
  };
  worker.onerror = (error) => fail(`the program has stopped: ${error.message}`);
  worker.postMessage({ args: [`/job/${file.name}`, '/page.html', machineName, ...(rules ? [rules] : [])], files });
}

// Takes dropped files: one job, and the files of a configuration if they are among them.
function take(files) {
  const configurations = files.filter((file) => CONFIGURATION.test(file.name));
  const jobs = files.filter((file) => !CONFIGURATION.test(file.name));
  if (configurations.length > 0) {
    const held = new DataTransfer();
    for (const configuration of configurations) held.items.add(configuration);
    element('configuration').files = held.files;
  }
  if (jobs.length > 1) fail(`${jobs.length} files: drop one G-code file, and with it no more than a configuration with the files that it includes`);
  else if (jobs.length === 1) read(jobs[0], [...element('configuration').files]);
}

element('job').addEventListener('change', () => take([...element('job').files]));
element('cancel').addEventListener('click', reset);
element('again').addEventListener('click', reset);
addEventListener('keydown', (event) => {
  if (event.key === 'Escape' && ferrostep.state === 'work') reset();
});
for (const kind of ['dragenter', 'dragover', 'dragleave', 'drop']) {
  addEventListener(kind, (event) => {
    event.preventDefault();
    document.body.classList.toggle('dropping', kind === 'dragenter' || kind === 'dragover');
    if (kind === 'drop' && ferrostep.state !== 'work') take([...event.dataTransfer.files]);
  });
}
if (!('DecompressionStream' in window) || !('WebAssembly' in window)) {
  fail('This browser is too old for the page: it needs WebAssembly and DecompressionStream (2023 and later).');
}
start();
show('before');
