// The rest of a job that has stopped: where its lines ask the nozzle to go. It is grey at any
// time, and is counted in nothing.

// Of all nodes of the path those from n on, which are not executed.
function restOf(path, n) {
  const layers = path.layer.subarray(n);
  for (let k = 1; k < layers.length; k++) layers[k] = Math.max(layers[k], layers[k - 1]);
  return { first: n, count: layers.length, layers, main: path.kind.subarray(n).includes(KIND.print) ? KIND.print : KIND.travel };
}

// The parts in layers from `low` to `high`: the first, and the one after the last.
function restBetween({ first, layers }, low, high) {
  return [first + lowerBound(layers, low), first + lowerBound(layers, high + 1)];
}

// The widths of its parts, among those of all.
function setRestWidths({ path, layerHeight, rest }, widths) {
  for (let i = rest.first; i < rest.first + rest.count; i++) {
    if (path.kind[i] !== rest.main) widths[i] = -1;
    else widths[i] = rest.main === KIND.print ? drawnWidth({ c: path, layerHeight }, i) : 0;
  }
}

// The lowest and the highest place of both the executed path and the rest, where there are any.
function extentWithRest({ path, rest }, executed) {
  const asked = extentOf({ c: path, n: rest.first + rest.count, main: rest.main }, rest.first);
  if (!asked || !executed) return asked ?? executed;
  return [asked[0].map((v, k) => Math.min(v, executed[0][k])), asked[1].map((v, k) => Math.max(v, executed[1][k]))];
}

// Its switch in the legend.
function showRest({ rest }, state, changed) {
  state.isRestShown = rest.count > 0;
  document.getElementById('rest-switch').hidden = !rest.count;
  const box = document.getElementById('rest');
  box.checked = state.isRestShown;
  box.addEventListener('change', () => {
    state.isRestShown = box.checked && rest.count > 0;
    changed();
  });
}
