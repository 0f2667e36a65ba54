// All together. What a console, or a test, may look at is in window.page.

theme.apply();
watchPlots();
cursor.keep(cursor.whole[0]);
setTimeout(() => {  // after the first plots
  replay.start();
  document.documentElement.dataset.ready = "true";
}, 0);
window.page = {cursor, plots, replay, theme, player};
