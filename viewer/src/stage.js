// Camera, light and canvas; the canvas may show two surfaces, one on either side of a line.
import { DirectionalLight, HemisphereLight, PerspectiveCamera, Scene, WebGLRenderer } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

// A turn by the keyboard, in radians.
const TURN = 0.12;
// Width over height that the camera was placed for.
const ASPECT = 1.5;

export class Stage {
  constructor(canvas, { camera }) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.info.autoReset = false;
    this.camera = new PerspectiveCamera(camera.angle, ASPECT, 0.01, 100);
    this.camera.position.set(...camera.position);
    const light = new DirectionalLight('#ffffff', 1.5);
    light.position.set(0.4, 0.8, 1);
    this.camera.add(light);
    this.scene = new Scene();
    this.scene.add(this.camera, new HemisphereLight('#ffffff', '#8a8f98', 1.9));
    this.surfaces = [];
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enablePan = false;
    this.controls.minDistance = 0.2;
    this.controls.maxDistance = 20;
    // The page scrolls under the pointer unless the reader has chosen the view.
    this.controls.enableZoom = false;
    canvas.addEventListener('focus', () => (this.controls.enableZoom = true));
    canvas.addEventListener('blur', () => (this.controls.enableZoom = false));
    canvas.addEventListener('pointerdown', () => canvas.focus());
    canvas.addEventListener('keydown', (event) => this.#turn(event));
    this.fitted = false;
  }

  add(surface) {
    this.surfaces.push(surface);
    this.scene.add(surface.group);
  }

  onchange(draw) {
    this.controls.addEventListener('change', draw);
    new ResizeObserver(draw).observe(this.canvas.parentElement);
  }

  /** Draw one surface left of the line, if there are two, and the other right of it. */
  render(before, shown, wipe) {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.#fit(width, height);
    this.renderer.info.reset();
    const line = before ? Math.round(width * wipe) : 0;
    this.renderer.setScissorTest(true);
    const sides = [
      [before, 0, line],
      [shown, line, width - line],
    ];
    for (const [side, left, wide] of sides) {
      if (!side || wide <= 0) continue;
      for (const each of this.surfaces) each.group.visible = each === side;
      this.renderer.setScissor(left, 0, wide, height);
      this.renderer.render(this.scene, this.camera);
    }
    this.canvas.parentElement.style.setProperty('--wipe', `${line}px`);
    return this.renderer.info.render.triangles;
  }

  #fit(width, height) {
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.fitted) {
      // What is narrower than the still is seen from farther away.
      this.camera.position.multiplyScalar(Math.max(1, ASPECT / this.camera.aspect));
      this.camera.lookAt(0, 0, 0);
      this.fitted = true;
      this.controls.update();
    }
  }

  #turn(event) {
    const turn = {
      ArrowLeft: [-TURN, 0],
      ArrowRight: [TURN, 0],
      ArrowUp: [0, -TURN],
      ArrowDown: [0, TURN],
    }[event.key];
    if (!turn) return;
    event.preventDefault();
    this.controls.rotateLeft(turn[0]);
    this.controls.rotateUp(turn[1]);
  }
}
