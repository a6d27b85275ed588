// A body that moves: its faces, trails and arrows at a moment, which plays and scrubs.
const time = numbers(data.time), attitude = numbers(data.attitude), end = time[time.length - 1];
for (const part of data.parts) part.points = numbers(part.points);
const canvas = document.getElementById("film"), pen = canvas.getContext("2d"), size = canvas.width;
const play = document.getElementById("play"), moment = document.getElementById("moment");
const view = turning(canvas, data.view, draw);
let playing = false, before = 0;

// The rows of a rotation from a unit quaternion, scalar first: body to space.
function rotation(i) {
  const [a, b, c, d] = attitude.subarray(4 * i, 4 * i + 4);
  return [[a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
    [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
    [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d]];
}
const times = (A, B) => A.map((row) => [0, 1, 2].map((j) => row[0] * B[0][j] + row[1] * B[1][j] + row[2] * B[2][j]));
const scale = size / (2 * data.reach);

function path(points, M, first, last) {
  pen.beginPath();
  for (let k = first; k < last; k++) {
    const [x, y, z] = points.subarray(3 * k, 3 * k + 3);
    pen.lineTo(size / 2 + scale * (M[0][0] * x + M[0][1] * y + M[0][2] * z),
      size / 2 - scale * (M[1][0] * x + M[1][1] * y + M[1][2] * z));
  }
}
function depth(points, M) {
  let sum = 0;
  for (let k = 0; k < points.length; k += 3) sum += M[2][0] * points[k] + M[2][1] * points[k + 1] + M[2][2] * points[k + 2];
  return sum;
}
function face(part, M, alpha) {
  path(part.points, M, 0, part.points.length / 3);
  pen.closePath();
  pen.globalAlpha = alpha;
  pen.fillStyle = part.colour;
  pen.fill();
  pen.globalAlpha = 1;
  pen.strokeStyle = "#666666";
  pen.lineWidth = 1.5;
  pen.stroke();
}
function line(part, M, first, last, width, alpha) {
  path(part.points, M, first, last);
  pen.globalAlpha = alpha;
  pen.strokeStyle = part.colour;
  pen.lineWidth = width;
  pen.stroke();
  pen.globalAlpha = 1;
}
function arrow(part, M, i, names) {
  const k = 3 * Math.min(i, part.points.length / 3 - 1), [x, y, z] = part.points.subarray(k, k + 3);
  if (!x && !y && !z) return;  // at rest there is no arrow to name
  const right = scale * (M[0][0] * x + M[0][1] * y + M[0][2] * z), up = scale * (M[1][0] * x + M[1][1] * y + M[1][2] * z);
  // An axis of space that points away is pale; one that lies in the page but for rounding is not.
  const near = M[2][0] * x + M[2][1] * y + M[2][2] * z;
  pen.globalAlpha = part.role === "axis" && near < -1e-6 ? 0.35 : 1;
  const angle = Math.atan2(up, right), [tipX, tipY] = [size / 2 + right, size / 2 - up];
  pen.strokeStyle = pen.fillStyle = part.colour;
  pen.lineWidth = part.role === "axis" ? 1.5 : 3;
  pen.beginPath();
  pen.moveTo(size / 2, size / 2);
  pen.lineTo(tipX, tipY);
  pen.stroke();
  pen.beginPath();
  for (const [back, side] of [[0, 0], [-20, 7], [-20, -7]]) {
    pen.lineTo(tipX + back * Math.cos(angle) - side * Math.sin(angle), tipY - back * Math.sin(angle) - side * Math.cos(angle));
  }
  pen.fill();
  pen.font = "italic 30px Georgia, serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  // Across the arrow, on either side, so far that it is on no name before it.
  const length = Math.hypot(right, up) || 1, room = scale * data.room / 2, ahead = 1 + 0.08 * scale / length;
  const across = [room * up / length || room, -room * right / length];
  const beside = (step) => [ahead * right + step * across[0], ahead * up + step * across[1]];
  const taken = ([x, y]) => names.some((name) => Math.hypot(x - name[0], y - name[1]) < 0.9 * room);
  let place = beside(0);
  for (let n = 2; taken(place); n++) place = beside((n >> 1) * (n % 2 ? -1 : 1));
  names.push(place);
  const name = part.name.replace(/\d/, (digit) => "₀₁₂₃"[digit]);
  pen.lineWidth = 6;
  pen.strokeStyle = "#ffffff";
  pen.strokeText(name, size / 2 + place[0], size / 2 - place[1]);
  pen.fillText(name, size / 2 + place[0], size / 2 - place[1]);
  pen.globalAlpha = 1;
}

function draw() {
  const now = moment.value * end;
  let i = 0, over = time.length - 1;
  while (i < over) {
    const middle = (i + over) >> 1;
    if (time[middle] < now) i = middle + 1; else over = middle;
  }
  const V = view(), B = times(V, rotation(i)), of = (part) => part.of_body ? B : V;
  pen.fillStyle = "#ffffff";
  pen.fillRect(0, 0, size, size);
  const role = (name) => data.parts.filter((part) => part.role === name);
  for (const part of role("face")) if (depth(part.points, B) <= 0) face(part, B, 0.35);
  for (const part of role("trail")) {
    line(part, of(part), 0, part.points.length / 3, 1.5, 0.3);
    line(part, of(part), 0, i + 1, 3, 1);
  }
  // The front is a veil over what is behind it.
  for (const part of role("face")) if (depth(part.points, B) > 0) face(part, B, 0.2);
  const names = [];
  for (const part of [...role("arrow"), ...role("axis")]) arrow(part, of(part), i, names);
  const text = data.words[0] + (data.start + time[i]).toPrecision(data.digits) + data.words[1];
  document.getElementById("time").textContent = text;
  moment.setAttribute("aria-valuetext", text);
}
function run(stamp) {
  if (!playing) return;
  const speed = Number(document.getElementById("speed").value);
  const next = Number(moment.value) + speed * (stamp - (before || stamp)) / (1000 * data.seconds);
  before = stamp;
  moment.value = next < 1 ? next : 0;
  draw();
  requestAnimationFrame(run);
}
function toggle(on) {
  playing = on;
  before = 0;
  play.textContent = on ? "Pause" : "Play";
  if (on) requestAnimationFrame(run);
}
play.addEventListener("click", () => toggle(!playing));
moment.addEventListener("input", () => { toggle(false); draw(); });
draw();
