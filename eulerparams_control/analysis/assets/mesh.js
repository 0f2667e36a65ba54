// Surfaces: from quantised meshes, with edges that stay sharp where faces meet at an angle.

const {THREE} = window.MeshCat ?? {};
const CREASE = Math.cos(35 * Math.PI / 180);

function geometryOf(mesh) {
  const corners = cornersOf(mesh);
  const indices = unpack(mesh.triangles);
  const position = new Float32Array(3 * indices.length);
  indices.forEach((vertex, i) => position.set(corners.subarray(3 * vertex, 3 * vertex + 3), 3 * i));
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  const normal = creasedNormals(faceNormals(position), indices, corners.length / 3);
  geometry.setAttribute("normal", new THREE.BufferAttribute(normal, 3));
  return geometry;
}

function cornersOf({vertices, low, step}) {
  const steps = unpack(vertices);
  return Float32Array.from(steps, (value, i) => low[i % 3] + step[i % 3] * value);
}

function faceNormals(position) {  // as long as their faces are large
  const [a, b, c] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  const normals = [];
  for (let i = 0; i < position.length; i += 9) {
    a.fromArray(position, i);
    b.fromArray(position, i + 3).sub(a);
    c.fromArray(position, i + 6).sub(a);
    normals.push(new THREE.Vector3().crossVectors(b, c));
  }
  return normals;
}

function creasedNormals(faces, indices, count) {  // of each corner: of the faces that go on there
  const around = facesAround(indices, count);
  const units = faces.map(normal => normal.clone().normalize());
  const result = new Float32Array(3 * indices.length);
  const sum = new THREE.Vector3();
  indices.forEach((vertex, i) => {
    const own = units[Math.floor(i / 3)];
    sum.set(0, 0, 0);
    for (const face of around[vertex])
      if (units[face].dot(own) > CREASE) sum.add(faces[face]);
    (sum.lengthSq() ? sum.normalize() : sum.copy(own)).toArray(result, 3 * i);
  });
  return result;
}

function facesAround(indices, count) {
  const around = Array.from({length: count}, () => []);
  indices.forEach((vertex, i) => around[vertex].push(Math.floor(i / 3)));
  return around;
}
