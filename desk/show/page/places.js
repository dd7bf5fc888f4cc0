// Places on the path that a person looks for: seams, retractions, pauses, changes of colour.

const PLACE_KINDS = {
  seams: { name: 'Seams', colour: '#ffffff' },
  retractions: { name: 'Retractions', colour: '#d85f95' },
  pauses: { name: 'Pauses', colour: '#f2a33a' },
  changes: { name: 'Colour changes', colour: '#39b7c9' },
};
// Places of a kind that are drawn at once.
const MOST_PLACES = 3000;
const PAUSE = /^\s*(?:N\d+\s*)?(?:M0|M1|M25|M226|M601|PAUSE)\b/i;
const CHANGE = /^\s*(?:N\d+\s*)?(?:M600|T\d+)\b/i;
// A wait of this length is a pause, s, where the text of the job is missing.
const PAUSE_S = 2;

// Indices of nodes, each kind in the order of time.
function placesOf({ c, n, features, source }) {
  const places = { seams: [], retractions: [], pauses: [], changes: [] };
  const hasOuter = features.some((name) => familyOf(name) === 'outer');
  const isOuter = (i) => !hasOuter || familyOf(features[c.feature[i]] ?? '') === 'outer';
  let told = 0;
  for (let i = 1; i < n; i++) {
    const kind = c.kind[i];
    if (kind === KIND.print && c.kind[i - 1] !== KIND.print && isOuter(i)) places.seams.push(i - 1);
    if (kind === KIND.retract && (c.kind[i - 1] !== KIND.retract || c.line[i] !== c.line[i - 1])) places.retractions.push(i);
    if (c.line[i] === told) continue;
    const text = source.line(c.line[i]);
    const isChange = text === null ? c.tool[i] !== c.tool[i - 1] : CHANGE.test(text);
    const isPause = text === null ? kind === KIND.wait && c.time[i] - c.time[i - 1] > PAUSE_S : PAUSE.test(text);
    if (!isChange && !isPause) continue;
    told = c.line[i];
    (isChange ? places.changes : places.pauses).push(i - 1);
  }
  return places;
}

// Those between two indices, of many evenly chosen ones.
function placesBetween(indices, first, last) {
  const [from, to] = [lowerBound(indices, first), lowerBound(indices, last)];
  const stride = Math.max(1, Math.ceil((to - from) / MOST_PLACES));
  const chosen = [];
  for (let k = from; k < to; k += stride) chosen.push(indices[k]);
  return chosen;
}

function drawPlaces(context, print, shown, first, last, place) {
  const { c, places } = print;
  for (const [kind, { colour }] of Object.entries(PLACE_KINDS)) {
    if (!shown.has(kind)) continue;
    context.fillStyle = colour;
    context.strokeStyle = '#0008';
    context.lineWidth = 1;
    const size = kind === 'seams' || kind === 'retractions' ? 2.5 : 6;
    for (const i of placesBetween(places[kind], first, last)) {
      const at = place(c.x[i], c.y[i], c.z[i]);
      if (!at) continue;
      context.beginPath();
      context.arc(at[0], at[1], size, 0, 7);
      context.fill();
      context.stroke();
    }
  }
}
