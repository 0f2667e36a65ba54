"""The look and the behaviour of the page: its style sheet and its script."""

STYLE = """
:root { --text: #1b1f24; --soft: #5b6470; --line: #d5dae0; --grid: #e8ebee; --ground: #ffffff;
  --raised: #f4f6f8; --differs: #fff3cd; --yes: #00734f; --no: #b3261e; }
@media screen and (prefers-color-scheme: dark) {
  :root { --text: #e6e9ec; --soft: #a2abb5; --line: #3a424b; --grid: #2a3037; --ground: #14171b;
    --raised: #1d2227; --differs: #453a12; --yes: #3ecf9c; --no: #ff8a80; color-scheme: dark; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1280px; padding: 24px 28px 64px; color: var(--text);
  background: var(--ground); font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Noto Sans",
  "Liberation Sans", sans-serif; }
h1 { font-size: 25px; line-height: 1.3; font-weight: 600; margin: 0 0 8px; max-width: 52em;
  text-wrap: balance; overflow-wrap: anywhere; }
h2 { font-size: 18px; font-weight: 600; margin: 40px 0 8px; }
h3 { font-size: 15px; font-weight: 600; margin: 0 0 2px; }
p { margin: 0 0 8px; }
.claim, figcaption, .note { color: var(--soft); }
.claim { overflow-wrap: anywhere; }
.warning { border-left: 4px solid var(--no); background: var(--raised); padding: 8px 12px;
  overflow-wrap: anywhere; }
figure { margin: 24px 0 0; min-width: 0; break-inside: avoid; }
figcaption, .note { font-size: 13px; line-height: 1.45; max-width: 80em; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(500px, 100%), 1fr));
  column-gap: 32px; }
.runs { position: sticky; top: 0; z-index: 9; padding: 6px 0; background: var(--ground); }
.runs button { font: inherit; font-size: 13px; color: inherit; background: none; cursor: pointer;
  border: 0; padding: 2px 16px 2px 0; }
.runs button.hidden { opacity: 0.4; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 16px 5px 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
td.number, th.number { text-align: right; }
td.number, .whole { white-space: nowrap; }
td.value { overflow-wrap: anywhere; min-width: 7em; }
tbody th { font-weight: 400; white-space: pre; }
.group td, .group th { border-top: 2px solid var(--line); }
.differs td { background: var(--differs); }
.differs th { font-weight: 600; }
.yes { color: var(--yes); font-weight: 600; white-space: nowrap; }
.no { color: var(--no); font-weight: 600; white-space: nowrap; }
.key { display: inline-block; width: 11px; height: 11px; border-radius: 2px; margin-right: 6px; }
details { margin-top: 12px; }
summary { cursor: pointer; color: var(--soft); }
@media print {
  body { padding: 0; max-width: none; font-size: 10pt; }
  h1 { font-size: 15pt; } h2 { margin-top: 18pt; break-after: avoid; }
  tr, .warning, .runs { break-inside: avoid; } .scroll { overflow: visible; }
  .runs { position: static; break-after: avoid; } .modebar-container { display: none; }
  table { font-size: 8.5pt; }
  .plots { display: block; } details:not([open]) { display: none; }
  * { print-color-adjust: exact; } }
"""

SCRIPT = """
"use strict";
const plots = [...document.querySelectorAll(".plot")];
const figures = JSON.parse(document.getElementById("figures").textContent);
const config = {responsive: true, displaylogo: false, displayModeBar: "hover",
                showSendToCloud: false, plotlyServerURL: "",  // nothing leaves the machine
                modeBarButtonsToRemove: ["select2d", "lasso2d"]};
const axesOf = (layout, letter) =>
  Object.keys(layout).filter(key => key.startsWith(letter + "axis"));

function theme(layout) {  // the colours of the style sheet, which follow the system
  const style = getComputedStyle(document.documentElement);
  const colour = name => style.getPropertyValue(name).trim();
  const look = {paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    "font.color": colour("--text"), "font.family": getComputedStyle(document.body).fontFamily,
    "font.size": 12, "hoverlabel.bgcolor": colour("--raised"),
    "hoverlabel.bordercolor": colour("--line"), "hoverlabel.font.color": colour("--text"),
    "modebar.bgcolor": "rgba(0,0,0,0)", "modebar.color": colour("--line"),
    "modebar.activecolor": colour("--soft")};
  for (const axis of [...axesOf(layout, "x"), ...axesOf(layout, "y")]) {
    look[axis + ".gridcolor"] = colour("--grid");
    look[axis + ".linecolor"] = colour("--line");
  }
  return look;
}

let linking = false;
function everywhere(change) {  // change all plots, without answering to one's own changes
  if (linking) return;
  linking = true;
  Promise.all(plots.map(change)).finally(() => { linking = false; });
}

function linkTime(source) {
  source.on("plotly_relayout", event => {
    const changed = Object.keys(event).find(key => /^xaxis\\d*\\.(range|autorange)/.test(key));
    if (!changed) return;
    const range = source.layout[changed.split(".")[0]].range.slice();
    everywhere(plot => Plotly.relayout(plot, Object.fromEntries(
      axesOf(plot.layout, "x").map(axis => [axis + ".range", range]))));
  });
}

const hidden = new Set();
function toggle(run) {  // hide or show a run in all plots
  if (!hidden.delete(run)) hidden.add(run);
  for (const plot of plots)
    Plotly.restyle(plot, {visible: plot.data.map(trace => !hidden.has(trace.legendgroup))});
  for (const button of buttons) button.classList.toggle("hidden", hidden.has(button.dataset.run));
}
const buttons = [...document.querySelectorAll(".runs button")];
for (const button of buttons) button.addEventListener("click", () => toggle(button.dataset.run));

function linkLegend(plot) {
  plot.on("plotly_legendclick", event => {
    toggle(event.data[event.curveNumber].legendgroup);
    return false;
  });
  plot.on("plotly_legenddoubleclick", () => false);
}

figures.forEach((figure, i) => Plotly.newPlot(plots[i], figure.data, figure.layout, config)
  .then(plot => Plotly.relayout(plot, theme(plot.layout)))
  .then(plot => { linkTime(plot); linkLegend(plot); }));

function restyle() {
  plots.forEach(plot => { Plotly.relayout(plot, theme(plot.layout)); Plotly.Plots.resize(plot); });
}
for (const query of ["print", "(prefers-color-scheme: dark)"])
  matchMedia(query).addEventListener("change", restyle);
"""
