// A robot: its links as a tree of objects, moved by the positions of its joints.

const PLAIN = "#b9c0c9";  // where the URDF states no colour
const SHADES = [1, 0.82];  // links in turn, so that they can be told apart

class Robot {
  constructor(data, geometries, colour, opacity) {
    this.root = new THREE.Group();
    this.links = new Map(data.links.map(name => [name, new THREE.Group()]));
    this.joints = data.joints.map(joint => this.#joint(joint));
    this.links.forEach(link => { if (!link.parent) this.root.add(link); });
    this.tip = this.links.get(data.tip);
    this.#paint = {colour, opacity};
    for (const visual of data.visuals) this.#visual(visual, geometries, data.links);
    this.#standOnBase(data.base);
    for (const name of data.bones) this.#bone(name);
  }

  #paint;

  setJoints(q) {
    for (const {index, mover, axis, kind} of this.joints) {
      if (index < 0) continue;
      if (kind === "prismatic") mover.position.copy(axis).multiplyScalar(q[index]);
      else mover.quaternion.setFromAxisAngle(axis, q[index]);
    }
    this.root.updateMatrixWorld(true);
  }

  #joint({name, parent, child, index, axis, kind, xyz, rpy}) {
    const mount = placed(new THREE.Group(), xyz, rpy);
    const mover = this.links.get(child);
    mount.add(mover);
    this.links.get(parent).add(mount);
    return {name, parent, child, index, kind, mount, mover,
            axis: new THREE.Vector3(...axis).normalize()};
  }

  #standOnBase(base) {  // all poses are seen from the base
    this.root.updateMatrixWorld(true);
    const inverse = this.links.get(base).matrixWorld.clone().invert();
    inverse.decompose(this.root.position, this.root.quaternion, this.root.scale);
    this.root.updateMatrixWorld(true);
  }

  #visual(visual, geometries, names) {
    const mesh = new THREE.Mesh(shapeOf(visual, geometries), this.#material(visual.colour,
      SHADES[names.indexOf(visual.link) % SHADES.length]));
    placed(mesh, visual.xyz, visual.rpy);
    if (visual.scale) mesh.scale.set(...visual.scale);
    if (visual.cylinder || visual.capsule) mesh.rotateX(Math.PI / 2);  // theirs is y, URDF's is z
    this.links.get(visual.link).add(mesh);
  }

  #bone(name) {  // from the link before a joint to its origin
    const {parent, mount} = this.joints.find(joint => joint.name === name);
    const length = mount.position.length();
    const ball = new THREE.Mesh(new THREE.SphereGeometry(0.022, 20, 14), this.#material("", 0.8));
    mount.add(ball);
    if (length < 1e-3) return;
    const bone = new THREE.Mesh(new THREE.CylinderGeometry(0.014, 0.014, length, 16),
                                this.#material("", 1));
    pointAlong(bone, mount.position);
    bone.position.copy(mount.position).multiplyScalar(0.5);
    this.links.get(parent).add(bone);
  }

  #material(stated, shade) {
    const {colour, opacity} = this.#paint;
    const mixed = new THREE.Color(stated || PLAIN);
    if (colour) mixed.lerp(new THREE.Color(colour), opacity < 1 ? 0.8 : 0.5);
    mixed.multiplyScalar(shade);
    const behind = opacity < 1;  // where it coincides with a solid one
    return new THREE.MeshPhongMaterial({color: mixed, specular: 0x222222, shininess: 25, opacity,
      transparent: behind, polygonOffset: behind, polygonOffsetFactor: 2, polygonOffsetUnits: 4,
      side: THREE.DoubleSide});
  }
}

function placed(object, xyz, [roll, pitch, yaw]) {
  object.position.set(...xyz);
  object.rotation.set(roll, pitch, yaw, "ZYX");  // R_z R_y R_x, as in a URDF
  return object;
}

const UP = Object.freeze([0, 1, 0]);  // of three's cylinders

function pointAlong(object, direction) {
  object.quaternion.setFromUnitVectors(new THREE.Vector3(...UP), direction.clone().normalize());
}

function shapeOf(visual, geometries) {
  if (visual.box) return new THREE.BoxGeometry(...visual.box);
  if (visual.sphere) return new THREE.SphereGeometry(visual.sphere[0], 32, 20);
  if (visual.cylinder) return cylinder(...visual.cylinder);
  if (visual.capsule) return cylinder(...visual.capsule);
  return geometries[visual.mesh];
}

const cylinder = (radius, length) => new THREE.CylinderGeometry(radius, radius, length, 32);
