// What the pages of space share: packed numbers, and a view that a reader turns.

const numbers = (text) => new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);

// The rows of a view: right, up and toward the reader, as printed figures are seen. To drag over the canvas turns it, a
// double click turns it back; both draw anew.
function turning(canvas, degrees, draw) {
  const printed = degrees.map((angle) => angle * Math.PI / 180);
  let [elevation, azimuth] = printed;
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    azimuth -= event.movementX / 150;
    elevation = Math.max(-1.57, Math.min(1.57, elevation + event.movementY / 150));
    draw();
  });
  canvas.addEventListener("dblclick", () => {
    [elevation, azimuth] = printed;
    draw();
  });
  return () => {
    const [ce, se, ca, sa] = [Math.cos(elevation), Math.sin(elevation), Math.cos(azimuth), Math.sin(azimuth)];
    return [[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]];
  };
}
