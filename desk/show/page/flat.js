// The path drawn on a plain canvas, where WebGL is missing: lines, the latest on top, and fewer of
// them while there are many.

const FLAT_LINES = 60000;
const QUICK_LINES = 6000;

function flatOn(canvas, print) {
  const context = canvas.getContext('2d');
  const { path, n } = print;
  let values = null;
  let widths = new Float32Array(path.time.length);
  const grid = gridLines(print.job.travel_mm);
  return {
    name: '2D canvas',
    colour(now) { values = now; },
    widths(now) { widths = now; },
    coarse(shown, theme, ratio, drawn) {
      draw(shown, theme, ratio, QUICK_LINES);
      drawn();
    },
    whole(shown, theme, ratio, how, drawn) {
      draw(shown, theme, ratio, FLAT_LINES);
      drawn();
      return true;
    },
  };

  function draw({ first, last, started, rest }, theme, ratio, most) {
    setPixels(canvas, ratio);
    const { width, height } = canvas;
    const place = projection(width, height);
    context.clearRect(0, 0, width, height);
    const line = (a, b) => {
      if (!a || !b) return;
      context.beginPath();
      context.moveTo(a[0], a[1]);
      context.lineTo(b[0], b[1]);
      context.stroke();
    };
    context.lineCap = 'round';
    context.lineWidth = ratio;
    context.strokeStyle = theme.gridCss;
    for (let i = 0; i < grid.length; i += 6) {
      line(place(grid[i], grid[i + 1], grid[i + 2]), place(grid[i + 3], grid[i + 4], grid[i + 5]));
    }
    const part = (i, end) => {
      if (widths[i] < -0.5) return;
      const a = place(path.x[i - 1], path.y[i - 1], path.z[i - 1]);
      const b = place(...end);
      if (!a || !b) return;
      const value = i < n ? (values.values[2 * i] + values.values[2 * i + 1]) / 2 : 0;
      context.strokeStyle = i >= n ? theme.rest : css(values.table, (value - values.low) / (values.high - values.low));
      context.lineWidth = Math.max(ratio, widths[i] * height / (2 * FIELD * b[2]));
      line(a, b);
    };
    // The latest parts lie on top.
    const parts = (from, to, room) => { for (let i = Math.max(from, to - room); i < to; i++) part(i, [path.x[i], path.y[i], path.z[i]]); };
    const asked = Math.min(most / 2, rest[1] - rest[0]);
    parts(first, last, most - asked);
    parts(...rest, asked);
    if (started) part(started.i, started.position);
  }
}
