// Light or dark: as the system has it, until the button says otherwise.

const theme = {
  listeners: [],
  wanted: attempt(() => localStorage.getItem("theme")),
  system: matchMedia("(prefers-color-scheme: dark)"),
  paper: matchMedia("print"),
  printing: false,

  get onPaper() { return this.printing || this.paper.matches; },
  get name() {
    if (this.onPaper) return "light";
    return this.wanted || (this.system.matches ? "dark" : "light");
  },
  apply() {
    document.documentElement.dataset.theme = this.name;
    for (const listener of this.listeners) listener();
  },
  toggle() {
    this.wanted = this.name === "dark" ? "light" : "dark";
    attempt(() => localStorage.setItem("theme", this.wanted));
    this.apply();
  },
  colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  },
};

theme.system.addEventListener("change", () => theme.apply());
theme.paper.addEventListener("change", () => theme.apply());
$("#theme").addEventListener("click", () => theme.toggle());
