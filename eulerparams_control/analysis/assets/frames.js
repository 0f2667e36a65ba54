// What is drawn beside the robot: frames, arrows, the path of the tip.

const AXES = [["#d62728", [1, 0, 0]], ["#2ca02c", [0, 1, 0]], ["#2f6fde", [0, 0, 1]]];

// Of coinciding frames all are seen: the longer, the thinner.
const TRIADS = {e: {length: 0.10, radius: 0.0065, opacity: 1},
                c: {length: 0.14, radius: 0.0042, opacity: 0.5},
                d: {length: 0.19, radius: 0.0018, opacity: 1}};
const ARROWS = {f: "#e6007e", mu: "#9467ff"};
const LONGEST = 0.6;  // [m] of an arrow
const SLENDER = 0.08;  // [m] below, an arrow is smaller in all its parts

function triad(name) {
  const {length, radius, opacity} = TRIADS[name];
  const group = new THREE.Group();
  for (const [colour, direction] of AXES) {
    const axis = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, length, 12),
      new THREE.MeshBasicMaterial({color: colour, opacity, transparent: opacity < 1}));
    const along = new THREE.Vector3(...direction);
    pointAlong(axis, along);
    axis.position.copy(along).multiplyScalar(length / 2);
    group.add(axis);
  }
  group.add(label(name, length));
  return group;
}

function label(text, length) {  // beyond the end of the z axis
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const pen = canvas.getContext("2d");
  pen.font = "600 52px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 8;
  pen.strokeStyle = "#ffffff";
  pen.strokeText(text, 32, 30);
  pen.fillStyle = "#1b1f24";
  pen.fillText(text, 32, 30);
  const material = new THREE.SpriteMaterial({map: new THREE.CanvasTexture(canvas),
                                             depthTest: false});
  const sprite = new THREE.Sprite(material);
  sprite.scale.setScalar(0.04);
  sprite.position.set(0, 0, length + 0.02);
  return sprite;
}

function arrow(name) {  // along y, to be turned and scaled; mu has two heads; robots hide neither
  const material = new THREE.MeshBasicMaterial({color: ARROWS[name], depthTest: false,
                                                transparent: true});  // so it is drawn last
  const group = new THREE.Group();
  group.shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.005, 0.005, 1, 12), material);
  group.heads = Array.from({length: name === "mu" ? 2 : 1}, () =>
    new THREE.Mesh(new THREE.ConeGeometry(0.014, 0.035, 16), material));
  group.add(group.shaft, ...group.heads);
  for (const part of group.children) part.renderOrder = 1;
  return group;
}

function pointArrow(group, vector, metresPerUnit) {
  const length = Math.min(vector.length() * metresPerUnit, LONGEST);
  group.visible = length > 2e-3;
  if (!group.visible) return;
  pointAlong(group, vector);
  const scale = Math.min(1, length / SLENDER);
  const [whole, shaft] = [length / scale, length / scale - 0.03];
  group.scale.setScalar(scale);
  group.shaft.scale.y = shaft;
  group.shaft.position.y = shaft / 2;
  group.heads.forEach((head, i) => { head.position.y = whole - 0.0175 - 0.03 * i; });
}

const MOST_POINTS = 500;  // of a path
const SHORTEST = 2e-3;  // [m] of a path that is drawn

function path(points, colour) {  // null if the tip rests
  const kept = [];
  const step = Math.max(1, Math.floor(points.length / 3 / MOST_POINTS));
  for (let i = 0; i < points.length; i += 3 * step) {
    const point = new THREE.Vector3().fromArray(points, i);
    if (!kept.length || point.distanceTo(kept[kept.length - 1]) > 5e-4) kept.push(point);
  }
  const box = new THREE.Box3().setFromPoints(kept);
  if (kept.length < 3 || box.getSize(new THREE.Vector3()).length() < SHORTEST) return null;
  const curve = new THREE.CatmullRomCurve3(kept);
  const geometry = new THREE.TubeGeometry(curve, 2 * kept.length, 0.0022, 6);
  return new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({color: colour}));
}
