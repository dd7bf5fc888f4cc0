// The camera: it circles around a point.

const camera = { yaw: -0.6, pitch: 0.62, distance: 300, target: [100, 100, 0], near: 1, far: 5000 };
const FIELD = 0.6; // tangent of half the field of view, upwards

function eye() {
  const { yaw, pitch, distance, target } = camera;
  return [target[0] + distance * Math.cos(pitch) * Math.sin(yaw), target[1] - distance * Math.cos(pitch) * Math.cos(yaw),
    target[2] + distance * Math.sin(pitch)];
}

// Right, up and towards the eye.
function axes() {
  const { yaw, pitch } = camera;
  const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
  return { right: [cy, sy, 0], up: [-sp * sy, sp * cy, cp], back: [cp * sy, -cp * cy, sp] };
}

// The matrix to clip space, by columns.
function matrix(aspect) {
  const { right, up, back } = axes();
  const from = eye();
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const near = Math.max(0.05, camera.distance / 200);
  const far = camera.distance * 20 + 2000;
  const [sx, sy] = [1 / (FIELD * aspect), 1 / FIELD];
  const [a, b] = [-(far + near) / (far - near), -2 * far * near / (far - near)];
  const [r, u, k] = [-dot(right, from), -dot(up, from), -dot(back, from)];
  return new Float32Array([
    sx * right[0], sy * up[0], a * back[0], -back[0],
    sx * right[1], sy * up[1], a * back[1], -back[1],
    sx * right[2], sy * up[2], a * back[2], -back[2],
    sx * r, sy * u, a * k + b, -k,
  ]);
}

// A function from a place to pixels and depth; null behind the eye.
function projection(width, height) {
  const m = matrix(width / height);
  return (x, y, z) => {
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (w <= 0) return null;
    return [(0.5 + 0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12]) / w) * width,
      (0.5 - 0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13]) / w) * height, w];
  };
}

function look(box, view) {
  const [low, high] = box;
  const middle = low.map((v, k) => (v + high[k]) / 2);
  const radius = Math.max(5, Math.hypot(...low.map((v, k) => high[k] - v)) / 2);
  camera.target = middle;
  camera.distance = radius / FIELD * 1.25;
  const views = { all: [-0.6, 0.62], top: [0, 1.57], front: [0, 0], side: [-1.57, 0] };
  [camera.yaw, camera.pitch] = views[view] ?? views.all;
}

function pan(dx, dy, height) {
  const { right, up } = axes();
  const scale = 2 * FIELD * camera.distance / height;
  for (let k = 0; k < 3; k++) camera.target[k] += scale * (-dx * right[k] + dy * up[k]);
}

function turn(dx, dy) {
  camera.yaw -= dx;
  camera.pitch = Math.min(1.57, Math.max(-1.2, camera.pitch + dy));
}

function zoom(factor) {
  camera.distance = Math.min(5000, Math.max(1, camera.distance * factor));
}
