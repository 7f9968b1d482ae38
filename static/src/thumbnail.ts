// Small pictures of parts, all by one renderer, one after the other while the page has nothing else to do.
import { AmbientLight, Color, DirectionalLight, Matrix4, PerspectiveCamera, Scene, Sphere, Vector3, WebGLRenderer } from "three";
import { coverageBytes, preview, type Preview } from "./mesh";
import { PartMesh, STANDARD_VIEWS } from "./stage";
import { colourOfByte } from "./bytes";

const [WIDTH, HEIGHT] = [144, 108];
let renderer: WebGLRenderer | null | undefined;
let queue: Promise<void> = Promise.resolve();
/** Pictures that are kept, by mesh and job; a picture has 62 kB. */
const kept = new Map<string, ImageData>();
const KEPT = 300;

function rendererOnce(): WebGLRenderer | null {
  if (renderer !== undefined) return renderer;
  try {
    renderer = new WebGLRenderer({ antialias: true, alpha: true, powerPreference: "low-power" });
    renderer.setSize(WIDTH, HEIGHT, false);
  } catch {
    renderer = null;
  }
  return renderer;
}

export function drawThumbnail(canvas: HTMLCanvasElement, meshId: string, jobId: string | null): Promise<void> {
  queue = queue.then(() => draw(canvas, meshId, jobId)).catch(() => {});
  return queue;
}

async function draw(canvas: HTMLCanvasElement, meshId: string, jobId: string | null): Promise<void> {
  const key = `${meshId}/${jobId}`;
  const context = canvas.getContext("2d");
  if (!context || !canvas.isConnected) return;
  const known = kept.get(key);
  if (known) { context.putImageData(known, 0, 0); return; }
  if (!rendererOnce()) return;
  const [mesh, bytes] = await Promise.all([preview(meshId), jobId ? coverageBytes(jobId).catch(() => null) : null]);
  const part = new PartMesh(mesh);
  if (bytes) part.paint((face) => colourOfByte(bytes[face]!));
  render(context, part, new Matrix4());
  kept.set(key, context.getImageData(0, 0, WIDTH, HEIGHT));
  if (kept.size > KEPT) kept.delete(kept.keys().next().value!);
}

/** Draws a part as it is turned, the plate below it. */
export function drawTurned(canvas: HTMLCanvasElement, mesh: Preview, turn: Matrix4): Promise<void> {
  queue = queue.then(() => {
    const context = canvas.getContext("2d");
    if (!context || !rendererOnce()) return;
    const part = new PartMesh(mesh);
    part.paint(() => [176, 186, 198]);
    render(context, part, turn);
  }).catch(() => {});
  return queue;
}

function render(context: CanvasRenderingContext2D, part: PartMesh, turn: Matrix4): void {
  const scene = new Scene();
  const light = new DirectionalLight(new Color(0xffffff), 2.2);
  const camera = new PerspectiveCamera(30, WIDTH / HEIGHT, 1, 1e5);
  const ball = part.box.getBoundingSphere(new Sphere()).applyMatrix4(turn);
  const distance = ball.radius * 4;
  [camera.near, camera.far] = [distance / 100, distance * 10];
  camera.updateProjectionMatrix();
  camera.up.set(0, 0, 1);
  camera.position.copy(ball.center).addScaledVector(new Vector3(...STANDARD_VIEWS.iso!).normalize(), distance);
  camera.lookAt(ball.center);
  light.position.copy(camera.position);
  light.target.position.copy(ball.center);
  part.mesh.matrixAutoUpdate = false;
  part.mesh.matrix.copy(turn);
  scene.add(part.mesh, light, light.target, new AmbientLight(0xffffff, 1.3));
  renderer!.render(scene, camera);
  context.clearRect(0, 0, WIDTH, HEIGHT);
  context.drawImage(renderer!.domElement, 0, 0);
  part.mesh.geometry.dispose();
  part.mesh.material.dispose();
}
