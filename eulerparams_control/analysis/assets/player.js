// Play, pause, step, speed: by buttons and keys.

const STEP = 0.005;  // of the range of time, for an arrow key; ten times with Shift
const TICKS = 10000;  // of the slider

const player = {
  button: $("#play"),
  slider: $("#time"),
  output: $("#now"),
  last: null,  // [ms] of the last picture

  toggle() {
    if (cursor.playing) this.pause();
    else this.play();
  },
  play() {
    const [start, end] = cursor.range;
    if (cursor.kept < start || cursor.kept >= end) cursor.keep(start);
    cursor.show(cursor.kept);
    this.mark(true);
    this.last = null;
    requestAnimationFrame(now => this.tick(now));
  },
  pause() { this.mark(false); },

  mark(playing) {
    cursor.playing = playing;
    this.button.textContent = playing ? "❚❚" : "▶";
    this.button.setAttribute("aria-label", playing ? "Pause" : "Play");
  },
  tick(now) {
    if (!cursor.playing) return;
    const passed = this.last === null ? 0 : (now - this.last) / 1000;
    this.last = now;
    cursor.keep(Math.min(cursor.kept + cursor.speed * passed, cursor.range[1]));
    if (cursor.kept >= cursor.range[1]) this.pause();
    else requestAnimationFrame(next => this.tick(next));
  },
  step(count) {
    const [start, end] = cursor.range;
    cursor.keep(clamp(cursor.kept + count * STEP * (end - start), start, end));
  },
  show(time) {
    const [start, end] = cursor.range;
    this.slider.value = TICKS * (time - start) / (end - start);
    this.slider.setAttribute("aria-valuetext", `${time.toFixed(3)} s`);
    this.output.textContent = `${time.toFixed(3)} s`;
  },
  scrub() {
    const [start, end] = cursor.range;
    cursor.keep(start + this.slider.value / TICKS * (end - start));
  },
  onKey(event) {
    const own = event.target.closest("input, select, textarea, button, a, summary, label");
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const action = {" ": () => this.toggle(),
                    ArrowLeft: () => this.step(event.shiftKey ? -10 : -1),
                    ArrowRight: () => this.step(event.shiftKey ? 10 : 1)}[event.key];
    if (!action || (own && (event.key === " " || own.matches("input, select")))) return;
    event.preventDefault();
    action();
  },
};

player.slider.min = 0;
player.slider.max = TICKS;
player.slider.step = 1;
player.button.addEventListener("click", () => player.toggle());
player.slider.addEventListener("input", () => player.scrub());
$("#speed").addEventListener("change", event => { cursor.speed = Number(event.target.value); });
document.addEventListener("keydown", event => player.onKey(event));
cursor.listeners.push(time => player.show(time));
cursor.rangeListeners.push(() => player.show(cursor.time));
