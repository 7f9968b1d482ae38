// A view in three dimensions: camera, light, picks, labels and pictures. It draws when something changed and not otherwise.
import {
  AmbientLight, Box3, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, type Material, Mesh, MeshLambertMaterial,
  Object3D, PerspectiveCamera, Plane, Raycaster, Scene, Sphere, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { effect } from "@preact/signals";
import type { Preview } from "./mesh";
import { isDark } from "./settings";

export const STANDARD_VIEWS: Record<string, [number, number, number]> = {
  iso: [1, -1.2, 0.9], top: [0, -0.001, 1], bottom: [0, -0.001, -1], front: [0, -1, 0], back: [0, 1, 0], left: [-1, 0, 0],
  right: [1, 0, 0],
};

/** `more` is shown while the label or what it belongs to is under the pointer, or chosen. */
export interface Label { at: Vector3; text: string; more?: string; key?: number; className?: string; onClick?: () => void }
export interface PointerPick { origin: number[]; direction: number[]; isExtended: boolean }

/** Stages that are drawn, for the tests. */
export const stages = new Set<Stage>();
window.vantage.stages = stages;

/** True where the browser draws 3D without a graphics card: smooth edges would cost four times the pixels there. */
function isSoftware(renderer: WebGLRenderer): boolean {
  const gl = renderer.getContext();
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|software/i.test(String(info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : ""));
}

let hasCard: boolean | undefined;

/** A renderer, with smooth edges where there is a graphics card: which only a context tells. */
function rendererOf(): WebGLRenderer {
  const made = new WebGLRenderer({ antialias: hasCard ?? false, powerPreference: "low-power" });
  if (hasCard !== undefined) return made;
  hasCard = !isSoftware(made);
  if (!hasCard) return made;
  made.dispose();
  made.forceContextLoss();
  return new WebGLRenderer({ antialias: true, powerPreference: "low-power" });
}

const CLICK_PX = 5;
const KEY_STEP_RAD = Math.PI / 24;

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(35, 1, 1, 20_000);
  private readonly overlay = document.createElement("div");
  private readonly renderer = rendererOf();
  readonly canvas = this.renderer.domElement;
  private readonly controls: OrbitControls;
  private readonly resizing: ResizeObserver;
  private readonly light = new DirectionalLight(0xffffff, 2.2);
  private labels: { label: Label; element: HTMLElement }[] = [];
  private frame = 0;
  private followers: ((stage: Stage) => void)[] = [];
  private readonly disposals: (() => void)[] = [];
  /** Called with the ray of a click on the canvas; and, while `isBrushing`, of a drag. */
  onClick: ((pick: PointerPick) => void) | null = null;
  onBrush: ((pick: PointerPick) => void) | null = null;
  /** Called with the ray of the pointer that moves over the canvas, once a frame; null when it leaves. */
  onHover: ((pick: PointerPick | null) => void) | null = null;
  frames = 0;
  private hasSize = false;
  private hasDrawn!: () => void;
  /** Fulfilled with the first picture. */
  readonly drawn = new Promise<void>((done) => { this.hasDrawn = done; });

  constructor(private readonly container: HTMLElement, label: string) {
    this.renderer.localClippingEnabled = true;
    // The shaders are those of three.js; asking how their compilation went waits for it.
    this.renderer.debug.checkShaderErrors = false;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    this.overlay.className = "labels";
    container.append(this.canvas, this.overlay);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => { this.invalidate(); this.followers.forEach((follow) => follow(this)); });
    this.scene.add(new AmbientLight(0xffffff, 1.3), this.light, this.light.target);
    this.resizing = new ResizeObserver(() => this.resize());
    this.resizing.observe(container);
    this.listen();
    this.disposals.push(effect(() => {
      this.scene.background = new Color(isDark.value ? 0x171c23 : 0xeef1f5);
      this.invalidate();
    }));
    stages.add(this);
  }

  dispose(): void {
    stages.delete(this);
    cancelAnimationFrame(this.frame);
    this.resizing.disconnect();
    this.disposals.forEach((dispose) => dispose());
    this.controls.dispose();
    this.clear(this.scene);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
    this.overlay.remove();
  }

  /** Removes the children of an object, with what they hold on the graphics card. */
  clear(parent: Object3D): void {
    for (const child of [...parent.children]) {
      child.traverse((object) => {
        const drawn = object as Partial<Mesh>;
        drawn.geometry?.dispose();
        ([drawn.material].flat() as (Material | undefined)[]).forEach((material) => material?.dispose());
      });
      parent.remove(child);
    }
  }

  invalidate(): void {
    // What is drawn before the size is known would be drawn twice.
    this.frame ||= requestAnimationFrame(() => { this.frame = 0; if (this.hasSize) this.draw(); });
  }

  private draw(): void {
    this.light.position.copy(this.camera.position);
    this.light.target.position.copy(this.controls.target);
    this.renderer.render(this.scene, this.camera);
    this.frames += 1;
    if (this.frames === 1) setTimeout(this.hasDrawn);
    const { clientWidth: width, clientHeight: height } = this.container;
    const at = new Vector3();
    for (const { label, element } of this.labels) {
      at.copy(label.at).project(this.camera);
      const isShown = at.z < 1 && Math.abs(at.x) < 1 && Math.abs(at.y) < 1;
      element.hidden = !isShown;
      // None is cut off at the right: the style has a margin of .6rem at the left.
      if (isShown) element.style.transform = `translate(min(${((at.x + 1) / 2) * width}px, ${width - 12}px - 100%), ${((1 - at.y) / 2) * height}px)`;
    }
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.container;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.hasSize = true;
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.draw();
  }

  setLabels(labels: Label[]): void {
    this.overlay.replaceChildren();
    this.labels = labels.map((label) => {
      const element = document.createElement(label.onClick ? "button" : "span");
      element.className = `label ${label.className ?? ""}`;
      element.textContent = label.text;
      if (label.more) element.append(Object.assign(document.createElement("span"), { className: "more", textContent: ` · ${label.more}` }));
      if (label.onClick) {
        (element as HTMLButtonElement).type = "button";
        // The list beside the view has the same; the keyboard goes there.
        element.tabIndex = -1;
        element.setAttribute("aria-hidden", "true");
        element.onclick = label.onClick;
      }
      this.overlay.append(element);
      return { label, element };
    });
    this.invalidate();
  }

  /** Shows the whole label of one thing. */
  hover(key: number | null): void {
    this.labels.forEach(({ label, element }) => element.classList.toggle("hovered", key !== null && label.key === key));
  }

  private rayAt(event: PointerEvent): PointerPick {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const caster = new Raycaster();
    caster.setFromCamera(at, this.camera);
    return { origin: caster.ray.origin.toArray(), direction: caster.ray.direction.toArray(), isExtended: event.shiftKey };
  }

  /** Ray through the middle of the view: the keyboard's click. */
  private centreRay(): PointerPick {
    const direction = this.camera.getWorldDirection(new Vector3());
    return { origin: this.camera.position.toArray(), direction: direction.toArray(), isExtended: false };
  }

  private listen(): void {
    let down: PointerEvent | null = null;
    let latest: PointerEvent | null = null;
    let moved: number | undefined;
    this.canvas.addEventListener("pointerdown", (event) => {
      down = event;
      if (this.onBrush && event.button === 0) { this.controls.enabled = false; this.onBrush(this.rayAt(event)); }
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (down && this.onBrush && event.buttons & 1) this.onBrush(this.rayAt(event));
      if (event.buttons !== 0 || !this.onHover) return;
      moved ??= requestAnimationFrame(() => { moved = undefined; this.onHover?.(this.rayAt(latest!)); });
      latest = event;
    });
    this.canvas.addEventListener("pointerleave", () => this.onHover?.(null));
    this.canvas.addEventListener("pointerup", (event) => {
      this.controls.enabled = true;
      const isClick = down && Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) < CLICK_PX;
      if (isClick && !this.onBrush && event.button === 0) this.onClick?.(this.rayAt(event));
      down = null;
    });
    this.canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !this.pressed(event.key)) return;
      event.preventDefault();
    });
  }

  private pressed(key: string): boolean {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const sideways = new Vector3().crossVectors(this.camera.up, offset).normalize();
    if (key === "ArrowLeft" || key === "ArrowRight") {
      offset.applyAxisAngle(this.camera.up, key === "ArrowLeft" ? -KEY_STEP_RAD : KEY_STEP_RAD);
    } else if (key === "ArrowUp" || key === "ArrowDown") {
      offset.applyAxisAngle(sideways, key === "ArrowUp" ? -KEY_STEP_RAD : KEY_STEP_RAD);
      if (Math.abs(offset.clone().normalize().z) > 0.999) return true;
    } else if (key === "+" || key === "=") offset.multiplyScalar(0.88);
    else if (key === "-") offset.multiplyScalar(1 / 0.88);
    else if (key === "Enter" || key === " ") { this.onClick?.(this.centreRay()); return true; }
    else return false;
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.invalidate();
    return true;
  }

  /** Where the camera goes to look at a box from a direction, and how far that is from the box's middle. */
  private standing(box: Box3, direction: number[]): { centre: Vector3; at: Vector3; distance: number } {
    const centre = box.getCenter(new Vector3());
    const back = new Vector3().fromArray(direction).normalize();
    // Straight above and below, the picture would have no upright.
    if (Math.hypot(back.x, back.y) < 1e-3) back.setY(-1e-3).normalize();
    const distance = 1.12 * this.distanceFor(box, centre, back);
    return { centre, at: centre.clone().addScaledVector(back, distance), distance };
  }

  /** Place of the camera now, or once it looked at a box from a direction. */
  eye(box?: Box3, direction?: number[]): Vector3 {
    return box && direction ? this.standing(box, direction).at : this.camera.position.clone();
  }

  /** True if a point is within the picture. */
  shows(at: Vector3): boolean {
    const { x, y, z } = at.clone().project(this.camera);
    return Math.abs(x) < 1 && Math.abs(y) < 1 && z < 1;
  }

  /** Turns the camera to a standard view and lets `box` fill the picture. */
  look(box: Box3, direction: [number, number, number]): void {
    const { centre, at, distance } = this.standing(box, direction);
    this.camera.near = Math.max(0.1, distance / 200);
    this.camera.far = distance * 50;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(centre);
    this.camera.position.copy(at);
    this.controls.update();
    this.invalidate();
    this.followers.forEach((follow) => follow(this));
  }

  /** Smallest distance from which every corner of a box is in the picture. */
  private distanceFor(box: Box3, centre: Vector3, back: Vector3): number {
    const sideways = new Vector3().crossVectors(this.camera.up, back).normalize();
    const upwards = new Vector3().crossVectors(back, sideways);
    const tangent = Math.tan((this.camera.fov * Math.PI) / 360);
    let distance = 1;
    for (let i = 0; i < 8; i += 1) {
      const corner = new Vector3(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z).sub(centre);
      const across = Math.max(Math.abs(corner.dot(upwards)), Math.abs(corner.dot(sideways)) / Math.max(0.3, this.camera.aspect));
      distance = Math.max(distance, across / tangent + corner.dot(back));
    }
    return distance;
  }

  /** Keeps the direction and lets `box` fill the picture. */
  fit(box: Box3): void {
    const direction = this.camera.position.clone().sub(this.controls.target);
    this.look(box, direction.lengthSq() > 0 ? direction.toArray() : STANDARD_VIEWS.iso!);
  }

  /** Lets stages move together. */
  static couple(...stages: Stage[]): void {
    let isBusy = false;
    const lead = (leader: Stage): void => {
      if (isBusy) return;
      isBusy = true;
      stages.filter((stage) => stage !== leader).forEach((follower) => {
        follower.camera.position.copy(leader.camera.position);
        follower.controls.target.copy(leader.controls.target);
        follower.camera.near = leader.camera.near;
        follower.camera.far = leader.camera.far;
        follower.camera.updateProjectionMatrix();
        follower.controls.update();
        follower.invalidate();
      });
      isBusy = false;
    };
    stages.forEach((stage) => stage.followers.push(lead));
  }

  /** Object that a ray meets first, of some. */
  static hit(pick: PointerPick, objects: Object3D[]): { object: Object3D; instance: number; distance: number } | null {
    const caster = new Raycaster(new Vector3(...pick.origin), new Vector3(...pick.direction));
    const [first] = caster.intersectObjects(objects, false);
    return first ? { object: first.object, instance: first.instanceId ?? -1, distance: first.distance } : null;
  }

  /** Draws at once and saves the picture. */
  screenshot(name: string): void {
    this.draw();
    this.canvas.toBlob((blob) => {
      if (!blob) return;
      const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
    }, "image/png");
  }

  /** Draws at once and copies the picture to another canvas. */
  copyTo(target: HTMLCanvasElement): void {
    this.draw();
    target.getContext("2d")?.drawImage(this.canvas, 0, 0, target.width, target.height);
  }

  /** Colour of the middle of the picture and share of pixels that are not background, for the tests. */
  pixels(): { middle: number[]; drawn: number; colours: number } {
    this.draw();
    const copy = Object.assign(document.createElement("canvas"), { width: 160, height: 120 });
    const context = copy.getContext("2d", { willReadFrequently: true })!;
    context.drawImage(this.canvas, 0, 0, 160, 120);
    const { data } = context.getImageData(0, 0, 160, 120);
    const corner = [data[0]!, data[1]!, data[2]!];
    const colours = new Set<number>();
    let drawn = 0;
    for (let i = 0; i < data.length; i += 4) {
      const away = Math.abs(data[i]! - corner[0]!) + Math.abs(data[i + 1]! - corner[1]!) + Math.abs(data[i + 2]! - corner[2]!);
      if (away > 24) drawn += 1;
      colours.add((data[i]! >> 4) * 256 + (data[i + 1]! >> 4) * 16 + (data[i + 2]! >> 4));
    }
    const at = 4 * (60 * 160 + 80);
    return { middle: [...data.slice(at, at + 3)], drawn: drawn / (160 * 120), colours: colours.size };
  }
}

/** Linear light of each sRGB value (IEC 61966-2-1), in which three.js takes the colours of corners. */
const LINEAR = Uint8Array.from({ length: 256 }, (_, value) => {
  const x = value / 255;
  return Math.round(255 * (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4));
});
export const linear = (value: number): number => LINEAR[value]!;

/** The part, a colour a face. */
export class PartMesh {
  readonly mesh: Mesh<BufferGeometry, MeshLambertMaterial>;
  readonly box: Box3;
  private readonly colours: BufferAttribute;
  readonly section = new Plane(new Vector3(1, 0, 0), 0);

  constructor(readonly preview: Preview) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(preview.positions, 3));
    this.colours = new BufferAttribute(new Uint8Array(3 * 3 * preview.faces).fill(190), 3, true);
    geometry.setAttribute("color", this.colours);
    this.mesh = new Mesh(geometry, new MeshLambertMaterial({ vertexColors: true, flatShading: true, side: DoubleSide }));
    this.mesh.name = "part";
    this.box = new Box3(new Vector3(...preview.min), new Vector3(...preview.max));
    geometry.boundingSphere = this.box.getBoundingSphere(new Sphere());
  }

  paint(colourOf: (face: number) => readonly [number, number, number]): void {
    const array = this.colours.array as Uint8Array;
    for (let face = 0; face < this.preview.faces; face += 1) {
      const [r, g, b] = colourOf(face);
      for (let corner = 9 * face; corner < 9 * face + 9; corner += 3) {
        array[corner] = LINEAR[r]!; array[corner + 1] = LINEAR[g]!; array[corner + 2] = LINEAR[b]!;
      }
    }
    this.colours.needsUpdate = true;
  }

  /** Cuts away what lies before the plane; `null` shows everything. */
  cut(plane: Plane | null): void {
    this.mesh.material.clippingPlanes = plane ? [plane] : [];
    this.mesh.material.needsUpdate = true;
  }
}
