// The keyboard: each key, its words for the page, and what it does.

const KEYS = [
  ['Space', 'play, pause'], [', .', 'the move before, the next'], ['[ ]', 'a layer down, up'], ['arrows', 'turn'], ['+ −', 'zoom'], ['Home 7 1 3', 'views'],
  ['C', 'next colour'], ['T', 'travels'], ['L', 'one layer'], ['N', 'what was not executed'], ['S R P X', 'seams, retractions, pauses, colour changes'], ['G', 'go to a line'], ['F', 'fold the panels'],
  ['drag, wheel', 'turn, zoom; with Shift or two fingers: move'],
];

function keysOn({ state, box, step, layerStep, play, stop, setMode, touched }) {
  const byId = (id) => document.getElementById(id);
  const click = (id) => () => byId(id)?.click();
  const isOwn = (target) => target instanceof HTMLButtonElement || target.tagName === 'SUMMARY' || target.type === 'checkbox';
  const nextMode = () => {
    const all = Object.keys(MODES);
    setMode(all[(all.indexOf(state.mode) + 1) % all.length]);
  };
  const fold = () => {
    const panels = [byId('legend'), byId('layers')];
    const isOpen = panels.some((panel) => panel.open);
    for (const panel of panels) panel.open = !isOpen;
  };
  const everywhere = {
    ' ': (target) => {
      if (isOwn(target)) return false;
      if (state.playing) stop(); else play();
      return true;
    },
    ',': () => step(-1), '.': () => step(1),
    '[': () => layerStep(-1), ']': () => layerStep(1),
    '+': () => zoom(0.85), '=': () => zoom(0.85), '-': () => zoom(1 / 0.85),
    7: () => look(box(), 'top'), 1: () => look(box(), 'front'), 3: () => look(box(), 'side'),
    c: nextMode, t: click('travels'), l: click('single'), n: click('rest'), f: fold,
    s: click('place-seams'), r: click('place-retractions'), p: click('place-pauses'), x: click('place-changes'),
    g: () => { byId('goto').focus(); byId('goto').select(); },
  };
  const view = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1), Home: () => look(box(), 'all'),
  };
  document.addEventListener('keydown', (event) => {
    const { target } = event;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (target instanceof HTMLSelectElement || target.type === 'number') return;
    // Sliders and the G-code window have these keys for themselves.
    const keys = target.type === 'range' || target.closest?.('#source') ? everywhere : { ...everywhere, ...view };
    const act = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (!act || act(target) === false) return;
    event.preventDefault();
    touched();
  });
}
