// All together. What a console, or a test, may look at is in window.page.

for (const link of $$(".bar nav a"))  // a link opens the section that it leads to
  link.addEventListener("click", () => { $(link.getAttribute("href")).open = true; });

theme.apply();
watchPlots();
cursor.keep(cursor.whole[0]);
setTimeout(() => {  // after the first plots
  replay.start();
  document.documentElement.dataset.ready = "true";
}, 0);
window.page = {cursor, plots, replay, theme, player};
