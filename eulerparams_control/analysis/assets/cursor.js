// The instant that plots and replay show, and the range of time that the plots show.

const replayData = read("replay-data");

const cursor = {
  whole: replayData.range,
  range: replayData.range.slice(),
  time: replayData.range[0],
  kept: replayData.range[0],
  playing: false,
  speed: 1,
  listeners: [],       // called with the time
  rangeListeners: [],  // called with the range

  show(time) {
    this.time = clamp(time, ...this.whole);
    for (const listener of this.listeners) listener(this.time);
  },
  keep(time) {  // show it until another one is kept
    this.kept = clamp(time, ...this.whole);
    this.show(this.kept);
  },
  preview(time) { if (!this.playing) this.show(time); },
  endPreview() { if (!this.playing) this.show(this.kept); },

  zoom(low, high) {
    const [start, end] = this.whole;
    this.range = [Math.max(low, start), Math.min(high, end)];
    if (this.range[0] >= this.range[1]) this.range = this.whole.slice();
    for (const listener of this.rangeListeners) listener(low, high);
  },
};
