// The G-code window: all lines of the job, of which only the visible ones are in the page.

const ROW_PIXELS = 18;
const ROWS_BESIDE = 12;

function sourceOn(box, print, jump) {
  const { source } = print;
  const rows = make('div', undefined, 'rows');
  rows.style.height = `${source.count * ROW_PIXELS}px`;
  box.append(rows);
  box.hidden = source.count === 0;
  let current = -1;
  let drawn = '';

  function draw() {
    const first = Math.max(1, Math.floor(box.scrollTop / ROW_PIXELS) + 1 - ROWS_BESIDE);
    const last = Math.min(source.count, first + Math.ceil(box.clientHeight / ROW_PIXELS) + 2 * ROWS_BESIDE);
    const now = [first, last, current].join();
    if (now === drawn) return;
    drawn = now;
    const made = [];
    for (let number = first; number <= last; number++) {
      const row = make('span', undefined, number === current ? 'current' : '');
      row.style.top = `${(number - 1) * ROW_PIXELS}px`;
      row.dataset.line = String(number);
      row.append(make('b', String(number)), document.createTextNode(` ${source.line(number) ?? ''}`));
      made.push(row);
    }
    rows.replaceChildren(...made);
  }

  box.addEventListener('scroll', draw, { passive: true });
  box.addEventListener('click', (event) => {
    const line = Number(event.target.closest('[data-line]')?.dataset.line);
    if (line) jump(line);
  });
  new ResizeObserver(draw).observe(box);
  return {
    // Shows a line in the middle, unless it is shown already.
    show(line) {
      if (line === current) return;
      current = line;
      const top = (line - 1) * ROW_PIXELS;
      const margin = 2 * ROW_PIXELS;
      if (top < box.scrollTop + margin || top > box.scrollTop + box.clientHeight - 2 * margin) box.scrollTop = top - box.clientHeight / 2 + ROW_PIXELS;
      draw();
    },
  };
}

// When a line, or the next one after it that moves, begins; null for lines without a place.
function timeOfLine({ c, n }, line) {
  if (!line) return null;
  return c.time[Math.min(n - 1, Math.max(1, lowerBound(c.line, line)))];
}
