// On paper: every plot of an open section, as wide as paper has room, and the replay as it is seen.

const PAPER = {top: 680, wide: 222, other: 334};  // [px] widths of plots, as in the style sheet

function paperWidth({element}) {
  if (element.closest(".top")) return PAPER.top;
  return element.closest(".wide") ? PAPER.wide : PAPER.other;
}

function print(printing) {
  theme.printing = printing;
  theme.apply();
}

addEventListener("beforeprint", () => {
  drawAll();
  print(true);
  for (const plot of plots.filter(({drawn}) => drawn))
    Plotly.relayout(plot.graph, {width: paperWidth(plot), "xaxis.range": plot.range.slice()});
  if (replay.stage) $("#replay .printed").src = replay.stage.picture();
});

addEventListener("afterprint", () => {
  print(false);
  for (const plot of plots.filter(({drawn}) => drawn))
    Plotly.relayout(plot.graph, {width: null, autosize: true}).then(placeLines);
});
