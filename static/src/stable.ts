// The ways in which a part can stand on a plate, as `src/geometry/stable_poses.rs` finds them: the facets of its convex hull on
// which its centre of mass has its foot, and from which it takes a tilt to topple it, the likeliest first (K. Goldberg and others
// 1999, *Part pose statistics*, IEEE Transactions on Robotics and Automation 15(5)).
import { Vector3 } from "three";
import { ConvexHull } from "three/addons/math/ConvexHull.js";

type Hull = InstanceType<typeof ConvexHull>;
type Face = Hull["faces"][number];

/** A face to stand on: the direction that points down, and the share of all ways to stand. */
export interface StablePose { down: [number, number, number]; share: number }

const TIPPING_RAD = (3 * Math.PI) / 180;
const MAX_POSES = 12;
/** Corners are told apart to this share of the part's size. */
const SAME_CORNER = 1e-6;

/** Corners of the triangles, each once. */
function cornersOf(positions: Float32Array, size: number): Vector3[] {
  const seen = new Set<string>();
  const made: Vector3[] = [];
  const step = size * SAME_CORNER;
  for (let i = 0; i < positions.length; i += 3) {
    const [x, y, z] = [positions[i]!, positions[i + 1]!, positions[i + 2]!];
    const key = `${Math.round(x / step)},${Math.round(y / step)},${Math.round(z / step)}`;
    if (seen.has(key)) continue;
    seen.add(key);
    made.push(new Vector3(x, y, z));
  }
  return made;
}

interface Box { min: Vector3; max: Vector3; middle: Vector3; size: number }

function boxOf(positions: Float32Array): Box {
  const [min, max, point] = [new Vector3(Infinity, Infinity, Infinity), new Vector3(-Infinity, -Infinity, -Infinity), new Vector3()];
  for (let i = 0; i < positions.length; i += 3) { point.fromArray(positions, i); min.min(point); max.max(point); }
  return { min, max, middle: min.clone().add(max).multiplyScalar(0.5), size: min.distanceTo(max) };
}

/** Six times the volume of the tetrahedra from `middle` to triangles, and their centre of mass from there. */
function centreOf(triangles: Iterable<[Vector3, Vector3, Vector3]>, middle: Vector3): { volume: number; centre: Vector3 } {
  let volume = 0;
  const moment = new Vector3();
  const [p, q, r] = [new Vector3(), new Vector3(), new Vector3()];
  for (const [a, b, c] of triangles) {
    p.subVectors(a, middle); q.subVectors(b, middle); r.subVectors(c, middle);
    const sixth = p.dot(new Vector3().crossVectors(q, r));
    volume += sixth;
    moment.addScaledVector(p.add(q).add(r), sixth / 4);
  }
  return { volume, centre: volume === 0 ? middle.clone() : moment.divideScalar(volume).add(middle) };
}

function* trianglesOf(positions: Float32Array): Generator<[Vector3, Vector3, Vector3]> {
  for (let i = 0; i < positions.length; i += 9) {
    yield [new Vector3().fromArray(positions, i), new Vector3().fromArray(positions, i + 3), new Vector3().fromArray(positions, i + 6)];
  }
}

const cornersOfFace = (face: Face): [Vector3, Vector3, Vector3] =>
  [face.getEdge(0).head().point, face.getEdge(1).head().point, face.getEdge(2).head().point];

/** Centre of mass of the enclosed volume; of the hull where the surface encloses none that means something. */
function centreOfMass(positions: Float32Array, hull: Hull, { min, max, middle }: Box): Vector3 {
  const { volume, centre } = centreOf(trianglesOf(positions), middle);
  const edges = max.clone().sub(min);
  const whole = edges.x * edges.y * edges.z;
  const isSensible = volume > 6e-3 * whole && volume <= 6 * whole && centre.clone().clamp(min, max).equals(centre);
  return isSensible ? centre : centreOf(hull.faces.map(cornersOfFace), middle).centre;
}

/** Solid angle of a triangle (A. van Oosterom and J. Strackee 1983, *The Solid Angle of a Plane Triangle*). */
function solidAngle(corners: [Vector3, Vector3, Vector3], from: Vector3): number {
  const [a, b, c] = corners.map((corner) => corner.clone().sub(from)) as [Vector3, Vector3, Vector3];
  const [la, lb, lc] = [a.length(), b.length(), c.length()];
  const divisor = la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la;
  return 2 * Math.atan2(Math.abs(a.dot(new Vector3().crossVectors(b, c))), divisor);
}

/** A pose with the centre of mass lower than in any other nearby. */
interface Rest { down: Vector3; height: number }

/** The pose on a facet, if that holds the foot of the centre of mass. */
function restOn(face: Face, centre: Vector3, rounding: number): Rest | null {
  const corners = cornersOfFace(face);
  const height = corners[0].clone().sub(centre).dot(face.normal);
  const foot = centre.clone().addScaledVector(face.normal, height);
  const isInside = (from: Vector3, to: Vector3): boolean => {
    const edge = to.clone().sub(from);
    return edge.clone().cross(foot.clone().sub(from)).dot(face.normal) >= -rounding * edge.length();
  };
  const rests = height > rounding && corners.every((corner, i) => isInside(corner, corners[(i + 1) % 3]!));
  return rests ? { down: face.normal.clone(), height } : null;
}

/** Half of the convex outline of sorted points, counter-clockwise (A. M. Andrew 1979). */
function halfOutline(points: [number, number][]): [number, number][] {
  const outline: [number, number][] = [];
  for (const [x, y] of points) {
    for (;;) {
      const [a, b] = outline.slice(-2);
      if (!b || (b[0] - a![0]) * (y - a![1]) - (b[1] - a![1]) * (x - a![0]) > 0) break;
      outline.pop();
    }
    outline.push([x, y]);
  }
  return outline;
}

function enclosesOrigin(points: [number, number][], margin: number): boolean {
  points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const [lower, upper] = [halfOutline(points), halfOutline([...points].reverse())];
  const isWithin = ([ax, ay]: [number, number], [bx, by]: [number, number]): boolean =>
    ax * by - ay * bx >= margin * Math.hypot(bx - ax, by - ay);
  return points.length > 2 && [lower, upper].every((half) => half.every((at, i) => i === 0 || isWithin(half[i - 1]!, at)));
}

/** True if it takes a tilt by more than `TIPPING_RAD` to topple the body: the condition at the head of `stable_poses.rs`. */
function isStable({ down, height }: Rest, corners: Vector3[], centre: Vector3, rounding: number): boolean {
  const margin = height * Math.tan(TIPPING_RAD);
  const depth = margin * Math.tan(TIPPING_RAD);
  const across = new Vector3(1, 0, 0).cross(down);
  if (across.lengthSq() < 0.1) across.set(0, 1, 0).cross(down);
  const along = down.clone().cross(across.normalize());
  const supports = corners.flatMap((corner): [number, number][] => {
    const offset = corner.clone().sub(centre);
    const shorter = depth / (depth + Math.max(height - offset.dot(down), 0));
    const [x, y] = [offset.dot(across) * shorter, offset.dot(along) * shorter];
    return x * x + y * y >= margin * margin ? [[x, y]] : [];
  });
  return enclosesOrigin(supports, margin + rounding);
}

/** Ways to stand, the likeliest first, of triangles as nine numbers each; none for what has no volume. */
export function stablePoses(positions: Float32Array): StablePose[] {
  const box = boxOf(positions);
  const corners = cornersOf(positions, box.size);
  const edges = box.max.clone().sub(box.min);
  const rounding = SAME_CORNER * box.size;
  if (corners.length < 4 || Math.min(edges.x, edges.y, edges.z) <= rounding) return [];
  const hull = new ConvexHull().setFromPoints(corners);
  const centre = centreOfMass(positions, hull, box);
  const rests = hull.faces.flatMap((face) => restOn(face, centre, rounding) ?? []).sort((a, b) => a.height - b.height);
  // Of those within twice the tipping angle of one another a body tips over from all but the lowest.
  const lowest: Rest[] = [];
  for (const rest of rests) if (lowest.every(({ down }) => down.dot(rest.down) < Math.cos(2 * TIPPING_RAD))) lowest.push(rest);
  const shareOf = ({ down }: Rest): number => {
    const face = hull.faces.filter(({ normal }) => normal.dot(down) >= Math.cos(TIPPING_RAD));
    return face.reduce((sum, triangle) => sum + solidAngle(cornersOfFace(triangle), centre), 0) / (4 * Math.PI);
  };
  const hullCorners = [...new Set(hull.faces.flatMap(cornersOfFace))];
  // Shares that are equal but for rounding are in the order of their directions, so that rounding decides nothing.
  const digits = ({ share, down: [x, y, z] }: StablePose): number[] => [-share, z, y, x].map((value) => Math.round(value * 1e6));
  const found = lowest.filter((rest) => isStable(rest, hullCorners, centre, rounding))
    .map((rest): StablePose => ({ down: rest.down.toArray(), share: shareOf(rest) }))
    .sort((a, b) => digits(a).map((digit, i) => digit - digits(b)[i]!).find((difference) => difference !== 0) ?? 0);
  const all = found.reduce((sum, { share }) => sum + share, 0);
  return found.slice(0, MAX_POSES).map(({ down, share }) => ({ down, share: share / all }));
}
