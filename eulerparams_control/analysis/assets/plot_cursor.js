// The line of the cursor in every plot: laid over it, so that moving it draws no plot again.

const CLICK = 4;  // [px] that a pointer may move between down and up

function addLine(plot) {
  plot.line = create("div", "line", plot.element);
  plot.graph.addEventListener("pointermove", event => onMove(plot, event));
  plot.graph.addEventListener("pointerleave", () => cursor.endPreview());
  plot.graph.addEventListener("pointerdown", event => onDown(plot, event), true);
  placeLine(plot);
}

function timeAt(plot, event) {  // null beside the axes
  const {xaxis} = plot.graph._fullLayout;
  const x = event.clientX - plot.graph.getBoundingClientRect().left - xaxis._offset;
  return x < 0 || x > xaxis._length ? null : xaxis.p2d(x);
}

function onMove(plot, event) {
  if (event.buttons) return;  // a zoom is being drawn
  const time = timeAt(plot, event);
  if (time === null) cursor.endPreview();
  else cursor.preview(time);
}

function onDown(plot, down) {
  addEventListener("pointerup", up => {
    const moved = Math.hypot(up.clientX - down.clientX, up.clientY - down.clientY);
    const time = timeAt(plot, up);
    if (down.button === 0 && moved < CLICK && time !== null) cursor.keep(time);
  }, {once: true, capture: true});
}

function placeLine(plot) {
  if (!plot.line || !plot.inSight) return;
  const {xaxis, yaxis} = plot.graph._fullLayout;
  const x = xaxis.d2p(cursor.time);
  const inside = x >= -1 && x <= xaxis._length + 1;
  const {style} = plot.line;
  style.display = inside ? "" : "none";
  style.top = `${yaxis._offset}px`;
  style.height = `${yaxis._length}px`;
  style.transform = `translateX(${(xaxis._offset + x).toFixed(1)}px)`;
}

function placeLines() { plots.forEach(placeLine); }

cursor.listeners.push(placeLines);
addEventListener("resize", () => setTimeout(placeLines, 200));  // after plotly's own answer
