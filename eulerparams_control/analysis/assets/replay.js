// The replay: which runs and which parts are shown, at the instant of the cursor.

const TRANSLUCENT = 0.42;

const replay = {
  stage: null,
  runs: [],
  geometries: [],  // of each robot

  start() {
    const canvas = $("#replay canvas");
    const problem = this.problem(canvas);
    if (problem) {
      $("#replay").classList.add("missing");
      $("#replay .message").textContent = problem;
      $("#replay .message").hidden = false;
      return;
    }
    this.stage = new Stage(canvas, this.context);
    this.geometries = replayData.robots.map(robot => robot?.meshes.map(geometryOf));
    this.runs = replayData.runs.map(run => new ReplayedRun(run, replayData.robots[run.robot]));
    this.choose();
    this.stage.resize();
    this.fit();
    cursor.listeners.push(() => this.update());
  },

  problem(canvas) {
    if (!THREE) return "The 3D library (meshcat) was not installed where this page was written.";
    this.context = attempt(() => canvas.getContext("webgl2", {alpha: true, antialias: true}));
    return this.context ? "" : "This browser does not offer WebGL, which the replay needs.";
  },

  get layers() {
    return new Set($$("[data-layer]:checked").map(box => box.dataset.layer));
  },

  get shown() {  // indices of runs
    const boxes = $$("[data-shown]");
    const chosen = boxes.length ? boxes.filter(box => box.checked).map(box => +box.dataset.shown)
                                : [0];
    return chosen.filter(index => !hidden.has(String(index)));
  },

  choose() {  // the first is solid, the others are translucent
    for (const run of this.runs) if (run.group) this.stage.scene.remove(run.group);
    this.shown.forEach((index, place) => {
      const run = this.runs[index];
      run.looks ??= {};
      const opacity = place ? TRANSLUCENT : 1;
      run.group = run.looks[opacity]?.group;
      if (!run.group) run.looks[opacity] = this.build(run, replayData.runs[index], opacity);
      Object.assign(run, run.looks[opacity]);
      this.stage.scene.add(run.group);
    });
    this.update();
  },

  build(run, {robot, colour}, opacity) {
    const data = replayData.robots[robot];
    const tint = this.runs.length > 1 ? colour : "";
    const body = data && new Robot(data, this.geometries[robot], tint, opacity);
    run.build(body, colour, replayData.arrow);
    const {group, parts, dot} = run;
    return {group, parts, dot, robot: run.robot};
  },

  update() {
    for (const index of this.shown) this.runs[index].show(cursor.time, this.layers);
    this.stage.invalidate();
  },

  fit() {  // the robots in the whole of their motion
    const box = new THREE.Box3();
    const {layers} = this;
    for (const index of this.shown.length ? this.shown : [0]) {
      const run = this.runs[index];
      for (let step = 0; step <= 4; step++) {
        run.show(cursor.whole[0] + step / 4 * (cursor.whole[1] - cursor.whole[0]), layers);
        box.expandByObject(run.robot ? run.robot.root : run.parts.e);
        box.expandByPoint(run.parts.e.position);
      }
    }
    box.expandByPoint(new THREE.Vector3());
    this.stage.orbit.fit(box);
    this.update();
  },

  pin() {
    const pinned = $("#replay").classList.toggle("pinned");
    $("#pin").setAttribute("aria-pressed", String(pinned));
  },
};

for (const box of $$("[data-shown]")) box.addEventListener("change", () => replay.choose());
for (const box of $$("[data-layer]")) box.addEventListener("change", () => replay.update());
for (const button of $$("[data-run]")) button.addEventListener("click", () => {
  if (replay.stage) replay.choose();
});
$("#fit").addEventListener("click", () => replay.fit());
$("#pin").addEventListener("click", () => replay.pin());
