// The path drawn with WebGL: a ribbon that faces the eye for each part, shaded as a bead.

const VERTEX = `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D places; // of each node: x, y, z, and the width of the part that ends there
uniform highp sampler2D values; // of each part: at its beginning and its end
uniform highp usampler2D chords; // of each part of a coarse path: the nodes where it begins and ends
uniform bool isCoarse;
uniform bool isGrid;
uniform int restFrom; // parts that end here or later were not executed
uniform int startedPart; // this part ends at \`startedEnd\`
uniform vec3 startedEnd;
uniform mat4 clip;
uniform vec3 eye;
uniform vec2 range;
uniform vec3 sizes; // thickness of a layer, width of a pixel at distance 1, width of thin lines in pixels
out float share;
flat out int isRest;
out float across;
out vec3 side;
out vec3 toward;
ivec2 texel(int number) { return ivec2(number & 2047, number >> 11); }
void main() {
  // Two triangles for each part, one list for all: an instance for each part is slow without a
  // graphics card.
  int part = gl_VertexID / 6;
  int corner = gl_VertexID - 6 * part;
  corner = corner < 3 ? corner : corner == 5 ? 3 : 5 - corner;
  float end = float(corner & 1);
  float turn = float(corner >> 1) * 2.0 - 1.0;
  int first = part - 1;
  int last = part;
  if (isCoarse) {
    uvec2 chord = texelFetch(chords, texel(part), 0).xy;
    first = int(chord.x);
    last = int(chord.y);
  } else if (isGrid) {
    first = 2 * part;
    last = first + 1;
  }
  isRest = !isGrid && last >= restFrom ? 1 : 0;
  vec3 from = texelFetch(places, texel(first), 0).xyz;
  vec4 target = texelFetch(places, texel(last), 0);
  vec3 to = !isCoarse && part == startedPart ? startedEnd : target.xyz;
  float width = target.w;
  vec2 value = vec2(0.0);
  if (!isGrid) {
    value = texelFetch(values, texel(last), 0).xy;
    if (isCoarse) value.x = texelFetch(values, texel(first + 1), 0).x;
  }
  vec3 along = to - from;
  float reach = length(along);
  along = reach > 0.0 ? along / reach : vec3(1.0, 0.0, 0.0);
  vec3 place = mix(from, to, end);
  toward = normalize(eye - place);
  side = cross(along, toward);
  float turned = length(side);
  side = turned > 1e-4 ? side / turned : vec3(0.0, 0.0, 1.0);
  float pixel = distance(eye, place) * sizes.y;
  // A bead is wide and flat: seen from the side it is as thick as a layer.
  float half_width = 0.5 * length(vec2(width * length(side.xy), sizes.x * side.z));
  half_width = width > 0.0 ? max(half_width, 0.6 * pixel) : 0.5 * sizes.z * pixel;
  float cap = width > 0.0 ? 0.4 * width : 0.0;
  place += along * cap * (2.0 * end - 1.0) + side * turn * half_width;
  // The middle of a bead is nearer than its edges.
  gl_Position = width < -0.5 ? vec4(2.0, 2.0, 2.0, 1.0) : clip * vec4(place, 1.0);
  share = (mix(value.x, value.y, end) - range.x) / (range.y - range.x);
  across = turn;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in float share;
flat in int isRest;
in float across;
in vec3 side;
in vec3 toward;
uniform sampler2D colours;
uniform vec3 grey; // colour of parts that were not executed
uniform vec4 plain; // colour of lines without values; a of 0: coloured by value
out vec4 colour;
void main() {
  if (plain.a > 0.0) { colour = vec4(plain.rgb * plain.a, plain.a); return; }
  vec3 base = isRest == 1 ? grey : texture(colours, vec2(clamp(share, 0.0, 1.0) * (255.0 / 256.0) + 0.5 / 256.0, 0.5)).rgb;
  vec3 normal = normalize(side * across + toward * sqrt(max(0.0, 1.0 - across * across)));
  float sun = max(0.0, dot(normal, normalize(vec3(-0.35, -0.55, 0.78))));
  float facing = max(0.0, dot(normal, toward));
  float sky = 0.5 + 0.5 * normal.z;
  vec3 lit = base * (0.30 + 0.42 * sun + 0.26 * sky + 0.14 * facing) + 0.10 * pow(sun, 24.0);
  colour = vec4(lit, 1.0);
}`;

// The most parts of a coarse path, for pictures in motion on slow machines; each level has half as
// many as the one before.
const COARSE_PARTS = [72000, 36000, 18000, 9000, 4500, 2250, 1125];
const FIRST_LEVEL = 3;
// A coarse picture may take so long, ms: for 30 of them in a second, with as much time again for
// the page and the browser. Where it takes less than QUICK_MS, one with twice the parts fits.
const FRAME_MS = 17;
const QUICK_MS = 7;
// Pictures from which a level is judged, and for how long it then stays, ms.
const JUDGED = 6;
const STAY_MS = 4000;
// The same for the parts of a whole picture that are drawn in one frame: the page must answer in
// between. While it plays, a fifth.
const PART_MS = 100;
const PLAYED_PART = 0.2;
// Samples of each pixel of a whole picture.
const SAMPLES = 4;
const ROW = 2048;

// Parts of a coarse path: some layers, thicker, and chords instead of short parts.
function coarsePath({ path: c, n, layers, main, rest }, most) {
  const total = n + rest.count;
  let stride = Math.max(1, Math.ceil(layers / 90));
  for (let reach = 0.8; ; reach *= 1.5) {
    const [from, to] = [[], []];
    let start = -1;
    for (let i = 1; i <= total; i++) {
      const isPart = i < total && c.kind[i] === (i < n ? main : rest.main) && c.layer[i] % stride === 0;
      if (start >= 0) {
        const [ux, uy] = [c.x[i - 1] - c.x[start], c.y[i - 1] - c.y[start]];
        const length = Math.hypot(ux, uy);
        const [vx, vy] = isPart ? [c.x[i] - c.x[i - 1], c.y[i] - c.y[i - 1]] : [0, 0];
        const turns = ux * vx + uy * vy < 0.94 * length * Math.hypot(vx, vy);
        if (!isPart || i === n || length > 4 * reach || turns && length > reach / 4 || c.feature[i] !== c.feature[start + 1]) {
          if (length > reach / 4) { from.push(start); to.push(i - 1); }
          start = -1;
        }
      }
      if (start < 0 && isPart) start = i - 1;
    }
    if (to.length <= most || reach > 50) return { stride, from, to };
    if (stride < layers / 40) stride += 1;
  }
}

// How many parts a machine draws in a frame, from what it has drawn. `level`: of COARSE_PARTS;
// `parts`: of a whole picture.
function detail() {
  const now = { level: FIRST_LEVEL, parts: 4000, drawn: 0, ms: 0 };
  let taken = [];
  let judgedAt = 0;
  // What a picture took at the level before, where this one is coarser: if it is no faster,
  // something else takes the time.
  let finer = 0;
  return {
    now,
    // A coarse picture took so long, ms.
    coarse(took, at) {
      taken.push(took);
      if (taken.length < JUDGED) return;
      now.ms = taken.sort((a, b) => a - b)[JUDGED >> 1];
      taken = [];
      const isSettled = at - judgedAt < STAY_MS;
      const [before, by] = [finer, finer && now.ms > 0.9 * finer ? -1 : now.ms > FRAME_MS ? 1 : now.ms < QUICK_MS ? -1 : 0];
      finer = 0;
      const level = Math.min(COARSE_PARTS.length - 1, Math.max(0, now.level + by));
      if (level === now.level || isSettled) return;
      if (by > 0) finer = now.ms; else judgedAt = at;
      if (before && by < 0) judgedAt = at;
      now.level = level;
    },
    // Parts of a whole picture took so long, ms.
    whole(parts, took) {
      if (parts >= now.parts / 2 || took > PART_MS) {
        now.parts = Math.round(Math.min(1e6, Math.max(2000, Math.min(4 * now.parts, parts * PART_MS / Math.max(took, 1)))));
      }
    },
  };
}

function spaceOn(canvas, print) {
  const gl = canvas.getContext('webgl2', { antialias: false, alpha: true, powerPreference: 'high-performance' });
  if (!gl) return null;
  const shader = (kind, source) => {
    const made = gl.createShader(kind);
    gl.shaderSource(made, source);
    gl.compileShader(made);
    if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
    return made;
  };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, FRAGMENT));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  const names = ['clip', 'eye', 'range', 'sizes', 'plain', 'grey', 'restFrom', 'isCoarse', 'isGrid', 'startedPart', 'startedEnd'];
  const at = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
  gl.bindVertexArray(gl.createVertexArray());

  // Textures are the tables of nodes, parts and colours.
  const UNITS = { places: 0, values: 1, chords: 2, colours: 3 };
  for (const [name, unit] of Object.entries(UNITS)) gl.uniform1i(gl.getUniformLocation(program, name), unit);
  const texture = () => {
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    for (const [name, value] of [['MIN_FILTER', 'NEAREST'], ['MAG_FILTER', 'NEAREST'], ['WRAP_S', 'CLAMP_TO_EDGE'], ['WRAP_T', 'CLAMP_TO_EDGE']]) {
      gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl[value]);
    }
    return made;
  };
  const use = (unit, made) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, made);
  };
  const rowsOf = (count) => Math.max(1, Math.ceil(count / ROW));
  // Numbers of a table, `size` for each entry, in whole rows.
  const fill = (unit, made, [inner, format, type], size, numbers) => {
    use(unit, made);
    const rows = rowsOf(numbers.length / size);
    let whole = numbers;
    if (numbers.length < rows * ROW * size) {
      whole = new numbers.constructor(rows * ROW * size);
      whole.set(numbers);
    }
    gl.texImage2D(gl.TEXTURE_2D, 0, gl[inner], ROW, rows, 0, gl[format], gl[type], whole);
  };
  const PLACES = ['RGBA32F', 'RGBA', 'FLOAT'];
  const { path, n } = print;
  const total = path.time.length;
  const places = new Float32Array(4 * ROW * rowsOf(total));
  for (let i = 0; i < total; i++) places.set([path.x[i], path.y[i], path.z[i]], 4 * i);
  gl.uniform1i(at.restFrom, n);
  const placeTexture = texture();
  const valueTexture = texture();
  const colourTexture = texture();
  const grid = gridLines(print.job.travel_mm);
  const gridTexture = texture();
  const gridCount = grid.length / 6;
  const gridPlaces = new Float32Array(4 * 2 * gridCount);
  for (let k = 0; k < 2 * gridCount; k++) gridPlaces.set(grid.subarray(3 * k, 3 * k + 3), 4 * k);
  fill(UNITS.places, gridTexture, PLACES, 4, gridPlaces);
  let range = [0, 1];
  const levels = [];
  const coarseAt = (level) => {
    if (!levels[level]) {
      const coarse = coarsePath(print, COARSE_PARTS[level]);
      const chords = new Uint32Array(2 * coarse.to.length);
      coarse.to.forEach((to, k) => chords.set([coarse.from[k], to], 2 * k));
      const made = texture();
      fill(UNITS.chords, made, ['RG32UI', 'RG_INTEGER', 'UNSIGNED_INT'], 2, chords);
      levels[level] = { ...coarse, texture: made };
    }
    return levels[level];
  };
  coarseAt(FIRST_LEVEL);

  // The whole picture is drawn beside the canvas, some parts in each frame if it must be, and shown
  // when it is complete.
  const beside = gl.createFramebuffer();
  const [colourPixels, depthPixels] = [gl.createRenderbuffer(), gl.createRenderbuffer()];
  const samples = Math.min(SAMPLES, gl.getParameter(gl.MAX_SAMPLES));
  let besideSize = '';
  const sizeBeside = (width, height) => {
    if (besideSize === `${width} ${height}`) return;
    besideSize = `${width} ${height}`;
    gl.bindFramebuffer(gl.FRAMEBUFFER, beside);
    for (const [pixels, format, place] of [[colourPixels, gl.RGBA8, gl.COLOR_ATTACHMENT0], [depthPixels, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]]) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, pixels);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, pixels);
    }
    painted.view = '';
  };
  // What lies on the picture beside the canvas: the view, the parts from `first` to before
  // `last`, a share of the part after them, and those of the rest of the job to before `rest`.
  const painted = { view: '', first: 0, last: 0, share: 0, rest: 0, asked: '' };
  let version = 0;

  const told = gl.getExtension('WEBGL_debug_renderer_info');
  const renderer = told ? String(gl.getParameter(told.UNMASKED_RENDERER_WEBGL)) : '';
  const fineness = detail();
  // Calls back when all that was asked for is drawn, with the time that it took, ms.
  let lastDrawn = 0;
  const whenDrawn = (began, done) => {
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const ask = () => {
      if (gl.isContextLost() || !fence || gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED) {
        gl.deleteSync(fence);
        const now = performance.now();
        // The pictures before it may have taken a part of the time.
        const took = now - Math.max(began, lastDrawn);
        lastDrawn = now;
        done(took);
      } else setTimeout(ask, 1);
    };
    setTimeout(ask, 0);
  };

  const begin = (width, height, thickness, thin) => {
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.uniformMatrix4fv(at.clip, false, matrix(width / height));
    gl.uniform3fv(at.eye, eye());
    gl.uniform2fv(at.range, range);
    gl.uniform3f(at.sizes, thickness, 2 * FIELD / height, thin);
    gl.uniform1i(at.startedPart, -1);
    gl.uniform1i(at.isCoarse, 0);
    use(UNITS.values, valueTexture);
    use(UNITS.chords, levels[fineness.now.level]?.texture ?? levels[FIRST_LEVEL].texture);
    use(UNITS.colours, colourTexture);
  };
  const drawGrid = (theme) => {
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniform4fv(at.plain, theme.grid);
    gl.uniform3fv(at.grey, rgb(theme.rest));
    gl.uniform1i(at.isGrid, 1);
    use(UNITS.places, gridTexture);
    gl.drawArrays(gl.TRIANGLES, 0, 6 * gridCount);
    gl.uniform1i(at.isGrid, 0);
    gl.disable(gl.BLEND);
  };
  const beginParts = () => {
    gl.uniform4f(at.plain, 0, 0, 0, 0);
    use(UNITS.places, placeTexture);
  };
  const drawStarted = (started) => {
    if (!started) return;
    gl.uniform1i(at.startedPart, started.i);
    gl.uniform3fv(at.startedEnd, started.position);
    gl.drawArrays(gl.TRIANGLES, 6 * started.i, 6);
  };

  return {
    name: 'WebGL',
    isSlow: /swiftshader|llvmpipe|software/i.test(renderer),
    detail: fineness.now,
    colour(values) {
      range = [values.low, values.high];
      fill(UNITS.values, valueTexture, ['RG32F', 'RG', 'FLOAT'], 2, values.values);
      use(UNITS.colours, colourTexture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, values.table);
      version += 1;
    },
    widths(widths) {
      for (let i = 0; i < total; i++) places[4 * i + 3] = widths[i];
      fill(UNITS.places, placeTexture, PLACES, 4, places);
      version += 1;
    },
    // Draws a coarse picture at once, with half as many pixels each way, of the parts that end at
    // nodes from `first` to before `last`, a started one up to a place, and those of the rest.
    coarse({ first, last, started, rest }, theme, ratio, drawn) {
      const began = performance.now();
      const coarse = coarseAt(fineness.now.level);
      setPixels(canvas, ratio / 2);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      begin(canvas.width, canvas.height, print.height * coarse.stride, ratio / 2);
      drawGrid(theme);
      beginParts();
      gl.uniform1i(at.isCoarse, 1);
      fineness.now.drawn = 0;
      for (const ends of [[first, last], rest]) {
        const [from, to] = ends.map((end) => lowerBound(coarse.to, end));
        if (to > from) gl.drawArrays(gl.TRIANGLES, 6 * from, 6 * (to - from));
        fineness.now.drawn += Math.max(0, to - from);
      }
      gl.uniform1i(at.isCoarse, 0);
      drawStarted(started);
      whenDrawn(began, (took) => {
        fineness.coarse(took, performance.now());
        drawn();
      });
    },
    // Draws the whole picture, on a slow machine as many of its parts as fit into a frame, or while
    // it plays nothing if not all of them do; whether it is complete, and so is shown.
    whole({ first, last, started, rest: [restFirst, restLast] }, theme, ratio, { isSlow, isPlaying }, drawn) {
      const [width, height] = pixelsOf(canvas, ratio);
      const began = performance.now();
      sizeBeside(width, height);
      const view = [...matrix(width / height), version, theme.gridCss].join();
      const share = started ? started.share : 0;
      const isBefore = painted.last > last || painted.last === last && painted.share > share;
      const asked = `${restFirst} ${restLast}`;
      const isNew = painted.view !== view || painted.first !== first || painted.asked !== asked || isBefore;
      const before = isNew ? { last: first, rest: restFirst } : painted;
      const most = isSlow ? Math.round(fineness.now.parts * (isPlaying ? PLAYED_PART : 1)) : Infinity;
      if (isPlaying && last - before.last + restLast - before.rest > most) {
        drawn();
        return false;
      }
      gl.bindFramebuffer(gl.FRAMEBUFFER, beside);
      begin(width, height, print.height, ratio);
      if (isNew) {
        drawGrid(theme);
        Object.assign(painted, { view, first, last: first, asked, rest: restFirst });
      }
      painted.share = share;
      beginParts();
      // The rest first: the executed parts grow while the print plays.
      const restUntil = Math.min(restLast, painted.rest + most);
      const restParts = restUntil - painted.rest;
      const until = Math.min(last, painted.last + most - restParts);
      for (const [from, to] of [[painted.rest, restUntil], [painted.last, until]]) if (to > from) gl.drawArrays(gl.TRIANGLES, 6 * from, 6 * (to - from));
      const parts = restParts + until - painted.last;
      [painted.rest, painted.last] = [restUntil, Math.max(until, first)];
      const isComplete = until >= last && restUntil >= restLast;
      if (isComplete) {
        drawStarted(started);
        setPixels(canvas, ratio);
        gl.bindFramebuffer(gl.READ_FRAMEBUFFER, beside);
        gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
        gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
      }
      if (isSlow) {
        whenDrawn(began, (took) => {
          fineness.whole(parts, took);
          drawn();
        });
      } else drawn();
      fineness.now.drawn = painted.last - first + painted.rest - restFirst;
      return isComplete;
    },
  };
}

// Pixels of a canvas, and their setting, which wipes it.
function pixelsOf({ clientWidth, clientHeight }, ratio) {
  return [Math.max(1, Math.round(clientWidth * ratio)), Math.max(1, Math.round(clientHeight * ratio))];
}

function setPixels(canvas, ratio) {
  const [width, height] = pixelsOf(canvas, ratio);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
}

// The bed: a line every 10 mm, as pairs of places.
function gridLines([low, high]) {
  const lines = [];
  const line = (...ends) => lines.push(...ends);
  for (let x = Math.ceil(low[0] / 10) * 10; x <= high[0]; x += 10) line(x, low[1], 0, x, high[1], 0);
  for (let y = Math.ceil(low[1] / 10) * 10; y <= high[1]; y += 10) line(low[0], y, 0, high[0], y, 0);
  const [x0, y0, x1, y1] = [low[0], low[1], high[0], high[1]];
  line(x0, y0, 0, x1, y0, 0); line(x1, y0, 0, x1, y1, 0); line(x1, y1, 0, x0, y1, 0); line(x0, y1, 0, x0, y0, 0);
  return new Float32Array(lines);
}
