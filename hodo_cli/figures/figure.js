// A figure as it is printed. Where a panel shows space, a canvas lies over it, on which it turns and comes nearer; over
// the others the pointer reads the scales. Looks have matplotlib's names and sizes, in points of print.
const box = document.getElementById("figure"), size = document.getElementById("size");
const read = (text) => { document.getElementById("reading").textContent = text; };
const drawn = [];

// The middle of what a panel shows and how far that reaches from it, whatever the direction.
function roomOf(panel) {
  if (panel.reach) return [[0, 0, 0], 1.25 * panel.reach];
  const [least, most] = [(a, b) => Math.min(a, b), (a, b) => Math.max(a, b)];
  const all = panel.strokes.flatMap((stroke) => [...stroke.points]);
  const values = [0, 1, 2].map((i) => all.filter((value, k) => k % 3 === i && isFinite(value)));
  const ends = values.map((along) => [along.reduce(least), along.reduce(most)]);
  const middle = ends.map(([low, high]) => panel.globe ? 0 : (low + high) / 2);
  const squares = values[0].map((_, k) => middle.reduce((sum, value, i) => sum + (values[i][k] - value) ** 2, 0));
  return [middle, 1.04 * Math.sqrt(squares.reduce(most))];
}

function spaceOf(panel) {
  const canvas = box.appendChild(document.createElement("canvas")), pen = canvas.getContext("2d");
  // A globe covers the marks on the edge of its map; elsewhere the printed frame stays in sight.
  const [left, bottom, width, height] = panel.box, edge = panel.globe ? 3 : -0.7;
  const place = { left, top: 1 - bottom - height, width, height };
  for (const side of ["left", "top"]) canvas.style[side] = `calc(${100 * place[side]}% - ${edge}px)`;
  for (const side of ["width", "height"]) canvas.style[side] = `calc(${100 * place[side]}% + ${2 * edge}px)`;
  for (const stroke of panel.strokes) {
    for (const key of ["points", "code", "time"]) stroke[key] = stroke[key] && numbers(stroke[key]);
  }
  const [middle, radius] = roomOf(panel);
  let zoom = 1, point = 1;

  // Thirteen layers show depth, as in print; a globe has two, its near and its far side.
  // An axis that lies in the page but for rounding is near.
  const layerOf = (near) => (panel.globe ? (near < -1e-6 ? -6 : 6) : Math.round(6 * Math.max(-1, Math.min(1, near)))) || 0;
  const opacity = (layer) => panel.globe ? (layer < 0 ? 0.35 : 1) : (18 + layer) / 24;
  const codeOf = (stroke, k) => stroke.code ? stroke.code[k] : 0;

  // The points of a stroke as they are seen: right and down on the canvas, and their layer.
  function project(stroke, M, scale) {
    stroke.seen = [];
    for (let k = 0; k < stroke.points.length; k += 3) {
      const place = middle.map((value, i) => stroke.points[k + i] - value);
      const [right, up, near] = M.map((row) => row[0] * place[0] + row[1] * place[1] + row[2] * place[2]);
      // An enlarged panel shows what is in its box, not what lies before it or behind.
      const away = stroke.time || stroke.look.ls === "" ? Math.max(...place.map(Math.abs)) : 0;
      const layer = panel.reach && away > panel.reach ? null : layerOf(near / radius);
      stroke.seen.push([canvas.width / 2 + scale * right, canvas.height / 2 - scale * up, layer]);
    }
  }
  // Stretches of one colour and layer, each reaching to the next one's first point.
  function* pieces(stroke) {
    for (let k = 1, first = 0; k <= stroke.seen.length; k++) {
      const goesOn = k < stroke.seen.length && stroke.seen[k][2] === stroke.seen[first][2];
      if (goesOn && codeOf(stroke, k) === codeOf(stroke, first)) continue;
      const layer = stroke.seen[first][2];
      if (layer !== null) yield { stroke, first, end: k, layer };
      first = k;
    }
  }
  function line({ stroke, first, end, layer }) {
    const look = stroke.look, width = look.lw ?? 1;
    if (look.ls === "" || !width) return;
    pen.beginPath();
    for (const [x, y] of stroke.seen.slice(first, end + 1)) pen.lineTo(x, y);
    // Mixed with white and not transparent: many turns on one another would make the full colour.
    pen.strokeStyle = `color-mix(in srgb, ${stroke.colours[codeOf(stroke, first)]} ${100 * opacity(layer)}%, white)`;
    pen.lineWidth = width * point;
    pen.setLineDash(Array.isArray(look.ls) ? look.ls[1].map((part) => part * pen.lineWidth) : []);
    pen.stroke();
    pen.setLineDash([]);
  }
  function mark(stroke, k) {
    const look = stroke.look, [x, y] = stroke.seen[k], r = (look.ms ?? 6) * point / 2;
    const d = Math.SQRT2 * r, corners = {
      s: [[-r, -r], [r, -r], [r, r], [-r, r]],
      D: [[-d, 0], [0, -d], [d, 0], [0, d]],
    };
    pen.beginPath();
    if (look.marker in corners) for (const [right, down] of corners[look.marker]) pen.lineTo(x + right, y + down);
    else pen.arc(x, y, look.marker === "." ? r / 2 : r, 0, 7);
    pen.closePath();
    pen.fillStyle = look.mfc ?? stroke.colours[codeOf(stroke, k)];
    pen.fill();
    if (!look.mec) return;
    pen.strokeStyle = look.mec;
    pen.lineWidth = look.mew * point;
    pen.stroke();
  }
  // Whether numbers along an axis, which is looked at along it, would stand on one another, as in print.
  function isShort({ look, points, seen }, scale) {
    const length = scale * Math.hypot(...[0, 1, 2].map((i) => points[points.length - 3 + i] - points[i]));
    const [first, last] = [seen[0], seen[seen.length - 1]];
    return look.lw === 0 && Math.hypot(last[0] - first[0], last[1] - first[1]) < 0.5 * length;
  }
  // Beside its point, away from the middle.
  function word(stroke, k) {
    const [x, y] = stroke.seen[k], [right, down] = [x - canvas.width / 2, y - canvas.height / 2];
    const away = 6 * point / (Math.hypot(right, down) || 1);
    pen.font = `${(stroke.look.size ?? 8.4) * point}px Georgia, serif`;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.strokeStyle = "#ffffff";
    pen.lineWidth = 3 * point;
    pen.fillStyle = stroke.colours[codeOf(stroke, k)];
    for (const write of ["strokeText", "fillText"]) pen[write](stroke.texts[k], x + away * right, y + away * down);
  }
  function draw() {
    canvas.width = canvas.clientWidth * devicePixelRatio;
    canvas.height = canvas.clientHeight * devicePixelRatio;
    point = canvas.width / (panel.box[2] * data.points);
    const M = view(), scale = zoom * (Math.min(canvas.width, canvas.height) / 2 - 10 * point) / radius;
    pen.fillStyle = "#ffffff";
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.lineJoin = pen.lineCap = "round";
    if (panel.globe) {
      pen.beginPath();
      pen.arc(canvas.width / 2, canvas.height / 2, scale, 0, 7);
      pen.fillStyle = "#f8f8f8";
      pen.fill();
    }
    for (const stroke of panel.strokes) project(stroke, M, scale);
    const all = panel.strokes.flatMap((stroke) => [...pieces(stroke)]);
    for (const piece of all.sort((a, b) => a.layer - b.layer)) {
      pen.globalAlpha = 1;
      line(piece);
      pen.globalAlpha = opacity(piece.layer);
      for (let k = piece.first; k < piece.end; k++) {
        if (piece.stroke.look.marker) mark(piece.stroke, k);
        const isNamed = piece.stroke.look.ls !== "" && piece.stroke.texts[k];
        if (isNamed && !isShort(piece.stroke, scale)) word(piece.stroke, k);
      }
    }
    pen.globalAlpha = 1;
  }
  const view = turning(canvas, panel.angles, draw);

  // What the pointer tells of the nearest sample or mark.
  function reading(stroke, k) {
    if (!stroke.time) return stroke.texts[k];
    const places = panel.names.map((name, i) => `${name} = ${stroke.points[3 * k + i].toPrecision(5)}`);
    const time = `${data.time[0]} = ${stroke.time[k].toPrecision(6)}${data.time[1]}`;
    return [stroke.name, time, ...places].filter(Boolean).join(", ");
  }
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) return;
    let distance = 12 * devicePixelRatio, text = "";
    const known = panel.strokes.filter((stroke) => stroke.time || stroke.look.ls === "" && stroke.texts.length);
    for (const stroke of known) {
      stroke.seen.forEach(([x, y, layer], k) => {
        if (layer === null) return;
        const apart = Math.hypot(x - event.offsetX * devicePixelRatio, y - event.offsetY * devicePixelRatio);
        // A mark comes behind its curve, and counts where both are as near.
        if (apart <= distance) [distance, text] = [apart, reading(stroke, k)];
      });
    }
    read(text);
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom *= 2 ** (-event.deltaY / 400);
    draw();
  });
  canvas.addEventListener("dblclick", () => { zoom = 1; draw(); });
  drawn.push(draw);
}

// The values of both scales of a plane panel at a place, as parts of its width and height.
function scales(panel, place) {
  return panel.scales.map(({ label, ends: [low, high], log }, i) => {
    const value = log ? low * (high / low) ** place[i] : low + (high - low) * place[i];
    return label && `${label} = ${value.toPrecision(4)}`;
  }).filter(Boolean).join(", ");
}
box.addEventListener("pointermove", (event) => {
  if (event.target.tagName === "CANVAS") return;
  const whole = box.getBoundingClientRect();
  const at = [(event.clientX - whole.left) / whole.width, (whole.bottom - event.clientY) / whole.height];
  let text = "";
  // An inset comes behind its panel, and counts before it.
  for (const panel of data.panels) {
    const place = at.map((part, i) => (part - panel.box[i]) / panel.box[2 + i]);
    if (panel.scales && place.every((part) => part >= 0 && part <= 1)) text = scales(panel, place);
  }
  read(text);
});

function fit() {
  // As wide as the window lets it, and no higher.
  const high = (innerHeight - 180) * data.points / data.height;
  box.style.width = size.value * Math.min(box.parentElement.clientWidth, Math.max(high, 320)) + "px";
  for (const draw of drawn) draw();
}
data.panels.filter((panel) => panel.strokes).forEach(spaceOf);
size.addEventListener("input", fit);
addEventListener("resize", fit);
fit();
