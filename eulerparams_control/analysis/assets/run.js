// A run in the replay: its robot, its frames, its wrench, its path, at any instant.

const SHORT_WAY = 2 * Math.PI;

class ReplayedRun {
  constructor(data, robotData) {
    this.t = unpack(data.t);
    this.q = unpack(data.q);
    this.n = data.n;
    this.p = unpack(data.p);
    this.frames = {};
    for (const name of ["d", "c"])
      if (data[name]) this.frames[name] = {p: unpack(data[name].p), o: unpack(data[name].o)};
    this.wrench = {f: unpack(data.f), mu: unpack(data.mu)};
    this.continuous = new Set((robotData?.joints ?? [])
      .filter(({kind, index}) => kind === "continuous" && index >= 0).map(({index}) => index));
  }

  build(robot, colour, arrowScale) {
    this.robot = robot;
    this.arrowScale = arrowScale;
    this.group = new THREE.Group();
    this.parts = {e: triad("e"), path: path(this.p, colour)};
    for (const name of Object.keys(this.frames)) this.parts[name] = triad(name);
    for (const name of ["f", "mu"]) if (this.wrench[name]) this.parts[name] = arrow(name);
    this.dot = new THREE.Mesh(new THREE.SphereGeometry(0.011, 20, 14),
                              new THREE.MeshBasicMaterial({color: colour}));
    if (robot) this.group.add(robot.root);
    this.group.add(this.dot, ...Object.values(this.parts).filter(Boolean));
    return this.group;
  }

  show(time, layers) {
    const [i, s] = this.#place(time);
    this.#placeTip(i, s);
    for (const [name, {p, o}] of Object.entries(this.frames)) {
      const part = this.parts[name];
      part.visible = layers.has(name) && this.#vector(p, i, s, part.position);
      if (part.visible) this.#quaternion(o, i, s, part.quaternion);
    }
    for (const name of ["f", "mu"]) this.#placeArrow(name, i, s, layers);
    this.parts.e.visible = layers.has("e");
    if (this.parts.path) this.parts.path.visible = layers.has("path");
  }

  #placeTip(i, s) {
    const {e} = this.parts;
    this.#vector(this.p, i, s, e.position);
    if (this.robot) {
      this.robot.setJoints(this.joints(i, s));
      this.robot.tip.matrixWorld.decompose(e.position, e.quaternion, new THREE.Vector3());
    }
    this.dot.position.copy(e.position);
  }

  #placeArrow(name, i, s, layers) {
    const part = this.parts[name];
    if (!part) return;
    const vector = new THREE.Vector3();
    part.position.copy(this.parts.e.position);
    part.visible = layers.has(name) && this.#vector(this.wrench[name], i, s, vector);
    if (part.visible) pointArrow(part, vector, this.arrowScale[name]);
  }

  joints(i, s) {
    return Array.from({length: this.n}, (_, joint) => {
      const [a, b] = [this.q[i * this.n + joint], this.q[(i + 1) * this.n + joint] ?? NaN];
      let change = Number.isFinite(b) ? b - a : 0;
      if (this.continuous.has(joint)) change -= SHORT_WAY * Math.round(change / SHORT_WAY);
      return a + s * change;
    });
  }

  #place(time) {  // the step before an instant, and how far it is to the next
    let [low, high] = [0, this.t.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.t[middle] <= time) low = middle;
      else high = middle;
    }
    if (high === low) return [0, 0];
    return [low, clamp((time - this.t[low]) / (this.t[high] - this.t[low]), 0, 1)];
  }

  #vector(values, i, s, target) {  // false where it is not known
    const [a, b] = this.#pair(values, i, s, 3);
    if (!a) return false;
    target.fromArray(a).lerp(new THREE.Vector3().fromArray(b), s);
    return true;
  }

  #quaternion(values, i, s, target) {
    const [a, b] = this.#pair(values, i, s, 4);
    if (a) target.fromArray(a).slerp(new THREE.Quaternion().fromArray(b), s);
  }

  #pair(values, i, s, size) {  // what is known at two steps; where one is not, the other
    const at = step => values.subarray(size * step, size * (step + 1));
    const known = row => row.length === size && row.every(Number.isFinite);
    const [a, b] = [at(i), at(i + 1)];
    if (known(a)) return [a, known(b) ? b : a];
    return s > 0.999 && known(b) ? [b, b] : [null, null];
  }
}
