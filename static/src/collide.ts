// Distance of the bodies of a cell that are nearest to each other, with the bodies, pairs and exceptions of `src/cell/collision`:
// convex cores grown by a radius against each other by GJK (E. G. Gilbert, D. W. Johnson and S. S. Keerthi, IEEE Journal of
// Robotics and Automation 4(2), 1988), surfaces by their trees of boxes.
import { BufferAttribute, BufferGeometry, type Box3, Matrix4, Vector3 } from "three";
import { MeshBVH } from "three-mesh-bvh";
import type { Axis, Body, Cell, Pose, Robot, ScannerSpec, Shape, Turntable } from "./api";
import { linkFrames, matrixOf, shift, turnZ } from "./poses";

type Point = [number, number, number];

export interface ClearanceCell {
  cell: Cell; robot: Robot; table: Turntable; scanner: ScannerSpec; clearanceMm: number; part: Float32Array; fixture: Float32Array | null; tableFromPart: Pose;
  /** Corners of the meshes that bodies name, by their id. */
  meshes: Record<string, Float32Array>;
}

/** The two bodies that are nearest, and the points of their surfaces between which the distance is measured, base frame. */
export interface Clearance { mm: number; a: string; b: string; from: Point; to: Point }

/** Farther is not looked for, as the planner does not (`MAX_SEPARATION_MM` in `src/planning/scene`). */
export const FARTHEST_MM = 200;
const RAD = Math.PI / 180;
export const PRIMES = [2, 3, 5, 7, 11, 13, 17];
// Exceptions, as `src/cell/collision` makes them: pairs of the arm that touch or are close in all of so many configurations; pairs
// that are as far apart as they can be, by so much.
const ALLOWED_SAMPLES = 200;
const FARTHEST_SAMPLES = 60;
const NEARER_MM = 1;
const ON_AXIS_MM = 1e-3;
/** Clearance of pairs that can be no farther apart, mm; and the distance at which two bodies touch. */
const MIN_CLEARANCE_MM = 1;
const TOUCH_MM = 1e-3;
const FLOOR_MM = [10_000, 10_000, 500] as const;
/** Angle that a table without stops is given (`CONTINUOUS_DEG` in `src/cell/turntable.rs`). */
const CONTINUOUS_DEG = 360;
const MAX_ROUNDS = 64;
const GJK_SHARE = 1e-6;

const sub = (a: Point, b: Point): Point => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Point, b: Point): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a: Point, b: Point): Point => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (a: Point, d: Point, t: number): Point => [a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]];

/** A convex core: its farthest point in a direction. */
type Support = (direction: Point) => Point;

type Core = { kind: "box"; half: Point } | { kind: "cylinder"; radius: number; half: number } | { kind: "segment"; half: number }
  | { kind: "mesh"; tree: MeshBVH };

interface Solid { core: Core; radius: number; reach: number }

/** Farthest point of a placed core. */
function supportOf(core: Exclude<Core, { kind: "mesh" }>, { elements: m }: Matrix4): Support {
  return ([x, y, z]) => {
    const lx = m[0]! * x + m[1]! * y + m[2]! * z;
    const ly = m[4]! * x + m[5]! * y + m[6]! * z;
    const lz = m[8]! * x + m[9]! * y + m[10]! * z;
    let px = 0;
    let py = 0;
    if (core.kind === "box") {
      px = lx < 0 ? -core.half[0] : core.half[0];
      py = ly < 0 ? -core.half[1] : core.half[1];
    } else if (core.kind === "cylinder") {
      const size = Math.hypot(lx, ly);
      if (size > 1e-12) { px = (core.radius * lx) / size; py = (core.radius * ly) / size; }
    }
    const half = core.kind === "box" ? core.half[2] : core.half;
    const pz = lz < 0 ? -half : half;
    return [m[0]! * px + m[4]! * py + m[8]! * pz + m[12]!, m[1]! * px + m[5]! * py + m[9]! * pz + m[13]!,
      m[2]! * px + m[6]! * py + m[10]! * pz + m[14]!];
  };
}

/** Corner of the difference of two cores, with the points it is made of. */
interface Corner { w: Point; a: Point; b: Point }
interface Nearest { point: Point; corners: Corner[]; shares: number[] }

function ofSegment(p: Corner, q: Corner): Nearest {
  const d = sub(q.w, p.w);
  const t = -dot(p.w, d) / (dot(d, d) || 1);
  if (t <= 0) return { point: p.w, corners: [p], shares: [1] };
  if (t >= 1) return { point: q.w, corners: [q], shares: [1] };
  return { point: along(p.w, d, t), corners: [p, q], shares: [1 - t, t] };
}

const nearer = (a: Nearest, b: Nearest): Nearest => (dot(a.point, a.point) <= dot(b.point, b.point) ? a : b);

/** Point of a triangle nearest to the origin: its foot on the plane where that is inside, else one of an edge. */
function ofTriangle(p: Corner, q: Corner, r: Corner): Nearest {
  const normal = cross(sub(q.w, p.w), sub(r.w, p.w));
  const size = dot(normal, normal);
  if (size > 1e-18) {
    const u = dot(normal, cross(sub(r.w, q.w), sub([0, 0, 0], q.w))) / size;
    const v = dot(normal, cross(sub(p.w, r.w), sub([0, 0, 0], r.w))) / size;
    const w = 1 - u - v;
    if (u >= 0 && v >= 0 && w >= 0) {
      const t = dot(p.w, normal) / size;
      return { point: [t * normal[0], t * normal[1], t * normal[2]], corners: [p, q, r], shares: [u, v, w] };
    }
  }
  return nearer(nearer(ofSegment(p, q), ofSegment(q, r)), ofSegment(r, p));
}

/** Point of a tetrahedron nearest to the origin; `null` where the origin is inside. */
function ofTetrahedron(corners: Corner[]): Nearest | null {
  let best: Nearest | null = null;
  for (let i = 0; i < 4; i += 1) {
    const [p, q, r] = [corners[(i + 1) % 4]!, corners[(i + 2) % 4]!, corners[(i + 3) % 4]!];
    const normal = cross(sub(q.w, p.w), sub(r.w, p.w));
    const own = dot(normal, sub(corners[i]!.w, p.w));
    if (own * dot(normal, sub([0, 0, 0], p.w)) > 0 && Math.abs(own) > 1e-12) continue;
    const found = ofTriangle(p, q, r);
    best = best ? nearer(best, found) : found;
  }
  return best;
}

function nearestOf(corners: Corner[]): Nearest | null {
  if (corners.length === 1) return { point: corners[0]!.w, corners, shares: [1] };
  if (corners.length === 2) return ofSegment(corners[0]!, corners[1]!);
  return corners.length === 3 ? ofTriangle(corners[0]!, corners[1]!, corners[2]!) : ofTetrahedron(corners);
}

/** Distance of two convex cores with a point of each; 0 where they overlap. `first` is any direction from one to the other. */
export function coreDistance(a: Support, b: Support, first: Point): { mm: number; from: Point; to: Point } {
  const cornerAt = (d: Point): Corner => {
    const [p, q] = [a([-d[0], -d[1], -d[2]]), b(d)];
    return { w: sub(p, q), a: p, b: q };
  };
  let found: Nearest = nearestOf([cornerAt(dot(first, first) > 0 ? first : [1, 0, 0])])!;
  for (let round = 0; round < MAX_ROUNDS; round += 1) {
    const size = dot(found.point, found.point);
    if (size < 1e-12) break;
    const next = cornerAt(found.point);
    if (size - dot(found.point, next.w) <= GJK_SHARE * size) break;
    const better = nearestOf([...found.corners, next]);
    if (!better) { found = { ...found, point: [0, 0, 0] }; break; }
    if (dot(better.point, better.point) >= size) break;
    found = better;
  }
  const mix = (of: "a" | "b"): Point => found.corners.reduce<Point>((sum, corner, i) => along(sum, corner[of], found.shares[i]!), [0, 0, 0]);
  return { mm: Math.sqrt(dot(found.point, found.point)), from: mix("a"), to: mix("b") };
}

const solidOfMesh = (positions: Float32Array): Solid => {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(positions, 3));
  geometry.computeBoundingSphere();
  const { center, radius } = geometry.boundingSphere!;
  const tree = new MeshBVH(geometry, { indirect: true });
  // Two surfaces are held against each other by both trees.
  Object.assign(geometry, { boundsTree: tree });
  return { core: { kind: "mesh", tree }, radius: 0, reach: center.length() + radius };
};

function solidOf(shape: Shape, meshes: Record<string, Solid>): Solid | null {
  const { size_mm: size, radius_mm: radius = 0 } = shape;
  if (shape.kind === "box") return { core: { kind: "box", half: size!.map((edge) => edge / 2) as Point }, radius: 0, reach: Math.hypot(...size!) / 2 };
  if (shape.kind === "cylinder") {
    const half = shape.height_mm! / 2;
    return { core: { kind: "cylinder", radius, half }, radius: 0, reach: Math.hypot(radius, half) };
  }
  if (shape.kind === "capsule") return { core: { kind: "segment", half: shape.length_mm! / 2 }, radius, reach: radius + shape.length_mm! / 2 };
  return meshes[shape.mesh!] ?? null;
}

type Parent = "still" | "plate" | number;
interface SceneBody { name: string; parent: Parent; pose: Matrix4; solid: Solid; isLoad?: boolean; holdsPart?: boolean }
interface Pair { a: number; b: number; farthestMm: number; clearanceMm: number }

const isStill = (parent: Parent): boolean => parent === "still" || parent === 0;

function mayMeet(a: SceneBody, b: SceneBody): boolean {
  if (typeof a.parent === "number" && typeof b.parent === "number") {
    return Math.abs(a.parent - b.parent) > (Boolean(a.isLoad) === Boolean(b.isLoad) ? 1 : 0);
  }
  if (a.parent === "plate" && b.parent === "plate") return false;
  if (a.parent === "plate" && b.parent === "still") return !b.holdsPart;
  if (a.parent === "still" && b.parent === "plate") return !a.holdsPart;
  return !(isStill(a.parent) && isStill(b.parent));
}

function bodiesOf({ cell, robot, table, scanner, part, fixture, tableFromPart, meshes }: ClearanceCell): SceneBody[] {
  const solids = Object.fromEntries(Object.entries(meshes).map(([id, positions]) => [id, solidOfMesh(positions)]));
  const made: SceneBody[] = [];
  const add = (body: Body, parent: Parent, owner: Matrix4, more: Partial<SceneBody> = {}): void => {
    const solid = solidOf(body.shape, solids);
    if (solid) made.push({ name: body.name, parent, pose: owner.clone().multiply(matrixOf(body.owner_from_body)), solid, ...more });
  };
  const own = new Matrix4();
  const surfaces = robot.surfaces ?? [];
  // Where the surface of a link is known, it decides and not the capsules around it.
  robot.links.filter(({ link }) => !surfaces.some((surface) => surface.link === link)).forEach((link) => {
    const [from, to] = [link.from_mm, link.to_mm];
    const axis = sub(to, from);
    const length = Math.hypot(...axis);
    const solid: Solid = { core: { kind: "segment", half: length / 2 }, radius: link.radius_mm, reach: link.radius_mm + length / 2 };
    const middle = from.map((value, i) => (value + to[i]!) / 2) as Point;
    made.push({ name: link.name, parent: link.link, pose: frameAlong(middle, length > 0 ? (axis.map((value) => value / length) as Point) : [0, 0, 1]), solid });
  });
  surfaces.forEach((surface) => add(surface, surface.link, own));
  (cell.cable ?? []).forEach((piece) => add(piece, piece.link, own));
  (cell.mount ?? []).forEach((body) => add(body, 6, own, { isLoad: true }));
  (scanner.body ?? []).forEach((body) => add(body, 6, matrixOf(cell.flange_from_scanner), { isLoad: true }));
  const half = table.plate_thickness_mm / 2;
  const radius = table.plate_diameter_mm / 2;
  made.push({ name: "turntable plate", parent: "plate", pose: shift(0, 0, -half), holdsPart: true,
    solid: { core: { kind: "cylinder", radius, half }, radius: 0, reach: Math.hypot(radius, half) } });
  (table.body ?? []).forEach((body) => add(body, "still", matrixOf(cell.base_from_table), { holdsPart: true }));
  if (cell.floor_mm != null) {
    add({ name: "floor", shape: { kind: "box", size_mm: [...FLOOR_MM] } }, "still", shift(0, 0, cell.floor_mm - FLOOR_MM[2] / 2), { holdsPart: true });
  }
  (cell.obstacles ?? []).forEach((body) => add(body, "still", own));
  for (const [name, held] of [["part", part], ["fixture", fixture]] as const) {
    if (held?.length) made.push({ name, parent: "plate", pose: matrixOf(tableFromPart), solid: solidOfMesh(held) });
  }
  return made;
}

/** Frame at a point whose z is along a unit vector. */
function frameAlong(at: Point, z: Point): Matrix4 {
  const side: Point = Math.abs(z[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const y = cross(z, side);
  const size = Math.hypot(...y);
  const [yx, yy, yz] = y.map((value) => value / size) as Point;
  const [xx, xy, xz] = cross([yx, yy, yz], z);
  return new Matrix4().set(xx, yx, z[0], at[0], xy, yy, z[1], at[1], xz, yz, z[2], at[2], 0, 0, 0, 1);
}

export function halton(index: number, base: number): number {
  let [fraction, value] = [1, 0];
  for (let rest = index; rest > 0; rest = Math.floor(rest / base)) {
    fraction /= base;
    value += fraction * (rest % base);
  }
  return value;
}

const boxSupport = ({ min, max }: Box3): Support => ([x, y, z]) => [x < 0 ? min.x : max.x, y < 0 ? min.y : max.y, z < 0 ? min.z : max.z];
const cornersSupport = (corners: Point[]): Support => (d) =>
  corners.reduce((best, corner) => (dot(corner, d) > dot(best, d) ? corner : best));

/** Distance of a placed convex solid and a placed surface, if it is less than `withinMm`. */
function toSurface(convex: Solid, pose: Matrix4, tree: MeshBVH, treePose: Matrix4, withinMm: number): { mm: number; from: Point; to: Point } | null {
  const local = treePose.clone().invert().multiply(pose);
  const support = supportOf(convex.core as Exclude<Core, { kind: "mesh" }>, local);
  const centre: Point = [local.elements[12]!, local.elements[13]!, local.elements[14]!];
  let best = withinMm + convex.radius;
  let found: { from: Point; to: Point } | null = null;
  const isNearBall = ({ min, max }: Box3): boolean => {
    const [x, y, z] = centre;
    return Math.hypot(Math.max(min.x - x, 0, x - max.x), Math.max(min.y - y, 0, y - max.y), Math.max(min.z - z, 0, z - max.z)) < best + convex.reach;
  };
  const isNear = (box: Box3): boolean => isNearBall(box)
    && coreDistance(support, boxSupport(box), [centre[0] - (box.min.x + box.max.x) / 2, centre[1] - (box.min.y + box.max.y) / 2, centre[2] - (box.min.z + box.max.z) / 2]).mm < best;
  tree.shapecast({
    boundsTraverseOrder: ({ min, max }) => Math.hypot((min.x + max.x) / 2 - centre[0], (min.y + max.y) / 2 - centre[1], (min.z + max.z) / 2 - centre[2]),
    intersectsBounds: isNear,
    intersectsTriangle: ({ a, b, c }) => {
      const corners = [a, b, c].map((corner): Point => [corner.x, corner.y, corner.z]);
      const { mm, from, to } = coreDistance(support, cornersSupport(corners), sub(centre, corners[0]!));
      if (mm < best) { best = mm; found = { from, to }; }
      return best <= 0;
    },
  });
  if (!found) return null;
  const back = (point: Point): Point => {
    const m = treePose.elements;
    return [0, 1, 2].map((i) => m[i]! * point[0] + m[4 + i]! * point[1] + m[8 + i]! * point[2] + m[12 + i]!) as Point;
  };
  const { from, to } = found as { from: Point; to: Point };
  return { mm: best, from: back(from), to: back(to) };
}

/** A cell with its part on the plate, ready to be asked. */
export class ClearanceScene {
  private readonly bodies: SceneBody[];
  /** Pairs that must keep apart, and those of them that tell something of a configuration. */
  private all: Pair[] = [];
  private pairs: Pair[] = [];

  constructor(private readonly given: ClearanceCell) {
    this.bodies = bodiesOf(given);
    this.bodies.forEach((body, b) => this.bodies.slice(0, b).forEach((other, a) => {
      if (mayMeet(other, body)) this.all.push({ a, b, farthestMm: Infinity, clearanceMm: given.clearanceMm });
    }));
    this.except();
  }

  private place(configurationDeg: readonly number[]): Matrix4[] {
    const frames = linkFrames(this.given.robot, configurationDeg);
    const plate = matrixOf(this.given.cell.base_from_table).multiply(turnZ((configurationDeg[6] ?? 0) * RAD));
    return this.bodies.map(({ parent, pose }) => (parent === "still" ? pose : (parent === "plate" ? plate : frames[parent]!).clone().multiply(pose)));
  }

  /** Distance of a pair, if it is less than `withinMm`. */
  private distance({ a, b }: Pair, poses: Matrix4[], withinMm: number): Omit<Clearance, "a" | "b"> | null {
    const [one, two] = [this.bodies[a]!.solid, this.bodies[b]!.solid];
    const [poseOne, poseTwo] = [poses[a]!, poses[b]!];
    const between: Point = [0, 1, 2].map((i) => poseOne.elements[12 + i]! - poseTwo.elements[12 + i]!) as Point;
    if (Math.hypot(...between) - one.reach - two.reach >= withinMm) return null;
    if (one.core.kind === "mesh" && two.core.kind === "mesh") return surfaces(one.core.tree, poseOne, two.core.tree, poseTwo, withinMm);
    if (two.core.kind === "mesh") return grown(toSurface(one, poseOne, two.core.tree, poseTwo, withinMm), one.radius, 0);
    if (one.core.kind === "mesh") {
      const found = grown(toSurface(two, poseTwo, one.core.tree, poseOne, withinMm), two.radius, 0);
      return found && { mm: found.mm, from: found.to, to: found.from };
    }
    const found = grown(coreDistance(supportOf(one.core, poseOne), supportOf(two.core, poseTwo), between), one.radius, two.radius);
    return found && found.mm < withinMm ? found : null;
  }

  private except(): void {
    const axes: Pick<Axis, "min_deg" | "max_deg">[] = [...this.given.robot.joints, this.given.table.rotation.kind === "limited"
      ? { min_deg: this.given.table.rotation.min_deg!, max_deg: this.given.table.rotation.max_deg! } : { min_deg: -CONTINUOUS_DEG, max_deg: CONTINUOUS_DEG }];
    const spread = (sample: number): number[] => axes.map(({ min_deg: low, max_deg: high }, axis) => low + (high - low) * halton(sample, PRIMES[axis]!));
    const onArm = this.all.filter(({ a, b }) => typeof this.bodies[a]!.parent === "number" && typeof this.bodies[b]!.parent === "number");
    let [crowded, touching] = [onArm, onArm];
    for (let sample = 1; sample <= ALLOWED_SAMPLES && crowded.length > 0; sample += 1) {
      const poses = this.place(spread(sample));
      crowded = crowded.filter((pair) => this.distance(pair, poses, this.given.clearanceMm) !== null);
      touching = touching.filter((pair) => crowded.includes(pair) && this.distance(pair, poses, TOUCH_MM) !== null);
    }
    const still = (a: number, b: number): boolean => isStill(this.bodies[a]!.parent) && this.isOnAxis(this.bodies[b]!);
    for (const pair of this.all) {
      if (crowded.includes(pair) || still(pair.a, pair.b) || still(pair.b, pair.a)) pair.clearanceMm = Math.min(MIN_CLEARANCE_MM, pair.clearanceMm);
    }
    this.all = this.all.filter((pair) => !touching.includes(pair));
    this.pairs = this.all.filter((pair) => pair.clearanceMm >= this.given.clearanceMm);
    let near = this.pairs.map((pair) => ({ pair, mm: -Infinity }));
    for (let sample = 1; sample <= FARTHEST_SAMPLES && near.length > 0; sample += 1) {
      const poses = this.place(spread(sample));
      near = near.filter((entry) => {
        const found = this.distance(entry.pair, poses, FARTHEST_MM);
        if (found) entry.mm = Math.max(entry.mm, found.mm);
        return found !== null;
      });
    }
    near.forEach(({ pair, mm }) => { pair.farthestMm = mm; });
  }

  /** True for a capsule around the arm's first axis, which no motion brings nearer to what stands still. */
  private isOnAxis({ parent, solid, pose }: SceneBody): boolean {
    if (parent !== 1 || solid.core.kind !== "segment") return false;
    const half = solid.core.half;
    const ends = [0, 90].map((deg) => {
      const { elements: m } = linkFrames(this.given.robot, [deg, 0, 0, 0, 0, 0])[1]!.multiply(pose);
      return [-half, half].map((z): Point => [m[8]! * z + m[12]!, m[9]! * z + m[13]!, m[10]! * z + m[14]!]);
    });
    return ends[0]!.every((end, i) => Math.hypot(...sub(end, ends[1]![i]!)) < ON_AXIS_MM);
  }

  /** True if every pair keeps its clearance. */
  isClear(configurationDeg: readonly number[]): boolean {
    const poses = this.place(configurationDeg);
    return this.all.every((pair) => this.distance(pair, poses, pair.clearanceMm) === null);
  }

  /** What is nearest to each other at a configuration, of what is nearer than it has to be; `null` beyond `FARTHEST_MM`. */
  nearest(configurationDeg: readonly number[]): Clearance | null {
    const poses = this.place(configurationDeg);
    let best: Clearance | null = null;
    for (const pair of this.pairs) {
      const found = this.distance(pair, poses, Math.min(best?.mm ?? FARTHEST_MM, pair.farthestMm - NEARER_MM));
      if (found) best = { ...found, a: this.bodies[pair.a]!.name, b: this.bodies[pair.b]!.name };
    }
    return best;
  }
}

/** Distance of the surfaces of cores that are grown by radii. */
function grown(found: { mm: number; from: Point; to: Point } | null, one: number, two: number): Omit<Clearance, "a" | "b"> | null {
  if (!found) return null;
  const { mm, from, to } = found;
  const towards = sub(to, from).map((value) => value / (mm || 1)) as Point;
  return { mm: Math.max(0, mm - one - two), from: along(from, towards, one), to: along(to, towards, -two) };
}

function surfaces(one: MeshBVH, poseOne: Matrix4, two: MeshBVH, poseTwo: Matrix4, withinMm: number): Omit<Clearance, "a" | "b"> | null {
  const [onOne, onTwo] = [{ point: poseAt(poseOne), distance: 0, faceIndex: -1 }, { point: poseAt(poseOne), distance: 0, faceIndex: -1 }];
  const found = one.closestPointToGeometry(two.geometry, poseOne.clone().invert().multiply(poseTwo), onOne, onTwo, 0, withinMm);
  if (!found || found.distance >= withinMm) return null;
  const from = onOne.point.applyMatrix4(poseOne);
  return { mm: found.distance, from: from.toArray(), to: onTwo.point.applyMatrix4(poseTwo).toArray() };
}

const poseAt = ({ elements: m }: Matrix4): Vector3 => new Vector3(m[12]!, m[13]!, m[14]!);
