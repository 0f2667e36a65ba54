// Turning, moving and enlarging the view with mouse, pen or fingers; z stays up.

const TURN = 0.008;  // [rad] for a pixel
const STEEPEST = 1.52;  // [rad] above and below the floor

class Orbit {
  constructor(camera, element, changed) {
    Object.assign(this, {camera, element, changed, azimuth: -0.9, elevation: 0.42, distance: 3,
                         target: new THREE.Vector3()});
    this.pointers = new Map();
    element.addEventListener("pointerdown", event => this.#down(event));
    element.addEventListener("pointermove", event => this.#move(event));
    for (const type of ["pointerup", "pointercancel"])
      element.addEventListener(type, event => this.pointers.delete(event.pointerId));
    element.addEventListener("wheel", event => this.#wheel(event), {passive: false});
    element.addEventListener("contextmenu", event => event.preventDefault());
  }

  place() {
    const level = this.distance * Math.cos(this.elevation);
    const offset = new THREE.Vector3(level * Math.cos(this.azimuth), level * Math.sin(this.azimuth),
                                     this.distance * Math.sin(this.elevation));
    this.camera.position.copy(this.target).add(offset);
    this.camera.lookAt(this.target);
    this.changed();
  }

  fit(box) {  // the whole of it in the view, whatever its shape
    const radius = box.getSize(new THREE.Vector3()).length() / 2;
    const half = this.camera.fov * Math.PI / 360;
    const narrowest = Math.min(half, Math.atan(Math.tan(half) * this.camera.aspect));
    box.getCenter(this.target);
    this.distance = 0.85 * radius / Math.sin(narrowest);
    this.place();
  }

  #down(event) {
    this.pointers.set(event.pointerId, event);
    this.element.setPointerCapture(event.pointerId);
  }

  #move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    if (this.pointers.size === 2) this.#pinch(event, before);
    else if (event.buttons === 1 && !event.shiftKey) this.#turn(dx, dy);
    else this.#shift(dx, dy);
    this.pointers.set(event.pointerId, event);
    this.place();
  }

  #turn(dx, dy) {
    this.azimuth -= TURN * dx;
    this.elevation = clamp(this.elevation + TURN * dy, -STEEPEST, STEEPEST);
  }

  #shift(dx, dy) {
    const scale = 2 * this.distance * Math.tan(this.camera.fov * Math.PI / 360) /
                  this.element.clientHeight;
    const [right, up] = [new THREE.Vector3(), new THREE.Vector3()];
    this.camera.matrixWorld.extractBasis(right, up, new THREE.Vector3());
    this.target.addScaledVector(right, -dx * scale).addScaledVector(up, dy * scale);
  }

  #pinch(event, before) {
    const other = [...this.pointers.values()].find(({pointerId}) => pointerId !== event.pointerId);
    const apart = ({clientX, clientY}) =>
      Math.hypot(clientX - other.clientX, clientY - other.clientY) + 1;
    this.#zoom(apart(before) / apart(event));
    this.#shift((event.clientX - before.clientX) / 2, (event.clientY - before.clientY) / 2);
  }

  #zoom(factor) { this.distance = clamp(this.distance * factor, 0.1, 50); }

  #wheel(event) {
    event.preventDefault();
    this.#zoom(Math.exp(0.0012 * event.deltaY));
    this.place();
  }
}
