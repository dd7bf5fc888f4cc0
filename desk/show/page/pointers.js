// Pointers: they turn, move and zoom the view, and find what lies below them; on the charts they
// choose a time.

function pointersOn({ canvas, chart, tip, state, charts, hover, changed, touched, goTo, stop, setTime }) {
  const pointers = new Map();
  let moved = 0;
  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    moved = 0;
  });
  canvas.addEventListener('pointermove', (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) { if (event.pointerType === 'mouse') hover(event); return; }
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    moved += Math.abs(dx) + Math.abs(dy);
    if (moved < 4) return;
    [state.hovered, tip.hidden] = [null, true];
    const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (others.length) {
      const apart = (place) => Math.hypot(place[0] - others[0][0], place[1] - others[0][1]) || 1;
      zoom(apart(before) / apart([event.clientX, event.clientY]));
      pan(dx / 2, dy / 2, canvas.clientHeight);
    } else if (event.shiftKey || event.buttons & 6) pan(dx, dy, canvas.clientHeight);
    else turn(dx * 0.008, dy * 0.008);
    touched();
  });
  for (const name of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(name, (event) => {
      if (pointers.delete(event.pointerId) && moved < 4 && name === 'pointerup') {
        hover(event);
        if (state.hovered) { const { time } = state.hovered; stop(); setTime(time); }
      }
    });
  }
  canvas.addEventListener('pointerleave', () => { state.hovered = null; tip.hidden = true; changed(); });
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener('wheel', (event) => { event.preventDefault(); zoom(Math.exp(event.deltaY * (event.deltaMode ? 0.05 : 0.0015))); touched(); }, { passive: false });
  const chartTime = (event) => goTo(charts.timeAt(event.clientX - chart.getBoundingClientRect().left));
  chart.addEventListener('pointerdown', (event) => { chart.setPointerCapture(event.pointerId); chartTime(event); });
  chart.addEventListener('pointermove', (event) => { if (chart.hasPointerCapture(event.pointerId)) chartTime(event); });
}
