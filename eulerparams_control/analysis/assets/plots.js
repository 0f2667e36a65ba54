// The plots: drawn when they come into sight; zoom, and what is hidden, are those of all.

const config = {responsive: true, displaylogo: false, displayModeBar: "hover",
                showSendToCloud: false, plotlyServerURL: "",  // nothing leaves the machine
                doubleClick: false, doubleClickDelay: 500,
                modeBarButtonsToRemove: ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d",
                                         "autoScale2d"]};  // as few as leave room for a title

const hidden = new Set();  // runs, as text

const plots = read("figures").map((figure, index) => {
  const element = $$(".plot")[index];
  return {figure, element, graph: create("div", "graph", element), drawn: false, painted: false,
          inSight: false, stale: false, range: figure.layout.xaxis.range.slice(), line: null};
});

function look() {  // the colours of the style sheet
  const clear = "rgba(0,0,0,0)";
  const changes = {paper_bgcolor: clear, plot_bgcolor: clear, "font.color": theme.colour("--text"),
    "font.family": getComputedStyle(document.body).fontFamily, "font.size": 12,
    "hoverlabel.bgcolor": theme.colour("--raised"),
    "hoverlabel.bordercolor": theme.colour("--line"),
    "hoverlabel.font.color": theme.colour("--text"), "modebar.bgcolor": clear,
    "modebar.color": theme.colour("--line"), "modebar.activecolor": theme.colour("--soft")};
  for (const axis of ["xaxis", "yaxis"]) {
    changes[axis + ".gridcolor"] = theme.colour("--grid");
    changes[axis + ".linecolor"] = theme.colour("--line");
  }
  return changes;
}

function assign(target, changes) {  // "a.b": c becomes target.a.b = c
  for (const [path, value] of Object.entries(changes)) {
    const names = path.split(".");
    const last = names.pop();
    names.reduce((object, name) => object[name] ??= {}, target)[last] = value;
  }
}

const isPredicted = trace => trace.meta === "prediction";
const isVisible = trace => !hidden.has(trace.legendgroup);

function draw(plot) {
  plot.drawn = plot.painted = true;
  const {data, layout} = plot.figure;
  plot.figure.y = {range: layout.yaxis.range?.slice()};
  assign(layout, look());
  layout.xaxis.range = plot.range.slice();
  for (const trace of data) {
    trace.visible = isVisible(trace);
    if (isPredicted(trace)) trace.line.color = theme.colour("--text");
  }
  return Plotly.newPlot(plot.graph, data, layout, config).then(() => {
    plot.graph.on("plotly_relayout", event => onRelayout(plot, event));
    plot.graph.on("plotly_doubleclick", () => zoomOut(plot));
    addLine(plot);
  });
}

let linking = false;  // while plots follow one, they do not lead
function onRelayout(plot, event) {
  if (linking || !Object.keys(event).some(key => /^xaxis\.(range|autorange)/.test(key))) return;
  cursor.zoom(...plot.graph.layout.xaxis.range);
}

function zoomOut({graph, figure}) {  // to the whole of the time, and of this plot's values
  const {range} = figure.y;
  Plotly.relayout(graph, range ? {"yaxis.range": range.slice()} : {"yaxis.autorange": true});
  cursor.zoom(...cursor.whole);
}

function showRange(low, high) {
  for (const plot of plots) {
    plot.range = [low, high];
    plot.stale = true;
  }
  refresh();
}

function refresh() {  // draw what is in sight, and bring it up to date
  linking = true;
  const changes = plots.filter(plot => plot.inSight).map(plot => {
    const {drawn, painted, stale} = plot;
    plot.stale = false;
    if (!drawn) return draw(plot);
    if (!painted) paint(plot);
    return stale && Plotly.relayout(plot.graph, {"xaxis.range": plot.range.slice()});
  });
  Promise.all(changes).finally(() => { linking = false; placeLines(); });
}

function toggleRun(run) {  // hide or show a run everywhere
  if (!hidden.delete(run)) hidden.add(run);
  for (const plot of plots.filter(plot => plot.drawn))
    Plotly.restyle(plot.graph, {visible: plot.graph.data.map(isVisible)});
  for (const button of $$("[data-run]"))
    button.setAttribute("aria-pressed", String(!hidden.has(button.dataset.run)));
}

function restyle() {  // on paper all are in sight
  for (const plot of plots) {
    plot.painted = false;
    if (plot.drawn && (plot.inSight || theme.onPaper)) paint(plot);
  }
}

function paint(plot) {
  plot.painted = true;
  const {data} = plot.graph;
  const predicted = [...data.keys()].filter(index => isPredicted(data[index]));
  if (predicted.length)
    Plotly.restyle(plot.graph, {"line.color": theme.colour("--text")}, predicted);
  Plotly.relayout(plot.graph, look());
}

function watchPlots() {
  const watcher = new IntersectionObserver(entries => {
    for (const entry of entries)
      plots.find(plot => plot.element === entry.target).inSight = entry.isIntersecting;
    refresh();
  }, {rootMargin: "400px"});
  for (const plot of plots) watcher.observe(plot.element);
}

function drawAll() {  // that are in open sections: for paper
  for (const plot of plots)
    if (!plot.drawn && plot.element.offsetParent) draw(plot);
}

cursor.rangeListeners.push(showRange);
theme.listeners.push(restyle);
for (const button of $$("[data-run]"))
  button.addEventListener("click", () => toggleRun(button.dataset.run));
