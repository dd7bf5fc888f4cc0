// The path drawn with WebGL: a ribbon that faces the eye for each part, shaded as a bead.

const VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 from;
layout(location = 1) in vec3 to;
layout(location = 2) in vec2 value;
layout(location = 3) in float width;
uniform mat4 clip;
uniform vec3 eye;
uniform vec2 range;
uniform vec3 sizes; // thickness of a layer, width of a pixel at distance 1, width of thin lines in pixels
out float share;
out float across;
out vec3 side;
out vec3 toward;
void main() {
  float end = float(gl_VertexID & 1);
  float turn = float(gl_VertexID >> 1) * 2.0 - 1.0;
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
in float across;
in vec3 side;
in vec3 toward;
uniform sampler2D colours;
uniform vec4 plain; // colour of lines without values; a of 0: coloured by value
out vec4 colour;
void main() {
  if (plain.a > 0.0) { colour = vec4(plain.rgb * plain.a, plain.a); return; }
  vec3 base = texture(colours, vec2(clamp(share, 0.0, 1.0) * (255.0 / 256.0) + 0.5 / 256.0, 0.5)).rgb;
  vec3 normal = normalize(side * across + toward * sqrt(max(0.0, 1.0 - across * across)));
  float sun = max(0.0, dot(normal, normalize(vec3(-0.35, -0.55, 0.78))));
  float facing = max(0.0, dot(normal, toward));
  float sky = 0.5 + 0.5 * normal.z;
  vec3 lit = base * (0.30 + 0.42 * sun + 0.26 * sky + 0.14 * facing) + 0.10 * pow(sun, 24.0);
  colour = vec4(lit, 1.0);
}`;

// Parts of a coarse path, for pictures in motion on slow machines: some layers, thicker, and chords instead of short parts.
const COARSE_PARTS = 9000;

function coarsePath({ c, n, layers }) {
  let stride = Math.max(1, Math.ceil(layers / 90));
  for (let reach = 0.8; ; reach *= 1.5) {
    const [from, to] = [[], []];
    let start = -1;
    for (let i = 1; i <= n; i++) {
      const isPart = i < n && c.kind[i] === KIND.print && c.layer[i] % stride === 0;
      if (start >= 0) {
        const [ux, uy] = [c.x[i - 1] - c.x[start], c.y[i - 1] - c.y[start]];
        const length = Math.hypot(ux, uy);
        const [vx, vy] = isPart ? [c.x[i] - c.x[i - 1], c.y[i] - c.y[i - 1]] : [0, 0];
        const turns = ux * vx + uy * vy < 0.94 * length * Math.hypot(vx, vy);
        if (!isPart || length > 4 * reach || turns && length > reach / 4 || c.feature[i] !== c.feature[start + 1]) {
          if (length > reach / 4) { from.push(start); to.push(i - 1); }
          start = -1;
        }
      }
      if (start < 0 && isPart) start = i - 1;
    }
    if (to.length <= COARSE_PARTS || reach > 50) return { stride, from: Int32Array.from(from), to: Int32Array.from(to) };
    if (stride < layers / 40) stride += 1;
  }
}

function spaceOn(canvas, print) {
  const gl = canvas.getContext('webgl2', { antialias: true, alpha: true, powerPreference: 'high-performance' });
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
  const uniform = (name) => gl.getUniformLocation(program, name);
  const at = { clip: uniform('clip'), eye: uniform('eye'), range: uniform('range'), sizes: uniform('sizes'), plain: uniform('plain') };

  const buffer = (data) => {
    const made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return made;
  };
  const { c, n } = print;
  const places = new Float32Array(3 * n);
  for (let i = 0; i < n; i++) places.set([c.x[i], c.y[i], c.z[i]], 3 * i);
  const placeBuffer = buffer(places);
  const valueBuffer = buffer(new Float32Array(2 * n));
  const widthBuffer = buffer(new Float32Array(n));
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  for (const [name, value] of [['MIN_FILTER', 'NEAREST'], ['MAG_FILTER', 'NEAREST'], ['WRAP_S', 'CLAMP_TO_EDGE'], ['WRAP_T', 'CLAMP_TO_EDGE']]) {
    gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl[value]);
  }
  const grid = gridLines(print.job.travel_mm);
  const gridBuffer = buffer(grid);
  const gridCount = grid.length / 6;
  let range = [0, 1];
  const coarse = coarsePath(print);
  const count = coarse.to.length;
  const coarsePlaces = new Float32Array(6 * count);
  for (let k = 0; k < count; k++) {
    [coarse.from[k], coarse.to[k]].forEach((i, end) => coarsePlaces.set([c.x[i], c.y[i], c.z[i]], 6 * k + 3 * end));
  }
  const coarsePlaceBuffer = buffer(coarsePlaces);
  const coarseValueBuffer = buffer(new Float32Array(2 * count));
  const coarseWidthBuffer = buffer(new Float32Array(count));

  const instanced = (location, from, size, stride, offset) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, from);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, gl.FLOAT, false, stride, offset);
    gl.vertexAttribDivisor(location, 1);
  };

  const told = gl.getExtension('WEBGL_debug_renderer_info');
  const renderer = told ? String(gl.getParameter(told.UNMASKED_RENDERER_WEBGL)) : '';
  return {
    name: 'WebGL',
    isSlow: /swiftshader|llvmpipe|software/i.test(renderer),
    colour(values) {
      range = [values.low, values.high];
      gl.bindBuffer(gl.ARRAY_BUFFER, valueBuffer);
      gl.bufferData(gl.ARRAY_BUFFER, values.values, gl.STATIC_DRAW);
      const few = new Float32Array(2 * count);
      for (let k = 0; k < count; k++) few.set([values.values[2 * coarse.from[k] + 2], values.values[2 * coarse.to[k] + 1]], 2 * k);
      gl.bindBuffer(gl.ARRAY_BUFFER, coarseValueBuffer);
      gl.bufferData(gl.ARRAY_BUFFER, few, gl.STATIC_DRAW);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, values.table);
    },
    widths(widths) {
      gl.bindBuffer(gl.ARRAY_BUFFER, widthBuffer);
      gl.bufferData(gl.ARRAY_BUFFER, widths, gl.STATIC_DRAW);
      gl.bindBuffer(gl.ARRAY_BUFFER, coarseWidthBuffer);
      gl.bufferData(gl.ARRAY_BUFFER, Float32Array.from(coarse.to, (i) => widths[i]), gl.STATIC_DRAW);
    },
    // Draws the parts that end at nodes from `first` to before `last`, and a started one up to a place.
    draw(first, last, started, theme, ratio, isQuick) {
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.uniformMatrix4fv(at.clip, false, matrix(canvas.width / canvas.height));
      gl.uniform3fv(at.eye, eye());
      gl.uniform2fv(at.range, range);
      const pixel = 2 * FIELD / canvas.height;
      gl.uniform3f(at.sizes, print.height, pixel, ratio);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.uniform4fv(at.plain, theme.grid);
      instanced(0, gridBuffer, 3, 24, 0);
      instanced(1, gridBuffer, 3, 24, 12);
      gl.disableVertexAttribArray(2);
      gl.disableVertexAttribArray(3);
      gl.vertexAttrib1f(3, 0);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, gridCount);
      gl.disable(gl.BLEND);
      gl.uniform4f(at.plain, 0, 0, 0, 0);
      const parts = (start, count) => {
        instanced(0, placeBuffer, 3, 12, 12 * (start - 1));
        instanced(1, placeBuffer, 3, 12, 12 * start);
        instanced(2, valueBuffer, 2, 8, 8 * start);
        instanced(3, widthBuffer, 1, 4, 4 * start);
        gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
      };
      if (isQuick) {
        const [begin, end] = [lowerBound(coarse.to, first), lowerBound(coarse.to, last)];
        gl.uniform3f(at.sizes, print.height * coarse.stride, pixel, ratio);
        instanced(0, coarsePlaceBuffer, 3, 24, 24 * begin);
        instanced(1, coarsePlaceBuffer, 3, 24, 24 * begin + 12);
        instanced(2, coarseValueBuffer, 2, 8, 8 * begin);
        instanced(3, coarseWidthBuffer, 1, 4, 4 * begin);
        if (end > begin) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, end - begin);
      } else if (last > first) parts(first, last - first);
      if (started) {
        gl.bindBuffer(gl.ARRAY_BUFFER, placeBuffer);
        gl.bufferSubData(gl.ARRAY_BUFFER, 12 * started.i, new Float32Array(started.position));
        parts(started.i, 1);
        gl.bindBuffer(gl.ARRAY_BUFFER, placeBuffer);
        gl.bufferSubData(gl.ARRAY_BUFFER, 12 * started.i, places.subarray(3 * started.i, 3 * started.i + 3));
      }
    },
  };
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
