// Everything that walks the whole mesh, away from the thread that draws: the tree of its triangles, picks, visibility of spots
// and faces from viewpoints, connected faces.
import { BufferAttribute, BufferGeometry, DoubleSide, Ray, Vector3 } from "three";
import { MeshBVH } from "three-mesh-bvh";
import type { Pose } from "./api";
import { ClearanceScene, type Clearance, type ClearanceCell } from "./collide";
import { apply, evaluate, rigid, viewOf, type Optics, type Rigid, type View } from "./optics";
import { AZIMUTHS, ELEVATIONS, mapOf, reach, type ReachMap } from "./reach";
import { readMesh } from "./readmesh";
import { stablePoses } from "./stable";

export interface Plate { tableFromPart: Pose; radius: number }

export type Ask =
  | { kind: "read"; file: ArrayBuffer }
  | { kind: "load"; positions: Float32Array; fixture: Float32Array | null }
  | { kind: "pick"; origin: number[]; direction: number[]; section: number[] | null }
  | { kind: "judge"; optics: Optics; views: Pose[]; plates: (Plate | null)[]; point: number[]; normal: number[] }
  | { kind: "score"; optics: Optics; views: Pose[]; plates: (Plate | null)[] }
  | { kind: "flood"; face: number; maxDeg: number }
  | { kind: "near"; point: number[]; radius: number; normal: number[] }
  | { kind: "box"; min: number[]; max: number[] }
  | { kind: "rest"; positions: Float32Array }
  | { kind: "cell"; given: ClearanceCell }
  | { kind: "reach"; given: ClearanceCell; edge: number }
  | { kind: "clearances"; configurations: number[][] };

export interface Judgement { cause: string | null; incidenceDeg: number; depthMm: number; quality: number }
export interface Hit { face: number; point: [number, number, number]; normal: [number, number, number] }
export interface Scores {
  /** Views that measure each face, smallest of their largest incidences in degrees (255: none), best quality in 1/100. */
  counts: Uint8Array; incidences: Uint8Array; qualities: Int8Array;
  /** Area that each view measures, and that it alone does, mm². */
  areas: number[]; alone: number[];
  measured: number; total: number;
}

let positions = new Float32Array(0);
let tree: MeshBVH | null = null;
/** What hides the mesh besides itself. */
let fixtureTree: MeshBVH | null = null;
let lift = 1e-3;
let neighbours: Int32Array | null = null;

function normalOf(face: number): [number, number, number] {
  const i = 9 * face;
  const p = positions;
  const [ax, ay, az] = [p[i + 3]! - p[i]!, p[i + 4]! - p[i + 1]!, p[i + 5]! - p[i + 2]!];
  const [bx, by, bz] = [p[i + 6]! - p[i]!, p[i + 7]! - p[i + 1]!, p[i + 8]! - p[i + 2]!];
  const [x, y, z] = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
  const size = Math.hypot(x, y, z) || 1;
  return [x / size, y / size, z / size];
}

function areaOf(face: number): number {
  const i = 9 * face;
  const p = positions;
  const [ax, ay, az] = [p[i + 3]! - p[i]!, p[i + 4]! - p[i + 1]!, p[i + 5]! - p[i + 2]!];
  const [bx, by, bz] = [p[i + 6]! - p[i]!, p[i + 7]! - p[i + 1]!, p[i + 8]! - p[i + 2]!];
  return Math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx) / 2;
}

function centreOf(face: number): [number, number, number] {
  const i = 9 * face;
  const p = positions;
  return [(p[i]! + p[i + 3]! + p[i + 6]!) / 3, (p[i + 1]! + p[i + 4]! + p[i + 7]!) / 3, (p[i + 2]! + p[i + 5]! + p[i + 8]!) / 3];
}

const geometryOf = (corners: Float32Array): BufferGeometry => new BufferGeometry().setAttribute("position", new BufferAttribute(corners, 3));

function load(given: Float32Array, fixture: Float32Array | null): { faces: number; secs: number } {
  const began = performance.now();
  positions = given as Float32Array<ArrayBuffer>;
  neighbours = null;
  sights.clear();
  const geometry = geometryOf(positions);
  geometry.computeBoundingSphere();
  lift = 1e-5 * (geometry.boundingSphere?.radius ?? 100);
  // `indirect` leaves the faces in their order, by which coverage is given.
  tree = new MeshBVH(geometry, { indirect: true, targetLeafSize: 8 });
  fixtureTree = fixture && new MeshBVH(geometryOf(fixture), { targetLeafSize: 8 });
  return { faces: positions.length / 9, secs: (performance.now() - began) / 1000 };
}

const ray = new Ray();

function pick(origin: number[], direction: number[], section: number[] | null): Hit | null {
  ray.origin.fromArray(origin);
  ray.direction.fromArray(direction).normalize();
  // The part in front of the section plane is not there for the reader.
  const hits = section ? tree!.raycast(ray, DoubleSide) : [tree!.raycastFirst(ray, DoubleSide)];
  const isShown = ({ point }: { point: Vector3 }): boolean =>
    !section || section[0]! * point.x + section[1]! * point.y + section[2]! * point.z + section[3]! >= 0;
  const hit = hits.filter((hit) => hit && isShown(hit)).sort((a, b) => a!.distance - b!.distance)[0];
  if (!hit || hit.faceIndex == null) return null;
  return { face: hit.faceIndex, point: hit.point.toArray(), normal: normalOf(hit.faceIndex) };
}

interface Occluder { tableFromPart: Rigid; radius2: number }
const occluderOf = (plate: Plate | null): Occluder | null =>
  (plate ? { tableFromPart: rigid(plate.tableFromPart), radius2: plate.radius ** 2 } : null);

/** True if the plate lies between a point and a device. */
function isBehindPlate({ tableFromPart, radius2 }: Occluder, p: number[], c: number[]): boolean {
  const a = apply(tableFromPart, p[0]!, p[1]!, p[2]!);
  const b = apply(tableFromPart, c[0]!, c[1]!, c[2]!);
  if (a[2] < lift || b[2] >= 0) return b[2] < 0;
  const t = a[2] / (a[2] - b[2]);
  return (a[0] + t * (b[0] - a[0])) ** 2 + (a[1] + t * (b[1] - a[1])) ** 2 <= radius2;
}

const NAMES = ["left", "right", "projector"];

function shadowOf(view: View, plate: Occluder | null, p: number[], n: number[]): string | null {
  for (let i = 0; i < 3; i += 1) {
    const centre = view.centres[i]!;
    if (plate && isBehindPlate(plate, p, centre)) return `shadow_${NAMES[i]}`;
    ray.origin.set(p[0]! + lift * n[0]!, p[1]! + lift * n[1]!, p[2]! + lift * n[2]!);
    ray.direction.set(centre[0] - ray.origin.x, centre[1] - ray.origin.y, centre[2] - ray.origin.z);
    const distance = ray.direction.length();
    ray.direction.divideScalar(distance);
    if ([tree!, fixtureTree].some((surfaces) => surfaces?.raycastFirst(ray, DoubleSide, lift, distance))) return `shadow_${NAMES[i]}`;
  }
  return null;
}

function judge(optics: Optics, poses: Pose[], plates: (Plate | null)[], point: number[], normal: number[]): Judgement[] {
  return poses.map((pose, i) => {
    const view = viewOf(optics, pose);
    const optical = evaluate(optics, view, point, normal);
    return { ...optical, cause: optical.cause ?? shadowOf(view, occluderOf(plates[i] ?? null), point, normal) };
  });
}

let scoring = 0;

/** What one view measures of each face: its largest incidence in degrees (255: not measured), and quality in 1/100. */
interface Sight { incidences: Uint8Array; qualities: Int8Array; area: number }
/** Sights by pose, so that of edited views only the changed one is computed anew. */
const sights = new Map<string, Sight>();
const MAX_SIGHTS = 120;

function sightOf(optics: Optics, pose: Pose, plate: Plate | null): Sight {
  const key = JSON.stringify([pose, plate]);
  const known = sights.get(key);
  if (known) return known;
  const faces = positions.length / 9;
  const made: Sight = { incidences: new Uint8Array(faces).fill(255), qualities: new Int8Array(faces), area: 0 };
  const [view, occluder] = [viewOf(optics, pose), occluderOf(plate)];
  for (let face = 0; face < faces; face += 1) {
    const [p, n] = [centreOf(face), normalOf(face)];
    const { cause, incidenceDeg, quality } = evaluate(optics, view, p, n);
    if (cause || shadowOf(view, occluder, p, n)) continue;
    made.incidences[face] = Math.round(incidenceDeg);
    made.qualities[face] = Math.round(100 * quality);
    made.area += areaOf(face);
  }
  sights.set(key, made);
  if (sights.size > MAX_SIGHTS) sights.delete(sights.keys().next().value!);
  return made;
}

async function score(id: number, optics: Optics, poses: Pose[], plates: (Plate | null)[]): Promise<Scores | null> {
  scoring = id;
  const found: Sight[] = [];
  for (const [i, pose] of poses.entries()) {
    found.push(sightOf(optics, pose, plates[i] ?? null));
    postMessage({ id, progress: (i + 1) / poses.length });
    // Lets a pick in between, and a newer request take over.
    await new Promise((resolve) => setTimeout(resolve));
    if (scoring !== id) return null;
  }
  return together(found);
}

function together(found: Sight[]): Scores {
  const faces = positions.length / 9;
  const made: Scores = {
    counts: new Uint8Array(faces), incidences: new Uint8Array(faces).fill(255), qualities: new Int8Array(faces).fill(-128),
    areas: found.map((sight) => sight.area), alone: found.map(() => 0), measured: 0, total: 0,
  };
  for (let face = 0; face < faces; face += 1) {
    const area = areaOf(face);
    let sole = -1;
    let count = 0;
    for (const [i, { incidences, qualities }] of found.entries()) {
      if (incidences[face] === 255) continue;
      sole = i;
      count += 1;
      made.incidences[face] = Math.min(made.incidences[face]!, incidences[face]!);
      made.qualities[face] = Math.max(made.qualities[face]!, qualities[face]!);
    }
    made.counts[face] = Math.min(255, count);
    made.total += area;
    if (count > 0) made.measured += area;
    if (count === 1) made.alone[sole]! += area;
  }
  return made;
}

/** Face across each edge, -1 where there is none: corners that lie together are one. */
function neighbourTable(): Int32Array {
  if (neighbours) return neighbours;
  const corners = positions.length / 3;
  const ids = new Int32Array(corners);
  const known = new Map<string, number>();
  for (let c = 0; c < corners; c += 1) {
    const key = `${positions[3 * c]},${positions[3 * c + 1]},${positions[3 * c + 2]}`;
    const id = known.get(key) ?? known.size;
    known.set(key, id);
    ids[c] = id;
  }
  const table = new Int32Array(corners).fill(-1);
  const edges = new Map<number, number>();
  for (let c = 0; c < corners; c += 1) {
    const [a, b] = [ids[c]!, ids[c % 3 === 2 ? c - 2 : c + 1]!];
    const key = Math.min(a, b) * known.size + Math.max(a, b);
    const other = edges.get(key);
    if (other === undefined) edges.set(key, c);
    else { table[c] = Math.floor(other / 3); table[other] = Math.floor(c / 3); }
  }
  neighbours = table;
  return table;
}

/** Faces that are reached from one without crossing an edge sharper than an angle. */
function flood(face: number, maxDeg: number): Int32Array {
  const table = neighbourTable();
  const minCos = Math.cos((maxDeg * Math.PI) / 180);
  const reached = new Set([face]);
  const open = [face];
  for (let at = open.pop(); at !== undefined; at = open.pop()) {
    const n = normalOf(at);
    for (let e = 0; e < 3; e += 1) {
      const next = table[3 * at + e]!;
      if (next < 0 || reached.has(next)) continue;
      const m = normalOf(next);
      if (n[0] * m[0] + n[1] * m[1] + n[2] * m[2] < minCos) continue;
      reached.add(next);
      open.push(next);
    }
  }
  return Int32Array.from(reached).sort();
}

const facesWhere = (isIn: (face: number) => boolean): Int32Array =>
  Int32Array.from({ length: positions.length / 9 }, (_, face) => face).filter(isIn);

/** Faces under a brush: centre within its radius, and turned to the reader's side. */
function near(point: number[], radius: number, normal: number[]): Int32Array {
  const found: number[] = [];
  const centre = new Vector3().fromArray(point);
  tree!.shapecast({
    intersectsBounds: (box) => box.distanceToPoint(centre) <= radius,
    intersectsTriangle: (_, i) => {
      const face = tree!.resolveTriangleIndex(i);
      const c = centreOf(face);
      const n = normalOf(face);
      const isNear = Math.hypot(c[0] - point[0]!, c[1] - point[1]!, c[2] - point[2]!) <= radius;
      if (isNear && n[0] * normal[0]! + n[1] * normal[1]! + n[2] * normal[2]! > 0) found.push(face);
      return false;
    },
  });
  return Int32Array.from(found);
}

let cellScene: ClearanceScene | null = null;
/** Configurations that are asked in one go, before a shorter question may come in between. */
const AT_ONCE = 10;

async function clearances(id: number, configurations: number[][]): Promise<(Clearance | null)[]> {
  const found: (Clearance | null)[] = [];
  for (const [i, configuration] of configurations.entries()) {
    found.push(cellScene!.nearest(configuration));
    if (i % AT_ONCE !== AT_ONCE - 1) continue;
    postMessage({ id, progress: (i + 1) / configurations.length });
    await new Promise((resolve) => setTimeout(resolve));
  }
  return found;
}

async function reachOf(id: number, given: ClearanceCell, edge: number): Promise<ReachMap> {
  const fates = new Uint8Array(ELEVATIONS * AZIMUTHS);
  let at = 0;
  for (const fate of reach(given.cell, given.robot, given.scanner, new ClearanceScene(given), edge)) {
    fates[at] = fate;
    at += 1;
    if (at % AZIMUTHS === 0) postMessage({ id, progress: at / fates.length });
  }
  return mapOf(fates);
}

async function answer(id: number, ask: Ask): Promise<unknown> {
  switch (ask.kind) {
    case "read": return readMesh(ask.file);
    case "load": return load(ask.positions, ask.fixture);
    case "pick": return pick(ask.origin, ask.direction, ask.section);
    case "judge": return judge(ask.optics, ask.views, ask.plates, ask.point, ask.normal);
    case "score": return score(id, ask.optics, ask.views, ask.plates);
    case "flood": return flood(ask.face, ask.maxDeg);
    case "near": return near(ask.point, ask.radius, ask.normal);
    case "rest": return stablePoses(ask.positions);
    case "cell": cellScene = new ClearanceScene(ask.given); return null;
    case "reach": return reachOf(id, ask.given, ask.edge);
    case "clearances": return clearances(id, ask.configurations);
    case "box": return facesWhere((face) => centreOf(face).every((x, i) => ask.min[i]! <= x && x <= ask.max[i]!));
  }
}

addEventListener("message", ({ data }: MessageEvent<{ id: number; ask: Ask }>) => {
  answer(data.id, data.ask).then(
    (value) => postMessage({ id: data.id, value }),
    (error: Error) => postMessage({ id: data.id, error: error.message }),
  );
});

