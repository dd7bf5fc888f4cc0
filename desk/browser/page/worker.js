// Runs the program beside the page: one question after the other.

let compiled;

async function unpacked(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  return WebAssembly.compile(await new Response(stream).arrayBuffer());
}

// Answers a question: the lines of the program go to the page as they come, then its page.
async function answer({ args, files }) {
  const said = [];
  let instance;
  const out = (line) => postMessage({ event: JSON.parse(line) });
  const { imports, written } = system(
    ['ferrostep', ...args], new Map(files), out, (line) => said.push(line), () => instance.exports.memory.buffer);
  try {
    instance = await WebAssembly.instantiate(await compiled, { wasi_snapshot_preview1: imports });
    instance.exports._start();
  } catch (error) {
    if (!(error instanceof Exit)) {
      const reason = said.find((line) => line.includes('memory allocation'))
        ? 'the browser has no more memory for this file: the command `ferrostep show` reads it'
        : `the program has stopped: ${said.join(' ') || error}`;
      postMessage({ event: { error: reason } });
      return;
    }
  }
  const pages = [...written.values()].map((file) => new Blob(file.parts, { type: 'text/html' }));
  postMessage({ ended: true, page: pages[0] });
}

onmessage = ({ data }) => {
  if (data.program) compiled = unpacked(data.program);
  else answer(data);
};
