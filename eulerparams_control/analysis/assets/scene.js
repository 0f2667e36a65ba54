// The scene: camera, lights and floor; drawn again only when something has changed.

const FLOOR = [3, 30];  // [m], squares

class Stage {
  constructor(canvas, context) {
    THREE.Object3D.DefaultUp.set(0, 0, 1);
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({canvas, context, antialias: true, alpha: true});
    this.renderer.setClearColor(0, 0);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.02, 100);
    this.camera.up.set(0, 0, 1);
    this.orbit = new Orbit(this.camera, canvas, () => this.invalidate());
    this.#light();
    this.scene.add(this.camera);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    theme.listeners.push(() => this.paint());
    this.paint();
  }

  #light() {
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8a8f98, 0.65));
    const sun = new THREE.DirectionalLight(0xffffff, 0.5);
    sun.position.set(0.4, 0.8, 1);  // over the shoulder
    this.camera.add(sun);
  }

  paint() {  // in the colours of the style sheet
    if (this.floor) this.scene.remove(this.floor);
    const colour = new THREE.Color(theme.colour("--floor"));
    this.floor = new THREE.GridHelper(...FLOOR, colour, colour);
    this.floor.rotation.x = Math.PI / 2;
    this.scene.add(this.floor);
    this.invalidate();
  }

  resize() {
    const {clientWidth, clientHeight} = this.canvas.parentElement;
    if (!clientWidth || !clientHeight) return;
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.render();
  }

  render() {
    this.asked = false;
    this.renderer.render(this.scene, this.camera);
  }

  invalidate() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => this.render());
  }

  picture() {  // of what is seen, as a data URL
    this.render();
    return this.canvas.toDataURL("image/png");
  }
}
